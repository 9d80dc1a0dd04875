# SPDX-License-Identifier: Apache-2.0
"""Studies of a machine, under their names on the command line.

Each function imports its modules when it is called, so that importing this package is fast.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mech_twin.capabilities.design import Design
    from mech_twin.capabilities.long_run import RegimeAnswer, RegimeQuestion, SynthesisAnswer, SynthesisQuestion
    from mech_twin.capabilities.published import PublishedRow
    from mech_twin.capabilities.sizing import Sizing
    from mech_twin.declarations.quantity import Parameters
    from mech_twin.studies.design_scan import DesignScan
    from mech_twin.studies.parameter_sweep import Sweep


def reproduce(machine: str | None = None, parameters: Parameters | None = None) -> tuple[PublishedRow, ...]:
    """Return every published number with the computed one.

    Parameters
    ----------
    machine : str, optional
        Machine of the catalogue; all of them if absent, rows of sources that contradict themselves first.
    parameters : Parameters, optional
        Configuration of that one machine; the installed one if absent.
    """
    from mech_twin.studies.declared_studies import all_rows, machine_rows

    return all_rows() if machine is None else machine_rows(machine, parameters)


def draw_figures(machine: str, directory: Path, parameters: Parameters | None = None) -> list[Path]:
    """Draw a machine's published figures; return the files, an SVG and a PNG each.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    directory : Path
        Output directory; created if missing.
    parameters : Parameters, optional
        Configuration of the machine; the installed one if absent.
    """
    from mech_twin.studies.declared_studies import machine_figures

    return machine_figures(machine, directory, parameters)


def sweep(
    machine: str,
    axes: Mapping[str, Sequence[float | int | str | bool]],
    table: Path,
    *,
    parameters: Parameters | None = None,
    outputs: Sequence[str] = (),
    duration_s: float = 0.0,
    cores: int | None = None,
    scheduler: str | None = None,
    picture: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Compute the summary numbers of a machine over a grid of configuration keys; write a table and a plot.

    An interrupted sweep continues where it stopped if it is called again with the same table.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    axes : mapping
        Dotted configuration keys and the values each takes; several keys make a grid.
    table : Path
        ``.parquet`` or ``.csv`` file to write.
    parameters : Parameters, optional
        The rest of the configuration; the installed one if absent.
    outputs : sequence of str
        Names of the requested summary numbers; all if empty.
    duration_s : float
        Simulated time at each point, whose metrics are added to the summary; 0 for the report alone.
    cores : int, optional
        Processes to spread over; all cores if absent.
    scheduler : str, optional
        Address of a Dask scheduler to use instead.
    picture : bool
        Whether to plot the table.
    progress : callable, optional
        ``progress(done, all)``.
    """
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.parameter_sweep import swept
    from mech_twin.studies.sweep_table import question

    asked = question(machine, parameters or machine_parameters(machine), axes, outputs, duration_s)
    return swept(asked, table, cores=cores, scheduler=scheduler, picture=picture, progress=progress)


def size(
    machine: str,
    parameters: Parameters | None = None,
    *,
    limits: Mapping[str, float] | None = None,
    objective: str | None = None,
    tolerance: float | None = None,
) -> Sizing:
    """Return the sizes of a machine's parts, the resulting configuration, and the active constraint.

    Breaker: spring and preload.  Press: flywheel.  Vibration crank: counterweight and balancing fraction.  Roller
    former: motor, stiffness and damping.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    parameters : Parameters, optional
        The rest of the configuration; the installed one if absent.
    limits : mapping, optional
        Limits that differ from the usual ones, by name (``LIMITS`` of the machine's file in `each machine`).
    objective : str, optional
        Objective to minimise; the first of the machine's ``OBJECTIVES`` if absent.
    tolerance : float, optional
        Relative tolerance of the assumed values for which the limits must hold in the worst case; the machine's usual
        one if absent, 0 for the machine exactly as configured.
    """
    from mech_twin.studies.declared_studies import sized

    return sized(machine, parameters, limits, objective, tolerance)


def search(
    machine: str,
    objectives: Sequence[str] = (),
    *,
    parameters: Parameters | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    limits: Mapping[str, float] | None = None,
    seed: int = 1,
    points: int = 9,
) -> list[Design]:
    """Return a machine's best design for one objective, or the Pareto front of several; the same for the same seed.

    Parameters
    ----------
    machine : str
        Machine of the catalogue that has a design question.
    objectives : sequence of str
        Objectives of the machine; its usual one if empty.
    parameters : Parameters, optional
        Configuration for all values but the design variables; the installed one if absent.
    bounds, limits : mapping, optional
        Bounds of variables and limits of constraints that differ from the usual ones, by name.
    seed : int
        Seed of scan and optimiser.
    points : int
        Directions of the Pareto front that are refined, besides one per objective.
    """
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.design_scan import asked_objectives, design_question

    question = design_question(machine)
    wanted = asked_objectives(question, tuple(objectives))
    return question.search(
        parameters or machine_parameters(machine), question.space(bounds, limits), wanted, seed, points
    )


def search_runs(
    machine: str,
    objective: str,
    bounds: Mapping[str, tuple[float, float]],
    *,
    parameters: Parameters | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    duration_s: float = 0.0,
    seed: int = 1,
    cores: int | None = None,
) -> Design:
    """Return the best design of any machine by its report and simulated runs; the same for the same seed.

    Parameters
    ----------
    machine : str
        Machine of the catalogue, or the path of a page.
    objective : str
        Number of the report or of a run to minimise; with ``-`` before it, to maximise.
    bounds : mapping
        Lower and upper bound of each design key.
    parameters : Parameters, optional
        The rest of the configuration; the installed one if absent.
    limits : mapping, optional
        Lower and upper limits of numbers; infinite for none.
    duration_s : float
        Simulated time of each design; 0 for the report alone.
    seed : int
        Seed of the scan.
    cores : int, optional
        Processes to spread over; all cores if absent.
    """
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.run_search import run_search, searched_by_runs

    known = parameters or machine_parameters(machine)
    asked = run_search(machine, known, objective, bounds, limits or {}, duration_s)
    return searched_by_runs(asked, known, seed, cores)


def designs(
    machine: str,
    count: int,
    *,
    parameters: Parameters | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    limits: Mapping[str, float] | None = None,
    seed: int = 1,
    cores: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DesignScan:
    """Return the feasible designs of a machine among ``count`` random ones.

    Parameters
    ----------
    machine : str
        Machine of the catalogue that has a design question.
    count : int
        Number of random designs.
    parameters : Parameters, optional
        Configuration that is designed; the installed one if absent.
    bounds, limits : mapping, optional
        Bounds of variables and limits of constraints that differ from the usual ones, by name.
    seed : int
        Seed; the result does not depend on where a design is computed.
    cores : int, optional
        Cores of this machine; all if absent.
    scheduler : str, optional
        Address of a Dask scheduler to spread over instead.
    progress : callable, optional
        ``progress(done, all)``.
    """
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.design_scan import design_question, design_scan

    space = design_question(machine).space(bounds, limits)
    return design_scan(
        machine,
        parameters or machine_parameters(machine),
        count,
        space,
        seed,
        cores=cores,
        scheduler=scheduler,
        progress=progress,
    )


def synthesise(
    machine: str,
    impact_speed_m_per_s: float,
    *,
    parameters: Parameters | None = None,
    options: Mapping[str, float | int] | None = None,
    periods: int = 1_000_000,
) -> SynthesisAnswer:
    """Return the published cycle of a machine and a robust one for the same impact speed, side by side.

    Parameters
    ----------
    machine : str
        Machine of the catalogue whose cycle can be synthesised.
    impact_speed_m_per_s : float
        Required impact speed.
    parameters : Parameters, optional
        Configuration for all values that the synthesis does not choose; the installed one if absent.
    options : mapping, optional
        Requirements for the robust cycle that differ from the usual ones.
    periods : int
        Length of the endurance runs, in periods.

    Raises
    ------
    StudyError
        If the number of periods or of starts is out of range, or there is no such cycle.
    """
    from mech_twin.capabilities.long_run import MOST_ENDURANCE_PERIODS, MOST_STARTS
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.declared_studies import asked_of, counted_within

    question: SynthesisQuestion = asked_of(machine, "synthesis", "no cycle to synthesise")
    counted_within("periods", periods, MOST_ENDURANCE_PERIODS)
    if options and "starts" in options:
        counted_within("starts", options["starts"], MOST_STARTS)
    return question.answer(parameters or machine_parameters(machine), impact_speed_m_per_s, options or {}, periods)


def regimes(
    machine: str,
    values: Sequence[float],
    key: str | None = None,
    *,
    parameters: Parameters | None = None,
    settling_periods: int = 1000,
    progress: Callable[[int, int], None] | None = None,
) -> RegimeAnswer:
    """Return the steady-state regimes of a machine over the values of one configuration key.

    Parameters
    ----------
    machine : str
        Machine of the catalogue whose regimes can be mapped.
    values : sequence of float
        Values of the key.
    key : str, optional
        Configuration key; the machine's usual one if absent.
    parameters : Parameters, optional
        The rest of the configuration; the installed one if absent.
    settling_periods : int
        Periods simulated before a regime is determined.
    progress : callable, optional
        ``progress(done, all)``.

    Raises
    ------
    StudyError
        If the number of periods is out of range.
    """
    from mech_twin.capabilities.long_run import MOST_SETTLING_PERIODS
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.declared_studies import asked_of, counted_within
    from mech_twin.studies.sweep_table import require_key

    question: RegimeQuestion = asked_of(machine, "regimes", "no regimes to map")
    counted_within("settling", settling_periods, MOST_SETTLING_PERIODS)
    known = parameters or machine_parameters(machine)
    if key is not None:
        require_key(type(known), key)
    return question.answer(known, values, key or question.usual_key, settling_periods, progress)

# SPDX-License-Identifier: Apache-2.0
"""Studies of a machine, under their names on the command line.

Each function imports its modules when it is called, so that importing this package is fast.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from mech_twin.errors import StudyError

if TYPE_CHECKING:
    from mech_twin.capabilities.design import Design
    from mech_twin.capabilities.long_run import RegimeAnswer, RegimeQuestion, SynthesisAnswer, SynthesisQuestion
    from mech_twin.capabilities.published import PublishedRow
    from mech_twin.capabilities.sizing import Sizing
    from mech_twin.declarations.quantity import Parameters
    from mech_twin.studies.design_scan import DesignScan
    from mech_twin.studies.parameter_sweep import Sweep


FilePath = str | PathLike[str]
GREATEST_SEED = 2**63 - 1


@contextmanager
def _refusing() -> Iterator[None]:
    """Turn what a configuration refuses of the values that a study tries into an error of one line."""
    from pydantic import ValidationError

    from mech_twin.parameters.errors import refusal

    try:
        yield
    except ValidationError as error:
        raise refusal("this study", error) from error


@_refusing()
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


@_refusing()
def draw_figures(machine: str, directory: FilePath, parameters: Parameters | None = None) -> list[Path]:
    """Draw a machine's published figures; return the files, an SVG and a PNG each.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    directory : path
        Output directory; created if missing.
    parameters : Parameters, optional
        Configuration of the machine; the installed one if absent.
    """
    from mech_twin.studies.declared_studies import machine_figures

    return machine_figures(machine, Path(directory), parameters)


@_refusing()
def sweep(
    machine: str,
    axes: Mapping[str, Sequence[float | int | str | bool]],
    table: FilePath,
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
    table : path
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
    return swept(asked, Path(table), cores=cores, scheduler=scheduler, picture=picture, progress=progress)


@_refusing()
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


@_refusing()
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
    from mech_twin.capabilities.arguments import several, whole_number
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.declared_studies import searches_by_runs
    from mech_twin.studies.design_scan import MOST_POINTS, asked_objectives, design_question

    if searches_by_runs(machine):
        raise StudyError(f"{machine}: no design question; `mech_twin.studies.search_runs` finds a design by its runs")
    question = design_question(machine)
    wanted = asked_objectives(question, several("objectives", objectives, "a list of names"))
    seed, points = whole_number("seed", seed, 0, GREATEST_SEED), whole_number("points", points, 1, MOST_POINTS)
    return question.search(
        parameters or machine_parameters(machine), question.space(bounds, limits), wanted, seed, points
    )


@_refusing()
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
    from mech_twin.capabilities.arguments import whole_number
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.run_search import run_search, searched_by_runs

    known, seed = parameters or machine_parameters(machine), whole_number("seed", seed, 0, GREATEST_SEED)
    asked = run_search(machine, known, objective, bounds, limits or {}, duration_s)
    return searched_by_runs(asked, known, seed, cores)


@_refusing()
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
    from mech_twin.capabilities.arguments import whole_number
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.design_scan import MOST_DESIGNS, design_question, design_scan

    count, seed = whole_number("count", count, 1, MOST_DESIGNS), whole_number("seed", seed, 0, GREATEST_SEED)
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


@_refusing()
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
    from mech_twin.capabilities.arguments import by_name, real_number, whole_number
    from mech_twin.capabilities.long_run import MOST_ENDURANCE_PERIODS, MOST_STARTS
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.declared_studies import asked_of

    question: SynthesisQuestion = asked_of(machine, "synthesis", "no cycle to synthesise")
    periods = whole_number("periods", periods, 1, MOST_ENDURANCE_PERIODS)
    speed = real_number("impact_speed_m_per_s", impact_speed_m_per_s, "a finite number above 0, m/s")
    known = ", ".join(question.options)
    wanted = by_name("options", options, f"numbers by name: {known}")
    for name, value in wanted.items():
        if name not in question.options:
            raise StudyError(f"no option '{name}'; expected one of {known}")
        real_number(f"option {name}", value, "a finite number")
    for name, least, most in (("starts", 1, MOST_STARTS), ("inside", 0, MOST_STARTS), ("seed", 0, GREATEST_SEED)):
        if name in wanted:
            wanted[name] = whole_number(name, wanted[name], least, most)
    return question.answer(parameters or machine_parameters(machine), speed, wanted, periods)


@_refusing()
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
    from mech_twin.capabilities.arguments import real_number, several, whole_number
    from mech_twin.capabilities.long_run import MOST_SETTLING_PERIODS
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.studies.declared_studies import asked_of
    from mech_twin.studies.sweep_table import require_key

    question: RegimeQuestion = asked_of(machine, "regimes", "no regimes to map")
    settling_periods = whole_number("settling", settling_periods, 1, MOST_SETTLING_PERIODS)
    values = several("values", values, "a list of numbers")
    if not values:
        raise StudyError("values: expected at least one")
    for value in values:
        real_number("value", value, "a finite number")
    known = parameters or machine_parameters(machine)
    if key is not None:
        require_key(type(known), key)
    return question.answer(known, values, key or question.usual_key, settling_periods, progress)

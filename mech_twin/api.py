# SPDX-License-Identifier: Apache-2.0
"""The twin from Python: ``import mech_twin as mt; mt.simulate("mb10_breaker", 3.0)``.

Every function takes the name of a machine, settings by dotted configuration key, and the path of a configuration file;
none writes a file unless requested.  The results carry their units.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mech_twin.capabilities.arguments import GREATEST_SEED, real_number, sequence_items, whole_number
from mech_twin.declarations.quantity import LONGEST_RUN_S
from mech_twin.errors import StudyError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine as built_machine
from mech_twin.parameters.load import machine_parameters
from mech_twin.process.interruption import raising_interrupt
from mech_twin.results.objects import Analysis, Columns, Numbers, Run, RunComparison, SizingResult
from mech_twin.roles import own_name

if TYPE_CHECKING:
    from mech_twin.capabilities.design import Design
    from mech_twin.capabilities.published import PublishedRow
    from mech_twin.studies.identification.written_identification import SavedIdentification

Settings = Mapping[str, Any]
FilePath = str | PathLike[str]
MOST_POSITIONS = 1_000_000


def machine_names() -> tuple[str, ...]:
    """Return the names of the machines."""
    return tuple(CATALOGUE)


@raising_interrupt()
def simulate(
    machine: str,
    duration_s: float,
    settings: Settings | None = None,
    *,
    config: FilePath | None = None,
    bag: FilePath | None = None,
    force: bool = False,
) -> Run:
    """Return a run of a machine from rest.

    Parameters
    ----------
    machine : str
        Machine of the catalogue, see `machine_names`.
    duration_s : float
        Simulated time (s).
    settings : mapping, optional
        Values by dotted configuration key that override the configuration: ``{"body.spring_rate_n_per_m": 4000.0}``.
    config : path, optional
        Configuration file; the machine's own if absent.
    bag : path, optional
        Directory of a recording to write as well.
    force : bool
        Whether an existing recording may be overwritten.

    Raises
    ------
    ConfigurationError
        Naming file, key, value and what was expected.

    Examples
    --------
    >>> run = simulate("compaction_press", 0.01)
    >>> run.machine, run.samples.units["time_s"]
    ('compaction_press', 's')
    """
    from contextlib import closing, nullcontext

    from mech_twin.engine.run import frames
    from mech_twin.measurements.units import shown_units
    from mech_twin.studies.simulation import Simulation

    duration_s = real_number(
        "duration_s", duration_s, f"a finite number of seconds, 0 to {LONGEST_RUN_S}", 0.0, LONGEST_RUN_S
    )
    built = built_machine(machine, _path(config), settings)
    simulation = Simulation(built)
    recording: Any = nullcontext()
    if bag is not None:
        from mech_twin.recording.bag_metadata import check_recording_directory
        from mech_twin.results.opened_runs import recorded_to

        directory = _file("bag", bag)
        check_recording_directory(directory, force=force)
        recording = closing(recorded_to(directory, built))
    with recording as recorder:
        for frame in frames(built, duration_s):
            simulation.observe(frame)
            simulation.trajectory.append(frame)
            if recorder is not None:
                recorder.write(frame)
    title = f"{own_name(built.name, built.parameters)}: {duration_s:g} s"
    return Run(
        built.name,
        built.parameters,
        Numbers(title, simulation.summary()),
        Columns(title, "time_s", simulation.trajectory.columns(), shown_units(built)),
        tuple(simulation.events), simulation.residuals(), simulation.remarks(),
    )  # fmt: skip


@raising_interrupt()
def analyse(
    machine: str, settings: Settings | None = None, *, config: FilePath | None = None, positions: int = 360
) -> Analysis:
    """Return the closed-form analysis of a machine: numbers of one cycle, and columns over one turn of the crank.

    Parameters
    ----------
    machine, settings, config
        As in `simulate`.
    positions : int
        Number of crank angles in the columns, evenly over one turn.
    """
    from mech_twin.studies.declared_studies import analysed_columns, cycle_positions

    positions = whole_number("positions", positions, 1, MOST_POSITIONS)
    built = built_machine(machine, _path(config), settings)
    cycle = analysed_columns(built, cycle_positions(positions))
    name = own_name(built.name, built.parameters)
    numbers = Numbers(f"{name}: without a run", built.report())
    return Analysis(built.name, built.parameters, numbers, Columns(f"{name}: one cycle", "crank_rad", cycle))


@raising_interrupt()
def sweep(
    machine: str,
    axes: Mapping[str, Sequence[float | int | str | bool]],
    settings: Settings | None = None,
    *,
    config: FilePath | None = None,
    outputs: Sequence[str] = (),
    duration_s: float = 0.0,
    cores: int | None = None,
    scheduler: str | None = None,
) -> Columns:
    """Return the summary numbers of a machine over a grid of configuration keys, and why a point was refused.

    Parameters
    ----------
    machine, settings, config
        As in `simulate`.
    axes : mapping
        Dotted configuration keys and the values of each; several keys make a grid, the last one varies fastest.
    outputs : sequence of str
        Names of the summary numbers wanted; all if empty.
    duration_s : float
        Time to simulate at each point (s), whose numbers are added to the summary; 0 for the analysis alone.
    cores, scheduler : optional
        Processes to spread over (all cores if absent), or the address of a Dask scheduler.
    """
    from mech_twin.studies import sweep as swept
    from mech_twin.studies.sweep_table import columns

    known = machine_parameters(machine, _path(config), settings)
    with tempfile.TemporaryDirectory() as directory:
        done = swept(
            machine, axes, Path(directory) / "points.csv", parameters=known, outputs=outputs, duration_s=duration_s,
            cores=cores, scheduler=scheduler, picture=False,
        )  # fmt: skip
    return Columns(f"{own_name(machine, known)}: sweep", next(iter(axes)), columns(done.asked, done.points))


@raising_interrupt()
def size(
    machine: str,
    settings: Settings | None = None,
    *,
    config: FilePath | None = None,
    limits: Mapping[str, float] | None = None,
    objective: str | None = None,
    tolerance: float | None = None,
) -> SizingResult:
    """Return the sizes of a machine's parts, the configuration with these sizes, and the active constraints.

    Parameters
    ----------
    machine, settings, config
        As in `simulate`.
    limits, objective, tolerance
        As in `mech_twin.studies.size`.
    """
    from mech_twin.studies import size as sized

    known = machine_parameters(machine, _path(config), settings)
    return SizingResult(**vars(sized(machine, known, limits=limits, objective=objective, tolerance=tolerance)))


@raising_interrupt()
def search(
    machine: str,
    objectives: Sequence[str] = (),
    settings: Settings | None = None,
    *,
    config: FilePath | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    limits: Mapping[str, float] | None = None,
    seed: int = 1,
    points: int = 9,
) -> list[Design]:
    """Return a machine's best design for one objective, or the Pareto front of several.

    Parameters
    ----------
    machine, settings, config
        As in `simulate`.
    objectives, bounds, limits, seed, points
        As in `mech_twin.studies.search`.
    """
    from mech_twin.studies import search as searched

    known = machine_parameters(machine, _path(config), settings)
    return searched(machine, objectives, parameters=known, bounds=bounds, limits=limits, seed=seed, points=points)


@raising_interrupt()
def identify(
    machine: str,
    runs: Sequence[FilePath],
    given_map: FilePath,
    free: Sequence[str] | Mapping[str, tuple[float, float]] = (),
    settings: Settings | None = None,
    *,
    config: FilePath | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    held_out: Sequence[FilePath] = (),
    share: float = 0.2,
    latest_begin_s: float | None = None,
    seed: int = 0,
    cores: int | None = None,
    scheduler: str | None = None,
) -> SavedIdentification:
    """Return configuration keys identified by fitting the simulated motion of the machine to measured runs.

    Parameters
    ----------
    machine, settings, config
        As in `simulate`; the configuration to start from.
    runs : sequence of path
        Bags or tables to fit.
    given_map : path
        Measurement map that assigns their channels.
    free : sequence or mapping
        Keys that may change, or keys with their least and largest value; if empty, those marked as assumed in the
        configuration.
    priors : mapping, optional
        Mean and standard deviation of keys known from other sources.
    held_out : sequence of path
        Runs that are not fitted, and score the fit.
    share : float
        Share at the end of each run that is not fitted and scores the fit, if no run is held out.
    latest_begin_s : float, optional
        The runs begin at an unknown time of the simulated run, at this one (s) at the latest; at its start if absent.
    seed, cores
        Random seed of further starts of the fit; number of threads.
    scheduler : str, optional
        Address of a Dask scheduler that distributes further starts and profiles.

    Returns
    -------
    SavedIdentification
        With ``table``, ``plot()`` and ``save(directory)``; ``better`` is whether it is worth saving.

    Warns
    -----
    UserWarning
        What contradicts that a run is one of the machine.

    Raises
    ------
    ConfigurationError, MeasurementError, StudyError
        One line with file, key or channel, and what was expected.
    """
    from mech_twin.capabilities.arguments import bounds_by_name
    from mech_twin.measurements.model_turn import model_turn
    from mech_twin.results.opened_runs import checked_run
    from mech_twin.results.opened_runs import given_map as read_given
    from mech_twin.studies.identification.fit_runs import FitRun, fit_run
    from mech_twin.studies.identification.identification import identified
    from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion, assumed_keys
    from mech_twin.studies.identification.written_identification import SavedIdentification
    from mech_twin.studies.spreading import used_cores

    built = built_machine(machine, _path(config), settings)
    runs = sequence_items("runs", runs, "a list of paths")
    held_out = sequence_items("held_out", held_out, "a list of paths")
    sequence_items("free", free, "a list of keys, or keys with their bounds")
    map_file = _file("given_map", given_map)
    channels, turn = read_given(map_file, built), model_turn(built)

    def read(path: FilePath) -> FitRun:
        run, problems = checked_run(Path(path), channels, built, turn)
        for problem in problems:
            warnings.warn(problem, stacklevel=3)
        return fit_run(run, begin_known=latest_begin_s is None)

    keys = tuple(free) or assumed_keys(machine, built.parameters, _path(config))
    bounds = bounds_by_name("free", free if isinstance(free, Mapping) else {}, "keys with their bounds")
    known = bounds_by_name("priors", priors, "mean and standard deviation by key")
    begin_s = real_number("latest_begin_s", latest_begin_s or 0.0, "seconds, 0 or more", 0.0)
    share = real_number("share", share, "0 to less than 1, a part of each run", 0.0, 1.0 - 1e-9)
    seed = whole_number("seed", seed, 0, GREATEST_SEED)
    searched = (begin_s, seed, None if cores is None else used_cores(cores), scheduler)
    question = IdentificationQuestion(machine, built.parameters, keys, bounds, known, *searched)
    found = identified(question, list(map(read, runs)), list(map(read, held_out)), 0.0 if held_out else share)
    return SavedIdentification(found, tuple(map(Path, runs)), tuple(map(Path, held_out)), map_file)


def reproduce(
    machine: str | None = None, settings: Settings | None = None, *, config: FilePath | None = None
) -> tuple[PublishedRow, ...]:
    """Return every published number with the computed one: of all machines, or of one with these settings."""
    from mech_twin.studies import reproduce as reproduced

    if machine is None:
        if settings or config is not None:
            raise StudyError("settings and config need the name of a machine")
        return reproduced()
    return reproduced(machine, machine_parameters(machine, _path(config), settings))


def from_json(document: FilePath) -> Any:
    """Return the ``--json`` output of a command as an object.

    Parameters
    ----------
    document : path
        File with the output of any command.  The result is what the Python function returns, else an object with the
        keys as attributes (`mech_twin.results.printed_documents`).  Columns of `simulate` need ``--samples``, those of
        ``study designs`` the file of ``--out``; `identify` is without its runs.

    Raises
    ------
    StudyError, ConfigurationError
        The file cannot be read, or is not the output of a command.
    """
    from mech_twin.results.written_documents import from_document

    path = _file("document", document)
    try:
        return from_document(path.read_text(encoding="utf-8"), str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: cannot be read ({error})") from error


def compare(first: Run, second: Run, tolerance: float = 0.0) -> RunComparison:
    """Return the comparison of two runs of one machine: settings and numbers that differ.

    Parameters
    ----------
    first, second : Run
        Runs as `simulate` returns them.
    tolerance : float
        Relative difference up to which two numbers count as equal.

    Examples
    --------
    >>> soft = simulate("compaction_press", 0.01)
    >>> stiff = simulate("compaction_press", 0.01, {"linkage.crank_m": 0.05})
    >>> [setting.name for setting in compare(soft, stiff).found.settings]
    ['linkage.crank_m']
    """
    from mech_twin.studies.run_comparison import compared

    for run in (first, second):
        if not isinstance(run, Run):
            raise StudyError(f"{run!r:.80}: expected two runs as `simulate` returns them")
    sides = (first.named("first"), second.named("second"))
    return RunComparison(compared(*sides, tolerance), sides)


def _path(config: Any) -> Path | None:
    return None if config is None else _file("config", config)


def _file(name: str, path: Any) -> Path:
    if not isinstance(path, str | PathLike):
        raise StudyError(f"{name} {path!r:.80}: expected the path of a file")
    return Path(path)

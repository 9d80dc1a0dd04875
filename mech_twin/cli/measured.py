# SPDX-License-Identifier: Apache-2.0
"""A measurement: its map (``mech-twin map``), what its data are worth (``info --map``), its forces and its motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import compress
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mech_twin.cli.console import (
    FOUND,
    CommandError,
    print_json,
    print_table,
    progress,
    rounded,
    say,
    say_result,
    write_text,
)
from mech_twin.cli.measurement_verbs import MapVerb
from mech_twin.cli.verbs import InfoVerb, ReplayVerb
from mech_twin.engine.trajectory import StepSamples
from mech_twin.errors import MeasurementError
from mech_twin.measurements.crank_motion import CrankMotion, crank_motion
from mech_twin.measurements.measurement_map import MeasurementMap, Source, TimeSource
from mech_twin.measurements.model_turn import ModelTurn, following, model_turn
from mech_twin.measurements.plausibility import implausible, pairs_with_crank
from mech_twin.measurements.proposal import UNSURE, ProposedChannel, map_of, map_text, proposed_channels, unknown_unit
from mech_twin.measurements.quality import Quality
from mech_twin.measurements.runs import MeasuredRun, channel_qualities, read_run
from mech_twin.measurements.units import machine_columns, shown_units
from mech_twin.parameters.load import machine as built_machine
from mech_twin.process.interruption import StopSignal
from mech_twin.results.opened_runs import checked_run, configured_map, given_map, opened_run
from mech_twin.roles import Machine, own_name
from mech_twin.samples import Drawing
from mech_twin.studies.measured_forces import Compared, guided_samples, measured_forces

if TYPE_CHECKING:
    from mech_twin.view.bench.scene import BenchScene
    from mech_twin.view.rerun_scene import RerunScene

TRUSTED = 0.9  # correlation from which the sign is believed
MOST_SAMPLES = 2_000_000  # of a run that is compared with the model
NOT_COMPARED = f"more than {MOST_SAMPLES} samples, not compared with the model"


@dataclass(frozen=True)
class Proposal:
    """A map proposed for runs of one kind, as text and as it is read; the quality of each run, and contradictions."""

    text: str
    known: MeasurementMap
    qualities: dict[Path, tuple[Quality, ...]]
    problems: list[str]


def propose_map(request: MapVerb) -> None:
    """Write the proposed map to a file or to standard output, and the table of data quality after it."""
    measurements, out = request.measurements, request.out
    found = proposal(measurements, built_machine(request.machine, request.config))
    if out is not None:
        write_text(out, found.text, force=request.force)
    elif not request.as_json:
        say_result(found.text)
    if request.as_json:
        channels = [quality_record(found.known, qualities) for qualities in found.qualities.values()]
        runs = [{"measurement": p, "channels": c} for p, c in zip(measurements, channels, strict=True)]
        head = {"measurement": measurements[0], "machine": request.machine, "map": found.text}
        print_json({**head, "problems": found.problems, "channels": channels[0], "runs": runs})
        return
    for path, qualities in found.qualities.items():
        show_quality(path, found.known, qualities)
    say(*found.problems)


def proposal(measurements: Sequence[Path], built: Machine) -> Proposal:
    """Return the map of runs that have the same channels: names, units and signs from the first."""
    columns, name = machine_columns(built), own_name(built.name, built.parameters)
    with opened_run(measurements[0]) as reader:
        offered, time = reader.offered(), reader.proposed_time()
    empty: list[ProposedChannel] = []
    while True:
        left_out = {each.source for each in empty}
        channels = proposed_channels([each for each in offered if each.source not in left_out], columns)
        proposed = map_of(built.name, time, channels)
        if proposed is None and empty:
            raise CommandError(f"{measurements[0]}: no channel of {name} holds a number; expected a motion")
        if proposed is None:
            names = ", ".join(repr(each.source.label) for each in offered[:12]) or "none"
            none = f"none of its channels has a name of {name}; they are {names}"
            raise NoNameError(f"{measurements[0]}: {none}; write the map by hand")
        qualities = {path: _qualities(path, proposed) for path in measurements}
        ends = _ends(proposed, list(qualities.values()))
        if time.stamps == "header" and any(each.unstamped for found in qualities.values() for each in found):
            time = TimeSource(stamps="log")
        elif found := [each for each in channels if each.source in ends and not any(map(isfinite, ends[each.source]))]:
            empty += [replace(each, surety=UNSURE, reason="without a number") for each in found]
        else:
            break
    run, problems = None, [f"{measurements[0]}: {NOT_COMPARED}"]
    if sum(quality.samples for quality in qualities[measurements[0]]) <= MOST_SAMPLES:
        try:
            with opened_run(measurements[0]) as reader:
                run, problems = read_run(reader, proposed), []
        except MeasurementError as error:
            problems = [str(error)]
    turn = None if run is None else model_turn(built)
    notes: dict[str, str] = {}
    if run is not None and turn is not None:
        channels, notes = _signed(channels, run, turn)
        problems += implausible(_with_signs(run, channels), turn, columns)
    runs = measurements if len(measurements) > 1 else ()
    zero = {source for source, each in ends.items() if not any(each)}  # such a channel tells nothing of the machine
    channels = [replace(c, surety=UNSURE, reason="constant at 0") if c.source in zero else c for c in channels]
    known = map_of(built.name, time, channels)
    if known is None:
        raise CommandError(f"{measurements[0]}: every channel of {name} is constant at 0; expected a motion")
    for each in channels:
        if each.surety > UNSURE and (unknown := unknown_unit(each)):
            problems.append(f"{each.source.label}: its unit {unknown}; {columns[each.column]} is assumed: give a gain")
    kept = {channel.source for channel in known.channels}
    chosen = [channel.source in kept for channel in proposed.channels]
    qualities = {path: tuple(compress(each, chosen)) for path, each in qualities.items()}
    text = map_text(built.name, time, [*channels, *empty], notes, columns, runs, [each.source for each in offered])
    return Proposal(text, known, qualities, problems)


def runs_of_map(map_file: Path | None, built: Machine, otherwise: str = "a bag or a table") -> list[Path]:
    """Return the runs that a map names, for a command line that names none; raise where there is none either."""
    named = () if map_file is None else given_map(map_file, built).runs
    if not named:
        raise CommandError(f"expected at least one run, {otherwise}; or `runs` in the map")
    return [Path(run) for run in named]


def _qualities(path: Path, given: MeasurementMap) -> tuple[Quality, ...]:
    with opened_run(path) as reader:
        return tuple(channel_qualities(reader, given))


def _ends(proposed: MeasurementMap, runs: Sequence[Sequence[Quality]]) -> dict[Source, list[float]]:
    """Return the least and greatest value of each channel of a map in each run."""
    ends = ([end for each in found for end in (each.low, each.high)] for found in zip(*runs, strict=True))
    return {channel.source: each for channel, each in zip(proposed.channels, ends, strict=True)}


class NoNameError(CommandError):
    """No channel of a measurement has a name of the machine."""


def _signed(
    channels: list[ProposedChannel], run: MeasuredRun, turn: ModelTurn
) -> tuple[list[ProposedChannel], dict[str, str]]:
    """Return the channels with the signs that follow the model best, and what was found for each."""
    notes, signs = {}, {}
    for pair in pairs_with_crank(run, turn):
        found = following(turn, pair.channel.name, pair.crank_rad, pair.values)
        label = pair.channel.channel.source.label
        notes[label] = f"correlation {found.correlation:.3f} with the model, crank zero {found.crank_zero_rad:.3g} rad"
        if found.correlation >= TRUSTED:
            signs[label] = found.sign
    return [
        replace(each, sign=signs.get(each.source.label, 1)) if each.surety > UNSURE else each for each in channels
    ], notes


def _with_signs(run: MeasuredRun, channels: Sequence[ProposedChannel]) -> MeasuredRun:
    """Return the run, read without signs, as the proposed map reads it."""
    turned = {each.source.label for each in channels if each.sign < 0}
    signs = [-1.0 if each.channel.source.label in turned else 1.0 for each in run.channels]
    read = [replace(each, values=sign * each.values) for each, sign in zip(run.channels, signs, strict=True)]
    return replace(run, channels=tuple(read))


QUALITY_HEADS = (
    *("channel", "unit", "samples", "rate, Hz", "jitter, ms", "gaps", "repeats", "back", "drift, ppm"),
    *("quantum", "saturated, %", "NaN", "noise", "low", "high"),
)
WIDE = 180  # columns of the table of data quality where no terminal says


def quality_record(given: MeasurementMap, qualities: Sequence[Quality]) -> list[dict[str, Any]]:
    """Return the quality of each channel as JSON objects."""
    heads = [
        {"source": each.source.model_dump(exclude_none=True), "is": each.quantity, "unit": each.unit}
        for each in given.channels
    ]
    pairs = zip(heads, qualities, strict=True)
    return [{**head, **quality._asdict(), "flaws": quality.flaws()} for head, quality in pairs]


def show_quality(path: Path, given: MeasurementMap, qualities: Sequence[Quality]) -> None:
    """Print the table of data quality, one row a channel in its own unit, and each flaw in words."""
    rows = []
    for channel, q in zip(given.channels, qualities, strict=True):
        timing = (rounded(q.rate_hz), rounded(round(1e3 * q.jitter_s, 6)), q.gaps, q.repeats, q.back)
        worth = map(rounded, (1e6 * q.drift, q.quantum, 100.0 * q.saturated))
        ends = map(rounded, (q.noise, q.low, q.high))
        rows.append((channel.source.label, channel.unit or "SI", q.samples, *timing, *worth, q.nan, *ends))
    print_table(f"{path}: data quality", QUALITY_HEADS, rows, piped=WIDE)
    for channel, quality in zip(given.channels, qualities, strict=True):
        say(*(f"{channel.source.label}: {flaw}" for flaw in quality.flaws()))


def examine_by_file(request: InfoVerb, map_file: Path) -> None:
    """Print quality and contradictions of one run; exit code 1 where something contradicts the map."""
    path, given = request.bag, configured_map(map_file, request.config)
    with opened_run(path) as reader:
        qualities = channel_qualities(reader, given)
    problems: list[str] = []
    if sum(quality.samples for quality in qualities) > MOST_SAMPLES:
        say(f"{path}: {NOT_COMPARED}")
    else:
        machine = built_machine(given.machine, request.config)
        try:
            _, problems = checked_run(path, given, machine, model_turn(machine))
        except MeasurementError as error:
            problems = [str(error)]
    if request.as_json:
        document = {"measurement": path, "machine": given.machine}
        print_json({**document, "channels": quality_record(given, qualities), "problems": problems})
    else:
        show_quality(path, given, qualities)
        say(*problems)
    if problems:
        raise SystemExit(FOUND)


class MeasuredMotion(NamedTuple):
    """A measured run, the machine it is of, and the motion of its crank."""

    run: MeasuredRun
    machine: Machine
    turn: ModelTurn
    motion: CrankMotion


def read_measured(measurement: Path, map_file: Path, config: Path | None) -> MeasuredMotion:
    """Return a measured run by its map; what contradicts the machine is said on standard error."""
    given = configured_map(map_file, config)
    machine = built_machine(given.machine, config)
    turn = model_turn(machine)
    if turn is None:
        raise CommandError(f"{map_file}: {given.machine} has no crank; expected a machine whose state follows from one")
    run, problems = checked_run(measurement, given, machine, turn)
    say(*problems)
    return MeasuredMotion(run, machine, turn, crank_motion(run, turn))


def analyse_measured(request: ReplayVerb, map_file: Path) -> None:
    """Print the largest forces of a measured motion, and every other channel beside the model in the same motion.

    With a tolerance, exit code 1 where a channel is off by more than that share of its own size.
    """
    measurement, tolerance = request.bag, request.tolerance
    read = read_measured(measurement, map_file, request.config)
    samples = guided_samples(read.machine, read.motion, read.run)
    with progress(samples, len(read.motion.times_s), "analysing") as counted:
        found = measured_forces(iter(counted), read.run, read.turn.crank)
    if request.as_json:
        head = {"measurement": measurement, "machine": read.machine.name, "samples": found.samples}
        compared = [{**asdict(each), "share": each.share} for each in found.compared]
        head |= {"crank_zero_rad": read.motion.zero_rad, "largest": found.largest}
        print_json({**head, "compared": compared, "left_out": found.left_out})
    else:
        units = shown_units(read.machine)
        largest = [(name, value, units[name]) for name, value in found.largest.items()]
        print_table(f"{measurement}: largest forces in {found.samples} samples", ("quantity", "value", "unit"), largest)
        _show_compared(found.compared, units)
    for why, names in found.left_out.items():
        say(f"{measurement}: not compared: {', '.join(names)}; {why}")
    if tolerance is not None and not found.compared:
        say(f"{measurement}: nothing compared; expected a channel beside the crank")
        raise SystemExit(FOUND)
    outside = [each for each in found.compared if tolerance is not None and not each.share <= tolerance]
    for each in outside:
        say(f"{measurement}: {each.name} is off by {each.share:.3g} of its size, expected at most {tolerance:g}")
    if outside:
        raise SystemExit(FOUND)


def _show_compared(compared: Sequence[Compared], units: Mapping[str, str]) -> None:
    heads = ("channel", "samples", "rms off", "unit", "share", "correlation", "found")
    shown = len(heads) if any(each.found for each in compared) else -1
    rows = []
    for e in compared:
        found = ", ".join(f"{name} {rounded(number)}" for name, number in e.found.items())
        rows.append((e.name, e.samples, e.rms, units[e.name], e.share, e.correlation, found))
    if rows:
        print_table("measured, beside the model in the same motion", heads[:shown], [row[:shown] for row in rows])


def show_measured(scene: BenchScene | RerunScene, read: MeasuredMotion, stop: StopSignal) -> None:
    """Draw the mechanism in the measured motion, with its forces."""
    if read.machine.mechanism is not None:
        scene.know(read.machine.mechanism, read.machine.blow_energy)
    samples = guided_samples(read.machine, read.motion, read.run)
    with progress(samples, len(read.motion.times_s), "showing") as shown:
        for linkage, forces in shown:
            if stop.asked:
                return
            scene.frame(StepSamples(linkage.step, linkage=linkage, forces=forces))
            if scene.drawing_due(linkage.time_s):
                scene.drawing(Drawing(linkage.step, linkage.time_s, read.machine.draw(linkage, None)))

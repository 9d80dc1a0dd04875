# SPDX-License-Identifier: Apache-2.0
"""A measurement: the map proposed for it (``mech-twin map``), what its data are worth, what contradicts the machine."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_json, print_table, say, say_result, write_text
from mech_twin.cli.failure import FOUND, CommandError
from mech_twin.cli.measurement_verbs import MapVerb
from mech_twin.files.output_file import YAML_SUFFIXES, check_output_file
from mech_twin.measurements.blocks import RunReader
from mech_twin.measurements.errors import MeasurementError
from mech_twin.measurements.machine_columns import machine_columns
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.model_turn import ModelTurn, following, model_turn, turning_column
from mech_twin.measurements.plausibility import implausible, pairs_with_crank
from mech_twin.measurements.proposal import UNSURE, ProposedChannel, map_of, map_text, proposed_channels
from mech_twin.measurements.quality import Quality
from mech_twin.measurements.runs import MeasuredRun, channel_qualities, read_run
from mech_twin.parameters.load import machine as built_machine
from mech_twin.results.opened_runs import configured_map, opened_run
from mech_twin.roles import Machine

TRUSTED = 0.9  # correlation from which the sign is believed
MOST_SAMPLES = 2_000_000  # of a run that is compared with the model


@dataclass(frozen=True)
class Proposal:
    """A map proposed for runs of one kind, as text and as it is read; the quality of each run, and contradictions."""

    text: str
    known: MeasurementMap
    qualities: dict[Path, tuple[Quality, ...]]
    problems: list[str]


def propose_map(asked: MapVerb) -> None:
    """Write the proposed map to a file or to standard output, and the table of data quality after it."""
    measurements, machine, out = asked.measurements, asked.machine, asked.out
    if out is not None:
        check_output_file(out, force=asked.force, suffixes=YAML_SUFFIXES)
    found = proposal(measurements, built_machine(machine, asked.config))
    _write(found.text, out, asked.force, quiet=asked.as_json)
    if asked.as_json:
        record: dict[str, Any] = {"measurement": measurements[0], "machine": machine, "map": found.text}
        channels = [quality_record(found.known, qualities) for qualities in found.qualities.values()]
        runs = [{"measurement": p, "channels": c} for p, c in zip(measurements, channels, strict=True)]
        print_json({**record, "problems": found.problems, "channels": channels[0], "runs": runs})
        return
    for path, qualities in found.qualities.items():
        show_quality(path, found.known, qualities)
    for problem in found.problems:
        say(problem)


def proposal(measurements: Sequence[Path], built: Machine) -> Proposal:
    """Return the map of runs that have the same channels: names, units and signs from the first.

    Raises
    ------
    CommandError
        None of the channels has a name of the machine, or a further run has not those that the first is mapped by.
    """
    columns = machine_columns(built)
    with opened_run(measurements[0]) as reader:
        offered, time = reader.offered(), reader.proposed_time()
        channels = proposed_channels(offered, columns)
        proposed = map_of(built.name, time, channels)
        if proposed is None:
            names = ", ".join(repr(each.source.label) for each in offered[:12]) or "none"
            raise NoNameError(
                f"{measurements[0]}: none of its channels has a name of {built.name}; they are {names}; "
                "write the map by hand"
            )
        qualities = {measurements[0]: tuple(channel_qualities(reader, proposed))}
        run, problems = _measured(reader, proposed, qualities[measurements[0]])
    turn = model_turn(built) if turning_column(columns) and run is not None else None
    notes: dict[str, str] = {}
    if run is not None and turn is not None:
        channels, notes = _signed(channels, run, turn)
        problems += implausible(_with_signs(run, channels), turn, columns)
    for path in measurements[1:]:
        with opened_run(path) as reader:
            qualities[path] = tuple(channel_qualities(reader, proposed))
    runs = measurements if len(measurements) > 1 else ()
    known = map_of(built.name, time, channels)
    assert known is not None
    return Proposal(map_text(built.name, time, channels, notes, columns, runs), known, qualities, problems)


class NoNameError(CommandError):
    """No channel of a measurement has a name of the machine."""


def _measured(
    reader: RunReader, proposed: MeasurementMap, qualities: Sequence[Quality]
) -> tuple[MeasuredRun | None, list[str]]:
    if sum(quality.samples for quality in qualities) > MOST_SAMPLES:
        return None, [f"{reader.path}: more than {MOST_SAMPLES} samples, not compared with the model"]
    try:
        return read_run(reader, proposed), []
    except MeasurementError as error:
        return None, [str(error)]


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
    return replace(
        run,
        channels=tuple(
            replace(each, values=-each.values) if each.channel.source.label in turned else each for each in run.channels
        ),
    )


def _write(text: str, out: Path | None, force: bool, *, quiet: bool) -> None:
    if out is None:
        if not quiet:
            say_result(text)
        return
    write_text(out, text, force=force)
    say(f"written to {out}")


QUALITY_HEADS = (
    *("channel", "unit", "samples", "rate, Hz", "jitter, ms", "gaps", "repeats", "back", "drift, ppm"),
    *("quantum", "saturated, %", "NaN", "noise", "low", "high"),
)
WIDE = 180  # columns of the table of data quality where no terminal says
CHECKED_SAMPLES = 2_000_000  # of a run that is held against the model


def checked_run(
    reader: RunReader, given: MeasurementMap, turn: ModelTurn | None, machine: Machine
) -> tuple[MeasuredRun, list[str]]:
    """Return a run, and what contradicts that it is one of the machine."""
    run = read_run(reader, given)
    return run, implausible(run, turn, machine_columns(machine))


def quality_record(given: MeasurementMap, qualities: Sequence[Quality]) -> list[dict[str, Any]]:
    """Return the quality of each channel as JSON objects."""
    return [
        {
            "source": channel.source.model_dump(exclude_none=True),
            "is": channel.quantity,
            "unit": channel.unit,
            **quality._asdict(),
            "flaws": quality.flaws(),
        }
        for channel, quality in zip(given.channels, qualities, strict=True)
    ]


def show_quality(path: Path, given: MeasurementMap, qualities: Sequence[Quality]) -> None:
    """Print the table of data quality, one row a channel in its own unit, and each flaw in words."""
    rows = []
    for channel, quality in zip(given.channels, qualities, strict=True):
        timing = (
            _rounded(quality.rate_hz),
            _rounded(round(1e3 * quality.jitter_s, 6)),
            quality.gaps,
            quality.repeats,
            quality.back,
        )
        worth = (1e6 * quality.drift, quality.quantum, 100.0 * quality.saturated)
        ends = (quality.noise, quality.low, quality.high)
        numbers = (quality.samples, *timing, *map(_rounded, worth), quality.nan, *map(_rounded, ends))
        rows.append((channel.source.label, channel.unit or "SI", *numbers))
    print_table(f"{path}: data quality", QUALITY_HEADS, rows, None if sys.stdout.isatty() else WIDE)
    for channel, quality in zip(given.channels, qualities, strict=True):
        for flaw in quality.flaws():
            say(f"{channel.source.label}: {flaw}")


def _rounded(value: float) -> str:
    return f"{value:.4g}"


def examine_by_file(path: Path, map_file: Path, config: Path | None, *, as_json: bool) -> None:
    """Print quality and contradictions of one run; exit code 1 where something contradicts the map."""
    given = configured_map(map_file, config)
    with opened_run(path) as reader:
        qualities = channel_qualities(reader, given)
    problems: list[str] = []
    if sum(quality.samples for quality in qualities) <= CHECKED_SAMPLES:
        problems = _contradictions(path, given, built_machine(given.machine, config))
    if as_json:
        document = {"measurement": path, "machine": given.machine}
        print_json({**document, "channels": quality_record(given, qualities), "problems": problems})
    else:
        show_quality(path, given, qualities)
        for problem in problems:
            say(problem)
    if problems:
        raise SystemExit(FOUND)


def _contradictions(path: Path, given: MeasurementMap, machine: Machine) -> list[str]:
    from mech_twin.measurements.errors import MeasurementError

    try:
        with opened_run(path) as reader:
            _, problems = checked_run(reader, given, model_turn(machine), machine)
    except MeasurementError as error:
        return [str(error)]
    return [f"{path}: {problem}" for problem in problems]

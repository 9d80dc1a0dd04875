# SPDX-License-Identifier: Apache-2.0
"""``mech-twin map``: which channel of a measurement is which column of a machine, and what the data are worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mech_twin.cli.console import print_json, say, say_result
from mech_twin.cli.failure import CommandError
from mech_twin.cli.measurement import quality_record, show_quality
from mech_twin.measurements.blocks import RunReader
from mech_twin.measurements.errors import MeasurementError
from mech_twin.measurements.machine_columns import machine_columns
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.model_turn import ModelTurn, following, model_turn, turning_column
from mech_twin.measurements.plausibility import implausible, pairs_with_crank
from mech_twin.measurements.proposal import UNSURE, ProposedChannel, map_of, map_text, proposed_channels
from mech_twin.measurements.quality import Quality
from mech_twin.measurements.runs import MeasuredRun, channel_qualities, read_run
from mech_twin.nodes.opened_runs import opened_run
from mech_twin.output_file import YAML_SUFFIXES, check_output_file, written_file
from mech_twin.parameters.load import machine as built_machine

TRUSTED = 0.9  # correlation from which the sign is believed
MOST_SAMPLES = 2_000_000  # of a run that is compared with the model


def propose_map(
    measurement: Path, machine: str, config: Path | None, out: Path | None, *, force: bool, as_json: bool
) -> None:
    """Write the proposed map to a file or to standard output, and the table of data quality after it."""
    if out is not None:
        check_output_file(out, force=force, suffixes=YAML_SUFFIXES)
    built = built_machine(machine, config)
    columns = machine_columns(built)
    with opened_run(measurement) as reader:
        offered, time = reader.offered(), reader.proposed_time()
        channels = proposed_channels(offered, columns)
        proposed = map_of(machine, time, channels)
        if proposed is None:
            names = ", ".join(repr(each.source.label) for each in offered[:12]) or "none"
            raise CommandError(
                f"{measurement}: none of its channels has a name of {machine}; they are {names}; write the map by hand"
            )
        qualities = channel_qualities(reader, proposed)
        run, problems = _measured(reader, proposed, qualities)
    turn = model_turn(built) if turning_column(columns) and run is not None else None
    notes: dict[str, str] = {}
    if run is not None and turn is not None:
        channels, notes = _signed(channels, run, turn)
        problems += implausible(_with_signs(run, channels), turn, columns)
    text = map_text(machine, time, channels, notes, columns)
    _write(text, out, force, quiet=as_json)
    if as_json:
        record = {"measurement": str(measurement), "machine": machine, "map": text, "problems": problems}
        print_json({**record, "channels": quality_record(proposed, qualities)})
        return
    show_quality(measurement, proposed, qualities)
    for problem in problems:
        say(problem)


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
    with written_file(out, force=force) as file:
        file.write_text(text, encoding="utf-8")
    say(f"written to {out}")

# SPDX-License-Identifier: Apache-2.0
"""Measurements of the command line: bags and tables opened alike, maps read, data quality shown."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mech_twin.cli.console import print_json, print_table, say
from mech_twin.measurements.blocks import RunReader
from mech_twin.measurements.machine_columns import machine_columns
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.model_turn import ModelTurn, model_turn
from mech_twin.measurements.plausibility import implausible
from mech_twin.measurements.quality import Quality
from mech_twin.measurements.runs import MeasuredRun, channel_qualities, read_run
from mech_twin.parameters.load import machine as built_machine
from mech_twin.results.opened_runs import columns_of, configured_map, opened_run, topic_field
from mech_twin.roles import Machine

if TYPE_CHECKING:
    pass

__all__ = [
    "checked_run",
    "columns_of",
    "configured_map",
    "examine_by_file",
    "opened_run",
    "quality_record",
]
__all__ += ["show_quality", "topic_field"]
QUALITY_HEADS = (
    *("channel", "unit", "samples", "rate, Hz", "jitter, ms", "gaps", "repeats", "back", "drift, ppm"),
    *("quantum", "saturated, %", "NaN", "noise", "low", "high"),
)
WIDE = 180  # columns of the table of data quality where no terminal says
CONTRADICTED = 1  # exit code
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
        document = {"measurement": str(path), "machine": given.machine}
        print_json({**document, "channels": quality_record(given, qualities), "problems": problems})
    else:
        show_quality(path, given, qualities)
        for problem in problems:
            say(problem)
    if problems:
        raise SystemExit(CONTRADICTED)


def _contradictions(path: Path, given: MeasurementMap, machine: Machine) -> list[str]:
    from mech_twin.measurements.errors import MeasurementError

    try:
        with opened_run(path) as reader:
            _, problems = checked_run(reader, given, model_turn(machine), machine)
    except MeasurementError as error:
        return [str(error)]
    return [f"{path}: {problem}" for problem in problems]

# SPDX-License-Identifier: Apache-2.0
"""``mech-twin identify`` from positions of something that bounces: the restitution, whatever unit they are in."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

from mech_twin.cli.console import print_json, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.identify_request import IdentifyRequest
from mech_twin.files.output_file import check_output_file, written_file
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.errors import MeasurementError
from mech_twin.parameters.load import assignments, description_text, machine_parameters
from mech_twin.results.opened_runs import opened_run
from mech_twin.studies.identification.bounces import Bounces, bounces, restitution
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration
from mech_twin.studies.identification.verdicts import IDENTIFIED, NOT_EXCITED, WIDEST, KeyVerdict

KEY = "restitution"


def identify_bounces(asked: IdentifyRequest) -> None:
    """Find the restitution from the bounces that the runs show; write the configuration with it."""
    began = time.monotonic()
    if asked.out is not None:
        check_output_file(asked.out, force=asked.force)
    keyed = KeyedConfiguration(
        asked.machine, machine_parameters(asked.machine, asked.config, assignments(asked.settings)), (KEY,)
    )
    (before,) = keyed.values().tolist()
    runs, problems = [], []
    for path in asked.runs:
        try:
            runs.append(bounces(path, *_columns(path)))
        except MeasurementError as error:
            problems.append(str(error))
    for problem in problems:
        say(f"{problem}; left out")
    if not runs:
        raise CommandError(f"{asked.machine}: none of the runs shows bounces; expected positions, or --map FILE")
    found = restitution(runs)
    low, high = found.value - found.half_width, found.value + found.half_width
    narrow = found.half_width <= WIDEST * found.value
    reason = "flights between bounces shorten by it" if narrow else "the runs leave it open by more than half of itself"
    verdict = IDENTIFIED if narrow else NOT_EXCITED
    key = KeyVerdict(KEY, before, found.value, found.standard_error, low, high, verdict, reason)
    _show(asked, key, runs, found.used, time.monotonic() - began)
    if asked.out is not None and narrow:
        names = ", ".join(path.name for path in found.used)
        note = f"# {KEY}: identified {found.value:.6g} +- {found.half_width:.2g} (95 %) from {names}\n"
        with written_file(asked.out, force=asked.force) as file:
            file.write_text(note + description_text(asked.machine, keyed.parameters([found.value])), encoding="utf-8")
        say(f"written to {asked.out}")


def _columns(path: Path) -> tuple[Array, dict[str, Array]]:
    """Return the times of a run, and its columns at all of them."""
    with opened_run(path) as reader:
        time_source, sources = reader.proposed_time(), [each.source for each in reader.offered()]
        times: list[list[Array]] = [[] for _ in sources]
        values: list[list[Array]] = [[] for _ in sources]
        for place, stamps, shown, _ in reader.blocks(sources, time_source):
            times[place].append(stamps)
            values[place].append(shown)
    whole = {
        source.label: (np.concatenate(stamps), np.concatenate(shown))
        for source, stamps, shown in zip(sources, times, values, strict=True)
        if stamps
    }
    if not whole:
        raise MeasurementError(path, "has no column beside its time")
    clock = max((stamps for stamps, _ in whole.values()), key=len)
    order = np.argsort(clock, kind="stable")
    return clock[order], {
        name: shown[order]
        for name, (stamps, shown) in whole.items()
        if len(stamps) == len(clock) and np.isfinite(shown).all()
    }


def _show(asked: IdentifyRequest, key: KeyVerdict, runs: list[Bounces], used: tuple[Path, ...], seconds: float) -> None:
    rows = [
        (str(run.path), run.column, run.found.value, run.found.standard_deviation, len(run.times_s), run.flaws)
        for run in runs
    ]
    if asked.as_json:
        names = ("run", "column", "restitution", "standard_deviation", "bounces", "flaws")
        record = {"machine": asked.machine, "parameters": [asdict(key)], "used": [str(path) for path in used]}
        print_json({**record, "runs": [dict(zip(names, row, strict=True)) for row in rows], "seconds": seconds})
        return
    print_table("bounces", ("run", "column", KEY, "s.d.", "bounces", "missed or false"), rows)
    heads = ("key", "before", "estimate", "95 % from", "to", "verdict")
    print_table(
        f"{asked.machine}: from {len(used)} of {len(asked.runs)} runs",
        heads,
        [(key.key, key.before, key.estimate, key.low_95, key.high_95, key.verdict)],
    )

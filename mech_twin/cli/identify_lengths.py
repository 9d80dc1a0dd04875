# SPDX-License-Identifier: Apache-2.0
"""``mech-twin identify`` in the measured motion of the crank: lengths from positions, with a held-out score."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_json, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.identify_request import NOT_BETTER, IdentifyRequest, split_runs
from mech_twin.files.output_file import check_output_file, written_file
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.model_turn import TURNING, model_turn
from mech_twin.measurements.runs import read_run
from mech_twin.parameters.load import assignments, description_text, machine_parameters
from mech_twin.parameters.load import machine as built_machine
from mech_twin.results.opened_runs import opened_run
from mech_twin.studies.identification.free_keys import AUTO
from mech_twin.studies.identification.geometry_fit import GeometryData, geometry_data
from mech_twin.studies.identification.geometry_model import GeometryModel
from mech_twin.studies.identification.geometry_report import GeometryReport, geometry_report


def identify_lengths(asked: IdentifyRequest) -> None:
    """Fit the free keys to the runs; write the configuration found, unless the run held out fits no better with it."""
    began = time.monotonic()
    if asked.out is not None:
        check_output_file(asked.out, force=asked.force)
    _refuse_unused(asked)
    if not asked.free:
        raise CommandError("--free: expected at least one key of the configuration, such as crank_m")
    if AUTO in asked.free:
        raise CommandError(
            f"--free {AUTO}: expected keys, or --motion simulated; the measured motion fits lengths alone"
        )
    given = asked.given_map
    base = machine_parameters(asked.machine, asked.config, assignments(asked.settings))
    model = GeometryModel(asked.machine, base, tuple(asked.free), _columns(asked, given))
    model.values()  # a key that is wrong is named before the runs are read
    fitted, held_out = split_runs(asked.runs, asked.held_out_run)
    runs = [_data(path, given, model) for path in fitted]
    report = geometry_report(model, runs, None if held_out is None else _data(held_out, given, model))
    _show(asked, report, held_out, time.monotonic() - began)
    if held_out is not None and not report.better:
        say(f"{held_out}: the run held out fits no better than before; no configuration is written")
        raise SystemExit(NOT_BETTER)
    if asked.out is not None:
        _write(asked, model, report, [str(path) for path in fitted])


def _refuse_unused(asked: IdentifyRequest) -> None:
    """Raise where something is asked that the fit of lengths in the measured motion does not know."""
    unused = {
        "--fix": asked.fixed,
        "--prior": asked.priors,
        "--scheduler": asked.scheduler,
        f"--hold-out {asked.hold_out}": asked.held_out_share is not None,
    }
    for option, given in unused.items():
        if given:
            raise CommandError(f"{option}: not used in the measured motion of the crank; expected --motion simulated")


def _columns(asked: IdentifyRequest, given: MeasurementMap) -> tuple[str, ...]:
    """Return the positions that the crank leads; channels that tell nothing of lengths are named."""
    turn = model_turn(built_machine(asked.machine, asked.config, assignments(asked.settings)))
    if turn is None:
        raise CommandError(f"{asked.machine}: expected a machine whose joints follow from a crank")
    names = [channel.quantity for channel in given.channels]
    used = tuple(name for name in names if name in turn.led and name.endswith(".position") and name not in TURNING)
    for name in dict.fromkeys(names):
        if name not in used and name not in TURNING:
            say(f"{name}: left out, it is no position that the crank leads")
    if not used:
        raise CommandError(f"{asked.map_file}: expected a position that the crank leads, beside the crank's")
    return used


def _data(path: Path, given: MeasurementMap, model: GeometryModel) -> GeometryData:
    with opened_run(path) as reader:
        return geometry_data(read_run(reader, given), model.columns)


def _show(asked: IdentifyRequest, report: GeometryReport, held_out: Path | None, seconds: float) -> None:
    if asked.as_json:
        document: dict[str, Any] = {
            "machine": asked.machine,
            "parameters": [asdict(each) for each in report.keys],
            "channels": [{"is": name, "fit_percent": fit} for name, fit in report.fit_percent.items()],
            "lags_s": list(report.lags_s),
            "held_out": None
            if held_out is None
            else {"run": str(held_out), "scores": [asdict(s) for s in report.held_out]},
            "seconds": seconds,
        }
        print_json(document)
        return
    heads = ("key", "before", "estimate", "95 % from", "to", "verdict")
    rows = [(k.key, k.before, k.estimate, k.low_95, k.high_95, k.verdict) for k in report.keys]
    print_table(f"{asked.machine}: lengths from measured positions", heads, rows)
    for key in report.keys:
        say(f"{key.key}: {key.verdict}, {key.reason}")
    scores = [(s.channel, s.fit_percent, s.before_percent, s.constant_percent) for s in report.held_out]
    if scores:
        print_table(f"fit of {held_out}, held out, percent", ("channel", "estimated", "before", "constant"), scores)


def _write(asked: IdentifyRequest, model: GeometryModel, report: GeometryReport, runs: Sequence[str]) -> None:
    """Write the configuration with the keys that were identified; the others are kept as they were."""
    assert asked.out is not None
    values = [key.estimate if key.verdict == "identified" else key.before for key in report.keys]
    notes = [
        f"# {key.key}: identified {key.estimate:.6g} +- {key.high_95 - key.estimate:.2g} (95 %) from {', '.join(runs)}"
        if key.verdict == "identified"
        else f"# {key.key}: kept, {key.verdict}: {key.reason}"
        for key in report.keys
    ]
    with written_file(asked.out, force=asked.force) as file:
        text = description_text(asked.machine, model.parameters(values))
        file.write_text("\n".join(notes) + "\n" + text, encoding="utf-8")
    say(f"written to {asked.out}")

# SPDX-License-Identifier: Apache-2.0
"""The file of a baseline: read, checked against what it was made for, and renewed with a yes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import typer
from pydantic import ValidationError

from mech_twin.cli.console import say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.measurement_verbs import MonitorVerb
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.input_file import opened_input
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import kind_of
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.monitoring.origin import OLD_DAYS, BaselineRun, configuration_hash, sensors_hash
from mech_twin.studies.monitoring.setup_record import LARGEST_BYTES, SetupRecord

SETUP_SUFFIX = ".json"


def baseline_file(baseline: Sequence[Path]) -> Path | None:
    """Return the file that `--save-baseline` wrote; None where runs were given, or nothing."""
    files = [path for path in baseline if path.suffix == SETUP_SUFFIX]
    if files and len(baseline) > 1:
        raise CommandError(f"--baseline {files[0]}: expected it alone, or runs; --renew takes runs into it")
    return files[0] if files else None


def read_setup(path: Path, machine: str, parameters: Parameters, given: MeasurementMap) -> MonitorSetup:
    """Return the reference of a monitor, as `--save-baseline` writes it, made for these numbers and sensors."""
    try:
        with opened_input(path) as stream:
            data = stream.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > LARGEST_BYTES:
        raise CommandError(f"{path}: larger than {LARGEST_BYTES} bytes; expected a baseline of --save-baseline")
    try:
        setup = SetupRecord.model_validate_json(data).setup()
    except ValidationError as error:
        raise refusal(f"{path}: expected a baseline as --save-baseline writes it", error) from error
    if setup.machine != kind_of(machine):
        raise CommandError(f"{path}: key 'machine', value {setup.machine!r}: expected {kind_of(machine)!r}")
    _check_origin(path, setup, parameters, given)
    return setup


def _check_origin(path: Path, setup: MonitorSetup, parameters: Parameters, given: MeasurementMap) -> None:
    """Raise where a baseline was made for other numbers or sensors; say how old it is."""
    origin = setup.origin
    if origin is None:
        say(f"{path}: does not tell its runs, configuration and age; expected a newer file of --save-baseline")
        return
    for what, made_for, here in (
        ("configuration", origin.configuration, configuration_hash(parameters)),
        ("map", origin.sensors, sensors_hash(given)),
    ):
        if made_for != here:
            raise CommandError(
                f"{path}: made with another {what} ({made_for[:12]}); expected that of this run ({here[:12]}), "
                "or a baseline made anew"
            )
    days = origin.age_days(datetime.now(UTC))
    old = f", older than {OLD_DAYS:g}: --renew takes healthy runs into it" if days > OLD_DAYS else ""
    say(f"{path}: of {len(origin.runs)} runs, {days:.0f} days old{old}")


def check_request(asked: MonitorVerb, file: Path | None) -> None:
    """Raise where what is asked of a baseline goes with another kind of one."""
    if asked.seed is not None and file is not None:
        raise CommandError(f"--seed {asked.seed}: {file} holds thresholds already; expected a run as --baseline")
    if asked.renew and file is None:
        raise CommandError("--renew: expected --baseline FILE.json, as --save-baseline wrote it")


def earlier_runs(path: Path, setup: MonitorSetup, new: Sequence[Path]) -> tuple[BaselineRun, ...]:
    """Return the runs that a baseline was made of, which are read again."""
    if setup.origin is None:
        raise CommandError(f"--renew: {path} does not tell its runs; expected a newer file of --save-baseline")
    known = [run.path for run in setup.origin.runs]
    for run in known:
        if not run.exists():
            raise CommandError(
                f"--renew: {path} was made of {run}, which is gone; expected it, or a baseline made anew"
            )
    for run in new:
        if run.absolute() in known:
            raise CommandError(f"--renew: {run} is in {path} already; expected another day")
    return setup.origin.runs


def agreed(path: Path, setup: MonitorSetup, runs: Sequence[str]) -> bool:
    """Return whether somebody at the terminal says yes; nobody there is a no."""
    if not sys.stdin.isatty():
        return False
    return typer.confirm(f"take {', '.join(runs)} as healthy into {path} ({setup.baseline.cycles} cycles)?", err=True)

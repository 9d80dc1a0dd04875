# SPDX-License-Identifier: Apache-2.0
"""``mech-twin fleet``: machines of one kind ranked, each against its own baseline and against its sisters."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

from mech_twin.capabilities.errors import StudyError
from mech_twin.cli.console import print_json, print_table, progress, say, write_text
from mech_twin.cli.failure import FOUND, CommandError
from mech_twin.cli.measurement_verbs import FleetVerb
from mech_twin.cli.monitor_baseline import ARL0_H, FeaturedRun, featured_run, read_setup, setup_of_runs, write_setup
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.report_page import page, section, versions
from mech_twin.measurements.errors import MeasurementError
from mech_twin.studies.monitoring.fleet import Fleet, FleetMember, Sister, fleet_of, judged_member
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.spreading import available_cores, spread

BASELINE = "baseline.json"
HEADS = ("rank", "machine", "verdict", "finding", "size", "unit", "began in", "at, s", "apart by", "feature", "cycles")


class _Question(NamedTuple):
    """What each machine is asked; it goes to other processes."""

    machine: str
    parameters: Parameters
    map_file: Path | None
    skip_s: float | None
    arl0_h: float
    healthy: int
    save: bool
    sister: MonitorSetup | None = None


def rank_fleet(asked: FleetVerb) -> None:
    """Judge each machine of a folder; exit with 1 where one is suspect, with 2 where one could not be judged."""
    begun_s = time.monotonic()
    folders = sorted(each for each in _listed(asked.folder) if each.is_dir())
    if not folders:
        raise CommandError(f"{asked.folder}: no folder in it; expected one for each machine, its recordings in it")
    parameters = asked.parameters
    arl0_h, kept = ARL0_H if asked.known_arl0_h is None else asked.known_arl0_h, asked.save_baselines
    question = _Question(asked.machine, parameters, asked.map_file, asked.skip_s, arl0_h, asked.healthy, kept)
    members, others, sister = list[FleetMember](), folders, None
    while others and sister is None:  # the first that can be judged: what its roll-outs tell serves the others
        (first, sister), others = _judged(question, others[0]), others[1:]
        members.append(first)
    task = partial(judged_folder, question._replace(sister=sister))
    results = spread(task, others, asked.cores or available_cores(), asked.scheduler)
    with progress(results, len(others), "fleet") as found:
        members += found
    fleet = fleet_of(sorted(members))
    _show(fleet, asked, time.monotonic() - begun_s)
    if any(sister.is_suspect for sister in fleet.sisters):
        raise SystemExit(FOUND)
    if fleet.refused:
        raise CommandError(f"{asked.folder}: {len(fleet.refused)} of {len(folders)} machines could not be judged")


def judged_folder(question: _Question, folder: Path) -> FleetMember:
    """Return what the baseline of a machine says of its recordings, or why it cannot."""
    return _judged(question, folder)[0]


def _judged(question: _Question, folder: Path) -> tuple[FleetMember, MonitorSetup | None]:
    try:
        setup, runs = _setup(question, folder, _runs(question, folder))
        return judged_member(folder.name, setup, {run.path.name: run.vectors for run in runs}), setup
    except (CommandError, MeasurementError, StudyError) as error:
        return FleetMember(folder.name, refused=str(error)), None


def _runs(question: _Question, folder: Path) -> list[FeaturedRun]:
    paths = sorted(each for each in _listed(folder) if each.name != BASELINE and not each.name.startswith("."))
    least = 1 if (folder / BASELINE).exists() else question.healthy + 1
    if len(paths) < least:
        expected = f"{BASELINE} and a recording, or {question.healthy} healthy recordings and one more"
        raise CommandError(f"{folder}: {len(paths)} recordings; expected {expected}")
    asked = question.machine, question.parameters, question.map_file, question.skip_s
    return [featured_run(path, *asked) for path in paths]


def _setup(question: _Question, folder: Path, runs: list[FeaturedRun]) -> tuple[MonitorSetup, list[FeaturedRun]]:
    """Return the setup of a machine, and the recordings that are to be judged."""
    kept = folder / BASELINE
    if kept.exists():
        return read_setup(kept, question.machine, question.parameters, runs[0].given), runs
    healthy, later = runs[: question.healthy], runs[question.healthy :]
    setup = setup_of_runs(healthy, question.parameters, question.arl0_h, 0, question.sister)
    if question.save:
        write_setup(kept, setup, force=False)
    return setup, later


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise CommandError(f"{folder}: cannot be listed: {error.strerror}") from error


def _show(fleet: Fleet, asked: FleetVerb, took_s: float) -> None:
    rows = [_row(rank, sister) for rank, sister in enumerate(fleet.sisters, 1)]
    refused = [(member.name, member.refused) for member in fleet.refused]
    suspects = sum(sister.is_suspect for sister in fleet.sisters)
    shown = sum(bool(sister.verdict) for sister in fleet.sisters)
    counts = f"{suspects} suspect, {shown - suspects} unconfirmed, {len(refused)} not judged"
    told = f"{len(rows)} machines, {counts}; {took_s:.0f} s"
    if asked.page is not None:
        parts = [
            f"<p>{told}; {versions()}</p>",
            section("Suspect", HEADS, rows[:suspects]),
            section("Unconfirmed: not apart from its sisters", HEADS, rows[suspects:shown]),
            section("Not judged", ("machine", "reason"), refused),
            section("Moved in all", ("feature", "median, sigma"), list(fleet.common.items())),
            section("Others", HEADS, rows[shown:]),
        ]
        write_text(asked.page, page(f"{asked.machine}: fleet {asked.folder.name}", parts), force=asked.force)
        say(f"written to {asked.page}")
    if asked.as_json:
        head = {"machine": asked.machine, **{name: getattr(fleet, name) for name in ("limit", "confirming", "common")}}
        print_json({**head, "machines": [_record(sister) for sister in fleet.sisters], "refused": dict(refused)})
        return
    if asked.everything or shown:
        print_table(f"{asked.machine}: {told}", HEADS, rows if asked.everything else rows[:shown])
    else:
        say(f"{asked.machine}: {told}")
    say(*(f"{name}: not judged: {reason}" for name, reason in refused))
    if not isfinite(fleet.limit):
        say("too few sisters to compare them; expected five or more with the same features")


def _row(rank: int, sister: Sister) -> tuple[Any, ...]:
    member, size = sister.member, sister.member.candidate
    sized = ("", "") if size is None else (_rounded(size.size), size.unit)
    since = (member.recording, _rounded(member.onset_s), _rounded(sister.apart), sister.feature)
    return (rank, member.name, sister.verdict, member.finding or "none", *sized, *since, member.cycles)


def _record(sister: Sister) -> Mapping[str, Any]:
    of_member = sister.member._asdict()
    del of_member["refused"]
    shift = of_member.pop("shift")
    among = {"apart": sister.apart, "feature": sister.feature, "verdict": sister.verdict}
    return {**of_member, **among, "shift": shift}


def _rounded(value: float) -> str:
    return f"{value:.4g}" if isfinite(value) else ""

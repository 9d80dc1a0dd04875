# SPDX-License-Identifier: Apache-2.0
"""``mech-twin monitor`` and ``fleet``: runs judged by healthy ones, machines by each other, or a sensor set."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import typer

from mech_twin.capabilities.cycle import CycleFeature
from mech_twin.cli.console import FOUND, CommandError, print_json, print_table, progress, rounded, say, write_text
from mech_twin.cli.measured import runs_of_map
from mech_twin.cli.measurement_verbs import FleetVerb, MonitorVerb
from mech_twin.cli.monitor_baseline import (
    ARL0_H,
    RunFeatures,
    baseline_file,
    earlier_runs,
    featured_run,
    read_setup,
    setup_of_runs,
    write_setup,
)
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.errors import MeasurementError, StudyError
from mech_twin.files.output_file import written_file
from mech_twin.files.report_page import page, section, versions
from mech_twin.parameters.load import catalogue_entry
from mech_twin.recording.bag_metadata import FILE_NAME as METADATA
from mech_twin.recording.errors import BagError
from mech_twin.results.opened_runs import given_map
from mech_twin.studies.monitoring.fleet import Fleet, FleetMember, Sister, fleet_of, judged_member
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.report import (
    Alarm,
    Explanation,
    JudgedRun,
    drawn_explanation,
    explanation,
    healthy_features,
    judged_run,
    known_fault,
)
from mech_twin.studies.monitoring.sensing import MonitoredMachine, first_channels
from mech_twin.studies.monitoring.sensor_design import (
    DESIGN_CYCLES,
    SensorDesign,
    arl0_cycles,
    fitted_setup,
    sensor_design,
    simulated_vectors,
)
from mech_twin.studies.spreading import available_cores, check_scheduler, spread

HEALTHY_SHARE = 0.4  # of the first run, where no baseline is given


def monitor_machine(request: MonitorVerb) -> None:
    """Judge runs, or a sensor set; exit with 1 where a fault was found."""
    kept_file = baseline_file(request.baseline)
    if request.seed is not None and kept_file is not None:
        raise CommandError(f"--seed {request.seed}: {kept_file} holds thresholds already; expected a run as --baseline")
    if request.renew and kept_file is None:
        raise CommandError("--renew: expected --baseline FILE.json, as --save-baseline wrote it")
    if request.design:
        _design(request)
        return
    named = request.runs or runs_of_map(request.map_file, request.built, "or --design --sensors FILE")
    runs = [featured_run(request, path) for path in named]
    _say_left_out(runs[0].monitored)
    setup, runs[0] = _setup(request, runs[0])
    if request.save_baseline is not None:
        write_setup(request.save_baseline, setup, force=request.force)
    found = [Judged(str(run.path), judged_run(Monitor(setup), run.vectors, run.skipped, run.until_s)) for run in runs]
    if request.explain is not None:
        known_fault(setup, request.explain)
        found = [run.explained(setup, runs[0].units, request.explain) for run in found]
    show_runs(setup, runs[0].units, found, as_json=request.as_json)
    if request.picture is not None:
        _draw(request.picture, setup, list(zip(runs, found, strict=True)), force=request.force)
    if any(run.found.has_fault for run in found):
        if request.renew:
            say(f"{kept_file}: not renewed, a run has an alarm")
        raise SystemExit(FOUND)
    if unjudged := [f"{run.run}: {run.found.counted}" for run in found if not run.found.cycles]:
        raise CommandError(f"{'; '.join(unjudged)}; expected what the baseline has")
    if request.renew and kept_file is not None:
        _renew(request, kept_file, setup, runs)


def _say_left_out(monitored: MonitoredMachine) -> None:
    """Name the sensors left out: of several for one quantity all but the first, and those that no feature reads."""
    first, feed = first_channels(monitored.sensors), monitored.feed()
    read = {feed.declared.reference.column}.union(*(feature.needs for feature in feed.features))
    for each in monitored.sensors.channels:
        name, quantity = each.source.label, each.quantity
        if first[quantity] is not each:
            say(f"{name}: left out, {quantity} is read from {first[quantity].source.label}")
        elif quantity not in read:
            say(f"{name}: left out, no feature of a cycle reads {quantity}")


def _renew(request: MonitorVerb, file: Path, setup: MonitorSetup, runs: Sequence[RunFeatures]) -> None:
    """Write the baseline anew, of its own runs and these, where there is a yes."""
    earlier = earlier_runs(file, setup, [run.path for run in runs])
    names = ", ".join(str(run.path) for run in runs)
    question = f"take {names} as healthy into {file} ({setup.baseline.cycles} cycles)?"
    if not request.yes and not (sys.stdin.isatty() and typer.confirm(question, err=True)):
        say(f"{file}: not renewed")
        return
    read = [(featured_run(request, run.path), run.cycles) for run in earlier]
    known = [run._replace(vectors=run.vectors[:cycles]) for run, cycles in read]
    renewed = setup_of_runs([*known, *runs], request.parameters, setup.arl0_h, 0)
    write_setup(file, renewed, force=True)
    say(f"{file}: renewed with {len(runs)} more, {len(known) + len(runs)} runs, {renewed.baseline.cycles} cycles")


def _draw(path: Path, setup: MonitorSetup, runs: Sequence[tuple[RunFeatures, Judged]], *, force: bool) -> None:
    """Write the picture of the first alarm that was explained; say where there is none."""
    from mech_twin.capabilities.plots import house_style

    explained = next((pair for pair in runs if pair[1].why), None)
    if explained is None:
        say(f"{path}: not written, there is no alarm to explain")
        return
    run, judged = explained
    alarm = next(alarm for alarm in judged.found.alarms if alarm.change is not None)
    figure = drawn_explanation(setup, run.vectors, alarm, judged.why[0])
    with house_style(), written_file(path, force=force) as file:
        figure.savefig(file)


def _design(request: MonitorVerb) -> None:
    assert request.sensors is not None
    sensors = given_map(request.sensors, request.built)
    monitored = MonitoredMachine(request.machine, request.parameters, sensors)
    _say_left_out(monitored)
    seed = request.seed or 0
    setup = fitted_setup(
        monitored, simulated_vectors(monitored, DESIGN_CYCLES, seed), request.known_arl0_h or ARL0_H, seed
    )
    show_design(setup, sensor_design(setup), monitored.feed().features, as_json=request.as_json)


def _setup(request: MonitorVerb, first: RunFeatures) -> tuple[MonitorSetup, RunFeatures]:
    """Return the setup, and the first run without the cycles that were its baseline."""
    file, parameters = baseline_file(request.baseline), request.parameters
    if file is not None:
        kept_setup = read_setup(file, request.machine, parameters, first.given)
        wanted = arl0_cycles(request.known_arl0_h or kept_setup.arl0_h, kept_setup.baseline.period_s)
        if not math.isclose(wanted, kept_setup.limits.arl0_cycles, rel_tol=1e-9):
            raise CommandError(
                f"--arl0 {request.known_arl0_h:g}: {file} holds thresholds for {kept_setup.arl0_h:g} h; "
                "expected that, or a run as --baseline"
            )
        return kept_setup, first
    days, rest = [featured_run(request, path) for path in request.baseline], first
    if not days:
        kept, cycles = int(HEALTHY_SHARE * len(first.vectors)), first.vectors
        say(f"{first.path}: no --baseline given, the first {kept} of {len(cycles)} cycles are taken as healthy")
        days, rest = [first._replace(vectors=cycles[:kept])], first._replace(vectors=cycles[kept:])
    return setup_of_runs(days, parameters, request.known_arl0_h or ARL0_H, request.seed or 0), rest


class Judged(NamedTuple):
    """A run by its name, what was found in it, and what speaks for and against a fault that was asked for."""

    run: str
    found: JudgedRun
    why: tuple[Explanation, ...] = ()

    def explained(self, setup: MonitorSetup, units: Mapping[str, str], fault: str) -> Judged:
        """Return the run with what speaks for and against a fault, of each alarm that had the cycles for it."""
        explanations = [explanation(setup, units, alarm, fault) for alarm in self.found.alarms]
        return self._replace(why=tuple(each for each in explanations if each is not None))


def show_runs(setup: MonitorSetup, units: Mapping[str, str], runs: Sequence[Judged], *, as_json: bool) -> None:
    """Print the baseline, and each run's alarms with the faults that explain them."""
    if as_json:
        print_json({**_setup_record(setup, units), "runs": [_run_record(run) for run in runs]})
        return
    _say_setup(setup)
    for run in runs:
        for value in run.found.operating:
            share, low, high = (f"{100.0 * each:+.4g} %" for each in (value.share, value.low_95, value.high_95))
            interval = f"({low} to {high}) of the baseline's, fair within +-{100.0 * value.range:.3g} %"
            place = "beyond its range" if value.is_outside else "operating_point"
            say(f"{run.run}: {place}: {value.name} {share} {interval}")
        if not run.found.alarms:
            faults = ", ".join(dict.fromkeys(event.name for event in run.found.became_active))
            say(f"{run.run}: {run.found.counted}, {f'fault: {faults}' if faults else 'no alarm'}")
            continue
        heads = ("alarm at, s", "began at, s", "cycles", "finding", "size", "95 % from", "to", "unit")
        rows = [row for alarm in run.found.alarms for row in _alarm_rows(alarm)]
        print_table(f"{run.run}: {run.found.counted}, alarms: {len(run.found.alarms)}", heads, rows)
    for run in runs:
        for explained in run.why:
            _show_explanation(run.run, explained)
    say(*(f"{run.run}: {event.text}" for run in runs for event in run.found.events))


def _show_explanation(run: str, found: Explanation) -> None:
    fault = found.fault
    verdict = "explains the change" if found.explains else "does not explain the change"
    heads = ("feature", "unit", "healthy", "change", "+-95 %", "fault would", "moved, sigma", "left, sigma")
    rows = []
    for each in found.features:
        numbers = map(rounded, (each.healthy, each.change, each.half_95, each.expected))
        rows.append((each.name, each.unit, *numbers, f"{each.moved_sigma:.1f}", f"{each.left_sigma:.1f}"))
    title = f"{run}: {fault.name} of {rounded(fault.size)} {fault.unit} {verdict} since {found.onset_s:.3f} s"
    left = f"({found.finding}), leaves {100.0 * fault.open_share:.1f} % of it open"
    print_table(f"{title} {left}", heads, rows)


def show_design(setup: MonitorSetup, design: SensorDesign, features: Sequence[CycleFeature], *, as_json: bool) -> None:
    """Print what a sensor set would find: each fault's effect, the delay to expect, and what looks like it."""
    units = {feature.name: feature.unit for feature in features}
    if as_json:
        names = [fault.name for fault in design.faults]
        rows = zip(names, design.isolability.tolist(), strict=True)
        matrix = {name: dict(zip(names, row, strict=True)) for name, row in rows}
        print_json({**_setup_record(setup, units), "faults": design.faults, "isolability": matrix})
        return
    _say_setup(setup)
    heads = ("fault", "size", "unit", "sigma a cycle", "delay, cycles", "found in 50", "looks like")
    shown = []
    for f in design.faults:
        numbers = map(rounded, (f.effect_sigma, f.delay_cycles, f.smallest))
        shown.append((f.name, f.size, f.unit, *numbers, ", ".join(f.alike) or "none"))
    print_table(f"{setup.machine}: what these sensors would find", heads, shown)


def _alarm_rows(alarm: Alarm) -> list[tuple[Any, ...]]:
    place = (f"{alarm.alarm_s:.2f}", f"{alarm.onset_s:.2f}", alarm.delay_cycles)
    if not alarm.candidates:
        return [(*place, alarm.verdict, "", "", "", "")]
    return [(*place, candidate.name, *map(rounded, candidate[1:4]), candidate.unit) for candidate in alarm.candidates]


def _say_setup(setup: MonitorSetup) -> None:
    baseline, limits = setup.baseline, setup.limits
    short = ", extrapolated: the baseline is shorter than three of them" if limits.extrapolated else ""
    say(
        f"baseline: {baseline.cycles} cycles, {len(baseline.names)} features, autoregression of order {baseline.order}"
        f"; one false alarm in {setup.arl0_h:.4g} h{short}"
    )


def _setup_record(setup: MonitorSetup, units: Mapping[str, str]) -> dict[str, Any]:
    baseline, limits = setup.baseline, setup.limits
    features = [
        {"name": name, "unit": units.get(name, "1"), "mean": mean, "sigma": sigma}
        for name, (mean, sigma) in healthy_features(setup).items()
    ]
    cycles = {name: getattr(baseline, name) for name in ("cycles", "order", "period_s")}
    head = {"machine": setup.machine, "features": features, "baseline": cycles, "arl0_h": setup.arl0_h}
    thresholds = {"extrapolated": limits.extrapolated, "thresholds": limits.alarm}
    return {**head, "arl0_cycles": limits.arl0_cycles, **thresholds}


def _run_record(run: Judged) -> dict[str, Any]:
    found = run.found._asdict()
    operating, alarms = found.pop("operating"), [alarm.record() for alarm in run.found.alarms]
    explained = {"explained": [each.record() for each in run.why]} if run.why else {}
    return {"run": run.run, **found, "alarms": alarms, "operating_point": operating, **explained}


BASELINE = "baseline.json"
HEADS = ("rank", "machine", "verdict", "finding", "size", "unit", "began in", "at, s", "apart by", "feature", "cycles")


def rank_fleet(request: FleetVerb) -> None:
    """Judge each machine of a folder; exit with 1 where one is suspect, with 2 where one could not be judged."""
    begun_s = time.monotonic()
    folders = sorted(each for each in _listed(request.folder) if each.is_dir())
    if not folders:
        raise CommandError(f"{request.folder}: no folder in it; expected one for each machine, its recordings in it")
    check_scheduler(request.scheduler)  # before the first machine, which is judged here
    if request.map_file is not None:  # as all read it: its error is none of a single machine
        given_map(request.map_file, catalogue_entry(request.machine).build(request.parameters))
    members, others, sister = list[FleetMember](), folders, None
    while others and sister is None:  # the first that can be judged: what its roll-outs tell serves the others
        (first, sister), others = _judged(request, None, others[0]), others[1:]
        members.append(first)
    task = partial(judged_folder, request, sister)
    results = spread(task, others, request.cores or available_cores(), request.scheduler)
    with progress(results, len(others), "fleet") as found:
        members += found
    fleet = fleet_of(sorted(members))
    _show_fleet(fleet, request, time.monotonic() - begun_s)
    if any(sister.is_suspect for sister in fleet.sisters):
        raise SystemExit(FOUND)
    if fleet.refused:
        raise CommandError(f"{request.folder}: {len(fleet.refused)} of {len(folders)} machines could not be judged")


def judged_folder(request: FleetVerb, sister: MonitorSetup | None, folder: Path) -> FleetMember:
    """Return the verdict of a machine's baseline on its recordings, or the reason why there is none."""
    return _judged(request, sister, folder)[0]


def _judged(request: FleetVerb, sister: MonitorSetup | None, folder: Path) -> tuple[FleetMember, MonitorSetup | None]:
    try:
        setup, runs = _setup_of(request, sister, folder)
        return judged_member(folder.name, setup, {run.path.name: run.vectors for run in runs}), setup
    except (BagError, CommandError, ConfigurationError, MeasurementError, StudyError) as error:
        return FleetMember(folder.name, refused=str(error)), None


def _runs(request: FleetVerb, folder: Path) -> list[RunFeatures]:
    if (folder / METADATA).exists():
        raise CommandError(f"{folder}: a bag; expected the folder of a machine, its recordings in it")
    paths = sorted(each for each in _listed(folder) if each.name != BASELINE and not each.name.startswith("."))
    least = 1 if (folder / BASELINE).exists() else request.healthy + 1
    if len(paths) < least:
        expected = f"{BASELINE} and a recording, or {request.healthy} healthy recordings and one more"
        raise CommandError(f"{folder}: {len(paths)} recordings; expected {expected}")
    return [featured_run(request, path) for path in paths]


def _setup_of(request: FleetVerb, sister: MonitorSetup | None, folder: Path) -> tuple[MonitorSetup, list[RunFeatures]]:
    """Return the setup of a machine, and the recordings that are to be judged."""
    kept, runs = folder / BASELINE, _runs(request, folder)
    if kept.exists():
        return read_setup(kept, request.machine, request.parameters, runs[0].given), runs
    healthy, later = runs[: request.healthy], runs[request.healthy :]
    setup = setup_of_runs(healthy, request.parameters, request.known_arl0_h or ARL0_H, 0, sister)
    if request.save_baselines:
        write_setup(kept, setup, force=False)
    return setup, later


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise CommandError(f"{folder}: cannot be listed: {error.strerror}") from error


def _show_fleet(fleet: Fleet, request: FleetVerb, took_s: float) -> None:
    rows = [_row(rank, sister) for rank, sister in enumerate(fleet.sisters, 1)]
    refused = [(member.name, member.refused) for member in fleet.refused]
    suspects = sum(sister.is_suspect for sister in fleet.sisters)
    shown = sum(bool(sister.verdict) for sister in fleet.sisters)
    counts = f"{suspects} suspect, {shown - suspects} unconfirmed, {len(refused)} not judged"
    summary = f"{len(rows)} machines, {counts}; {took_s:.0f} s"
    if request.page is not None:
        parts = [
            f"<p>{summary}; {_limits(fleet)}; {versions()}</p>",
            section("Suspect", HEADS, rows[:suspects]),
            section("Unconfirmed: not apart from its sisters", HEADS, rows[suspects:shown]),
            section("Not judged", ("machine", "reason"), refused),
            section("Moved in all", ("feature", "median, sigma"), list(fleet.common.items())),
            section("Others", HEADS, rows[shown:]),
        ]
        write_text(request.page, page(f"{request.machine}: fleet {request.folder.name}", parts), force=request.force)
    if request.as_json:
        head = {"machine": request.machine, "limit": fleet.limit, "confirming": fleet.confirming}
        machines = [_record(sister) for sister in fleet.sisters]
        print_json({**head, "common": fleet.common, "machines": machines, "refused": dict(refused)})
        return
    if request.everything or shown:
        print_table(f"{request.machine}: {summary}", HEADS, rows if request.everything else rows[:shown])
    else:
        say(f"{request.machine}: {summary}")
    say(*(f"{name}: not judged: {reason}" for name, reason in refused))
    say(_limits(fleet))


def _limits(fleet: Fleet) -> str:
    """Return the text on the limits, which are wider for fewer machines."""
    if not isfinite(fleet.limit):
        return "too few sisters to compare them; expected five or more with the same features"
    known = f"with {len(fleet.sisters)} machines a finding is confirmed beyond {fleet.confirming:.3g}"
    return f"apart by: {known}, a machine without one is apart beyond {fleet.limit:.3g}"


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

# SPDX-License-Identifier: Apache-2.0
"""``mech-twin monitor``: a recorded run judged against a healthy one, its faults named; or a sensor set judged."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from mech_twin.cli.console import say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.featured_run import ARL0_H, FeaturedRun, check_machine, featured_run, setup_of_runs
from mech_twin.cli.measurement_verbs import MonitorVerb
from mech_twin.cli.monitor_baseline import agreed, baseline_file, check_request, earlier_runs, read_setup
from mech_twin.cli.monitor_output import Judged, show_design, show_runs
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.output_file import check_output_file, written_file
from mech_twin.parameters.load import assignments, catalogue_entry, machine_parameters
from mech_twin.process.dependencies import require_extra
from mech_twin.results.opened_runs import given_map
from mech_twin.studies.monitoring.design import (
    DESIGN_CYCLES,
    arl0_cycles,
    fitted_setup,
    sensor_design,
    simulated_vectors,
)
from mech_twin.studies.monitoring.explanation import Explanation, drawn_explanation, explanation, known_fault
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.report import judged
from mech_twin.studies.monitoring.signatures import MonitoredMachine

FAULT_FOUND = 1  # exit code
HEALTHY_SHARE = 0.4  # of the first run, where no baseline is given


def _arl0_h(asked: MonitorVerb) -> float:
    """Return the mean time between false alarms that a new reference is made for."""
    return ARL0_H if asked.known_arl0_h is None else asked.known_arl0_h


def monitor_machine(asked: MonitorVerb) -> None:
    """Judge runs, or a sensor set; exit with 1 where a fault was found."""
    kept_file = baseline_file(asked.baseline)
    check_request(asked, kept_file)
    parameters = machine_parameters(asked.machine, asked.config, assignments(asked.settings))
    if asked.design:
        _design(asked, parameters)
        return
    if not asked.runs:
        raise CommandError("monitor: expected at least one run, or --design --sensors FILE")
    if asked.sensors is not None:
        raise CommandError(f"--sensors {asked.sensors}: goes with --design; a run has --map")
    if asked.save_baseline is not None:
        check_output_file(asked.save_baseline, force=asked.force)
    if asked.picture is not None:
        require_extra("plots")
        check_output_file(asked.picture, force=asked.force, suffixes=(".png", ".svg"))
    runs = [_featured(asked, path, parameters) for path in asked.runs]
    setup, runs[0] = _setup(asked, parameters, runs[0])
    if asked.save_baseline is not None:
        with written_file(asked.save_baseline, force=asked.force) as file:
            file.write_text(json.dumps(setup.record()) + "\n", encoding="utf-8")
        say(f"written to {asked.save_baseline}")
    found = [Judged(str(run.path), judged(Monitor(setup), run.vectors, run.skipped)) for run in runs]
    if asked.explain is not None:
        found = [run._replace(why=_explained(setup, runs[0].units, run, asked.explain)) for run in found]
    show_runs(setup, runs[0].units, found, as_json=asked.as_json)
    if asked.picture is not None:
        _draw(asked.picture, setup, list(zip(runs, found, strict=True)), force=asked.force)
    faulty = any(run.found.has_fault for run in found)
    if faulty and asked.renew:
        say(f"{kept_file}: not renewed, a run has an alarm")
    if faulty:
        raise SystemExit(FAULT_FOUND)
    if asked.renew and kept_file is not None:
        _renew(asked, kept_file, setup, runs, parameters)


def _featured(asked: MonitorVerb, path: Path, parameters: Parameters) -> FeaturedRun:
    return featured_run(path, asked.machine, parameters, asked.map_file, asked.skip_s)


def _renew(
    asked: MonitorVerb, file: Path, setup: MonitorSetup, runs: Sequence[FeaturedRun], parameters: Parameters
) -> None:
    """Write the baseline anew, of its own runs and these, where there is a yes."""
    earlier = earlier_runs(file, setup, [run.path for run in runs])
    if not asked.yes and not agreed(file, setup, [str(run.path) for run in runs]):
        say(f"{file}: not renewed")
        return
    read = [(_featured(asked, run.path, parameters), run.cycles) for run in earlier]
    known = [run._replace(vectors=run.vectors[:cycles]) for run, cycles in read]
    renewed = setup_of_runs([*known, *runs], parameters, setup.arl0_h, 0)
    with written_file(file, force=True) as unfinished:
        unfinished.write_text(json.dumps(renewed.record()) + "\n", encoding="utf-8")
    say(f"{file}: renewed with {len(runs)} more, {len(known) + len(runs)} runs, {renewed.baseline.cycles} cycles")


def _explained(setup: MonitorSetup, units: Mapping[str, str], run: Judged, fault: str) -> tuple[Explanation, ...]:
    """Return what speaks for and against a fault, of each alarm that had the cycles for it."""
    known_fault(setup, fault)
    told = [explanation(setup, units, alarm, fault) for alarm in run.found.alarms]
    return tuple(each for each in told if each is not None)


def _draw(path: Path, setup: MonitorSetup, runs: Sequence[tuple[FeaturedRun, Judged]], *, force: bool) -> None:
    """Write the picture of the first alarm that was explained; say where there is none."""
    from mech_twin.capabilities.plots import house_style

    for run, told in runs:
        if not told.why:
            continue
        alarm = next(alarm for alarm in told.found.alarms if alarm.change is not None)
        figure = drawn_explanation(setup, run.vectors, alarm, told.why[0])
        with house_style(), written_file(path, force=force) as file:
            figure.savefig(file)
        say(f"written to {path}")
        return
    say(f"{path}: not written, there is no alarm to explain")


def _design(asked: MonitorVerb, parameters: Parameters) -> None:
    if asked.sensors is None or asked.runs:
        raise CommandError("--design: expected --sensors FILE and no runs")
    sensors = given_map(asked.sensors, catalogue_entry(asked.machine).build(parameters))
    check_machine(asked.machine, asked.sensors, sensors)
    monitored = MonitoredMachine(asked.machine, parameters, sensors)
    setup = fitted_setup(
        monitored, simulated_vectors(monitored, DESIGN_CYCLES, asked.seed or 0), _arl0_h(asked), asked.seed or 0
    )
    show_design(setup, sensor_design(setup), monitored.feed().features, as_json=asked.as_json)


def _setup(asked: MonitorVerb, parameters: Parameters, first: FeaturedRun) -> tuple[MonitorSetup, FeaturedRun]:
    """Return the setup, and the first run without the cycles that were its baseline."""
    file = baseline_file(asked.baseline)
    if file is not None:
        kept_setup = read_setup(file, asked.machine, parameters, first.given)
        wanted = arl0_cycles(asked.known_arl0_h or kept_setup.arl0_h, kept_setup.baseline.period_s)
        if not math.isclose(wanted, kept_setup.limits.arl0_cycles, rel_tol=1e-9):
            raise CommandError(
                f"--arl0 {_arl0_h(asked):g}: {file} holds thresholds for {kept_setup.arl0_h:g} h; "
                "expected that, or a run as --baseline"
            )
        return kept_setup, first
    if asked.baseline:
        days = [_featured(asked, path, parameters) for path in asked.baseline]
        return setup_of_runs(days, parameters, _arl0_h(asked), asked.seed or 0), first
    kept = int(HEALTHY_SHARE * len(first.vectors))
    say(f"{first.path}: no --baseline given, the first {kept} of {len(first.vectors)} cycles are taken as healthy")
    setup = setup_of_runs([first._replace(vectors=first.vectors[:kept])], parameters, _arl0_h(asked), asked.seed or 0)
    return setup, first._replace(vectors=first.vectors[kept:])

# SPDX-License-Identifier: Apache-2.0
"""Proof of the monitor on simulated machines: false alarms on healthy cycles, and every fault at three sizes.

    python benchmarks/monitoring/proof.py MACHINE [--healthy CYCLES] [--repeats N] [--arl0 CYCLES] [--out FILE.json]

Sensors are those of benchmarks/monitoring/sensors; the supply wanders slowly.  Healthy cycles are counted against the
Poisson interval of the stated mean run length.  A fault is a change of parameters at a random instant of a cycle; each
motion is rolled out a few times and seen through fresh noise in each repeat.  `tables.py` makes the tables of the page.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import poisson

from mech_twin.capabilities.faults import MachineFault
from mech_twin.cli.measurement import columns_of
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.measurements.measurement_map import read_map
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.cycle_features import FeatureVector, feed_channels
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.sensing import needed_columns, seen_roll_out
from mech_twin.studies.monitoring.signatures import MonitoredMachine, machine_signatures, mean_period_s
from mech_twin.studies.monitoring.thresholds import chart_limits

SENSORS = Path(__file__).parent / "sensors"
SETTINGS: dict[str, dict[str, Any]] = {
    # a press with a motor and a flywheel: at prescribed speed neither could fail
    "compaction_press": {
        "drive.kind": "kloss",
        "motor.rated_power_w": 3000.0,
        "motor.rated_speed_rpm": 1420.0,
        "motor.synchronous_speed_rpm": 1500.0,
        "motor.breakdown_torque_ratio": 2.4,
        "motor.starting_torque_ratio": 2.0,
        "motor.rotor_inertia_kg_m2": 0.01,
        "gear.ratio": 4.7,
        "gear.efficiency": 0.96,
        "flywheel.inertia_kg_m2": 2.0,
    },
    # a step that is no part of the period: else the switching of the force falls on steps, and rounding decides which
    "impact_mass": {"coupling.step_s": 0.00023},
}
WANDER, WANDER_S = 5e-4, 20.0  # standard deviation and time constant of the supply's wander
CHUNK_S = 100.0
PACKAGE_S = 60.0  # of a winding drum, whose package runs off
BEFORE, AFTER, MOTIONS = 30, 80, 3  # cycles before and after a change; roll-outs a size
TRIAL_ARL0 = 1e5
SHARE_OF_SIZE = 0.8  # off the sizes that signatures are computed at


def monitored_machine(name: str) -> MonitoredMachine:
    """Return the machine with its sensors."""
    parameters = machine_parameters(name, None, SETTINGS.get(name))
    return MonitoredMachine(name, parameters, read_map(SENSORS / f"{name}.yaml", columns_of))


def wander(steps: int, step_s: float, random: np.random.Generator, first: float = 0.0) -> np.ndarray:
    """Return a supply fraction near 1 that wanders: an Ornstein-Uhlenbeck process, a knot every tenth of a second."""
    knots = int(np.ceil(steps * step_s / 0.1)) + 2
    decay, values = np.exp(-0.1 / WANDER_S), np.empty(knots)
    values[0] = first
    for i, shock in enumerate(random.standard_normal(knots - 1), 1):
        values[i] = decay * values[i - 1] + WANDER * np.sqrt(1.0 - decay * decay) * shock
    return 1.0 + np.interp(step_s * np.arange(steps + 1), 0.1 * np.arange(knots), values)


def healthy_cycles(machine: MonitoredMachine, count: int, random: np.random.Generator) -> Iterator[list[FeatureVector]]:
    """Yield healthy cycles, run after run, until there are enough."""
    built = machine.entry.build(machine.parameters)
    step_s, begin_s = built.coupling_step_s, machine.declared.run_up_s
    duration_s = begin_s + (PACKAGE_S if machine.name == "winding_drum" else CHUNK_S)
    done = 0
    while done < count:
        command = wander(round(duration_s / step_s), step_s, random, WANDER * random.standard_normal())
        run = roll_out(built, duration_s, needed_columns(machine.sensors), None, command)
        assert run.error is None
        vectors = feed_channels(machine.feed(), seen_roll_out(run, machine.sensors, step_s, random, begin_s))
        done += len(vectors)
        yield vectors


def numbered(runs: list[list[FeatureVector]]) -> list[FeatureVector]:
    """Return the cycles of several runs, a number left out between two, so that none is taken for the other's next."""
    found, first = [], 0
    for run in runs:
        found += [vector._replace(number=first + i) for i, vector in enumerate(run)]
        first += len(run) + 1
    return found


def false_alarms(setup: MonitorSetup, machine: MonitoredMachine, count: int, seed: int) -> dict[str, Any]:
    """Return alarms on healthy cycles, and the interval that the stated run length allows."""
    monitor, begun, watched, first = Monitor(setup), 0, 0, 0
    for run in healthy_cycles(machine, count, np.random.default_rng([seed, 1])):
        for vector in numbered([run]):
            found = monitor.observe(vector._replace(number=first + vector.number))
            begun += found.alarm_begins
            watched += found.charts is not None and (found.alarm_begins or not found.alarm)
        first += len(run) + 1
    expected = watched / setup.limits.arl0_cycles
    low, high = poisson.interval(0.95, expected)
    return {"cycles": watched, "alarms": begun, "expected": expected, "low": low, "high": high}


def three_sizes(fault: MachineFault) -> list[float]:
    """Return a small, a middle and a large size, of one sign."""
    sizes = sorted(fault.sizes, key=abs)
    if len(sizes) == 1:
        return sizes
    same = [size for size in sizes if (size > 0.0) == (sizes[0] > 0.0)]
    return [SHARE_OF_SIZE * same[place] for place in (0, len(same) // 2, -1)]


def motions(
    machine: MonitoredMachine, fault: MachineFault, size: float, period_s: float, seed: int
) -> list[tuple[RollOut, float]]:
    """Return roll-outs with the fault, and when it happens in each."""
    found = []
    healthy = machine.entry.build(machine.parameters)
    faulty = machine.entry.build(machine.varied(fault.changes(machine.parameters, size)))
    step_s, begin_s = healthy.coupling_step_s, machine.declared.run_up_s
    for each in range(MOTIONS):
        random = np.random.default_rng([seed, each])
        change_s = begin_s + (BEFORE + random.random()) * period_s
        duration_s = change_s + (AFTER + 2) * period_s
        command = wander(round(duration_s / step_s), step_s, random)
        command[round(change_s / step_s) :] *= fault.command(size)
        columns = needed_columns(machine.sensors)
        run = roll_out(healthy, duration_s, columns, None, command, [(change_s, faulty)])
        if run.error is None:
            found.append((run, change_s))
    return found


def tried(
    setup: MonitorSetup, machine: MonitoredMachine, fault: MachineFault, size: float, repeats: int, seed: int
) -> dict[str, Any]:
    """Return how often a fault is found, how soon, and how it is named."""
    period_s = setup.baseline.period_s
    runs = motions(machine, fault, size, period_s, seed)
    step_s, begin_s = machine.entry.build(machine.parameters).coupling_step_s, machine.declared.run_up_s
    delays, verdicts, wrong = [], dict.fromkeys(("right", "group", "wrong", "unknown", "none"), 0), []
    early = 0
    for repeat in range(repeats if runs else 0):
        run, change_s = runs[repeat % len(runs)]
        random = np.random.default_rng([seed, 100 + repeat])
        monitor, alarm_s, last = Monitor(setup), None, None
        for vector in feed_channels(machine.feed(), seen_roll_out(run, machine.sensors, step_s, random, begin_s)):
            last = monitor.observe(vector)
            if last.alarm_begins and alarm_s is None:
                alarm_s = last.time_s
        if alarm_s is not None and alarm_s < change_s:
            early += 1
            continue
        if alarm_s is None or last is None:
            verdicts["none"] += 1
            continue
        delays.append((alarm_s - change_s) / period_s)
        names = [candidate.name for candidate in last.candidates]
        kind = _judgement(last.verdict, fault.name, names)
        verdicts[kind] += 1
        if kind == "wrong":
            wrong.append(last.finding)
    return {
        "fault": fault.name, "size": size, "unit": fault.unit, "repeats": repeats - early, "early": early,
        "found": len(delays) / max(repeats - early, 1),
        "delay_median": float(np.median(delays)) if delays else None,
        "delay_95": float(np.quantile(delays, 0.95)) if delays else None,
        **{f"named_{kind}": count for kind, count in verdicts.items()}, "wrong_names": sorted(set(wrong)),
    }  # fmt: skip


def _judgement(verdict: str, fault: str, names: list[str]) -> str:
    """Return whether the fault was named alone, in a group, wrongly, called unknown, or not named at all."""
    if fault in names:
        return "right" if len(names) == 1 else "group"
    return {"named": "wrong", "group": "wrong", "unknown": "unknown"}.get(verdict, "none")


def main() -> None:
    asked = argparse.ArgumentParser(description="proof of the monitor on a simulated machine")
    asked.add_argument("machine")
    asked.add_argument("--baseline", type=int, default=3000, help="healthy cycles of the baseline")
    asked.add_argument("--healthy", type=int, default=1_000_000, help="healthy cycles that are judged")
    asked.add_argument("--arl0", type=float, default=1000.0, help="stated cycles between false alarms, of those")
    asked.add_argument("--repeats", type=int, default=200, help="of each fault and size")
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--out", type=Path, help="file of the results")
    given = asked.parse_args()
    began = time.monotonic()
    machine = monitored_machine(given.machine)
    runs = list(healthy_cycles(machine, given.baseline, np.random.default_rng([given.seed, 0])))
    baseline, innovations = fitted_baseline(numbered(runs))
    signatures = machine_signatures(machine, baseline.names)
    settling = machine.declared.settling_cycles

    def setup(arl0: float) -> MonitorSetup:
        return MonitorSetup(machine.name, baseline, chart_limits(baseline, innovations, arl0), signatures, settling)

    healthy = false_alarms(setup(given.arl0), machine, given.healthy, given.seed)
    print(f"{machine.name}: {healthy}", flush=True)
    rows, trial = [], setup(TRIAL_ARL0)
    for place, fault in enumerate(machine.faults if given.repeats else ()):
        for size in three_sizes(fault):
            rows.append(tried(trial, machine, fault, size, given.repeats, given.seed + 10 * place))
            print(rows[-1], flush=True)
    record = {
        "machine": machine.name, "period_s": mean_period_s(machine), "features": len(baseline.names),
        "baseline_cycles": baseline.cycles, "order": baseline.order, "arl0_cycles": given.arl0,
        "trial_arl0_cycles": TRIAL_ARL0, "healthy": healthy, "faults": rows, "seconds": time.monotonic() - began,
    }  # fmt: skip
    if given.out:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Proof of the monitor over the operating points of a day: false alarms where supply, load and temperature go about.

    python benchmarks/monitoring/day.py [MACHINE ...] [--cycles N] [--write]

A baseline is taken at one operating point, as on the day of commissioning.  Then every variable that the machine
declares goes through its whole range, as a sine of its own period and phase in each motion, ten minutes to two hours
long; in one motion of three, one of them jumps besides, to anywhere in its range.  Nothing is at fault, so
each alarm is a false one, and the stated mean run length is to hold.  Results stand in
benchmarks/monitoring/results/MACHINE.day.json, the table in docs/proof/monitoring.md.
"""

from __future__ import annotations

import argparse
import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
from plants import FAR, monitored_machine, seen_vectors, steps_of_motion, wander
from proof import RESULTS, drawn_setup
from scipy.stats import chi2

from mech_twin.capabilities.cycle import TURN
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.files.output_file import written_file
from mech_twin.studies.monitoring.monitor import Monitor
from mech_twin.studies.monitoring.operating_fit import parameters_at
from mech_twin.studies.monitoring.sensing import needed_columns
from mech_twin.studies.monitoring.signatures import MonitoredMachine

PAGE = Path(__file__).parents[2] / "docs" / "proof" / "monitoring.md"
MARKS = "<!-- day begins -->", "<!-- day ends -->"
KNOT_S, PERIODS_S = 0.2, (600.0, 7200.0)
JUMPS = 3  # a jump in one motion of so many
ARL0, BASELINE = 1000.0, 4_000


def day_run(machine: MonitoredMachine, motion: int, random: np.random.Generator) -> RollOut:
    """Return a healthy motion through operating points."""
    built, variables = machine.entry.build(machine.parameters), machine.operating
    steps = steps_of_motion(machine)
    duration_s = steps * built.coupling_step_s
    ranges = np.array([variable.range for variable in variables])
    at_s = np.arange(0.0, duration_s, KNOT_S)
    periods_s, phases = random.uniform(*PERIODS_S, len(ranges)), random.uniform(0.0, TURN, len(ranges))
    shares = np.sin(TURN * at_s[:, None] / periods_s + phases)
    if motion % JUMPS == 0:
        shares[len(at_s) // 2 :, random.integers(len(ranges))] = random.uniform(-1.0, 1.0)
    machines = []
    for i, point in enumerate(shares * ranges):
        parameters = parameters_at(machine.parameters, variables, point)
        assert parameters is not None
        machines.append((KNOT_S * i, machine.entry.build(parameters)))
    command = wander(steps, built.coupling_step_s, random)
    run = roll_out(machines[0][1], duration_s, needed_columns(machine.sensors), None, command, machines[1:])
    if run.error is not None:
        raise run.error
    return run


def day(name: str, cycles: int) -> dict[str, Any]:
    """Return how many cycles were watched over the operating points, and the alarms in them."""
    begun_s, random = time.process_time(), np.random.default_rng(7)
    known, machine = drawn_setup(name, BASELINE, ARL0, random), monitored_machine(name)
    monitor, first, motion = Monitor(known), 0, 0
    told: dict[str, Any] = {"machine": name, "arl0": ARL0, "cycles": 0, "alarms": 0, "lasting": 0, "by_motion": []}
    extremes: dict[str, list[float]] = {}
    while told["cycles"] < cycles:
        alarms = 0
        vectors = seen_vectors(machine, day_run(machine, motion, random), random)
        active = {life.name for life in monitor.lives.values() if life.state == "active"}
        for vector in vectors:
            found = monitor.observe(vector._replace(number=first + vector.number))
            alarms += found.alarm_begins
            told["cycles"] += found.charts is not None and (found.alarm_begins or not found.alarm)
            now = {life.name for life in found.faults if life.state == "active"}
            told["lasting"] += len(now - active)
            active = now
            for value in found.operating:
                low, high = extremes.setdefault(value.name, [0.0, 0.0])
                extremes[value.name] = [min(low, value.share), max(high, value.share)]
        first, motion = first + vectors[-1].number + FAR, motion + 1
        told["alarms"] += alarms
        told["by_motion"].append(alarms)
        if motion % 10 == 0:
            _keep(told | {"extremes": extremes, "spent_s": time.process_time() - begun_s})
    found_all = told | {"extremes": extremes, "spent_s": time.process_time() - begun_s}
    _keep(found_all)
    return found_all


def _keep(told: dict[str, Any]) -> None:
    RESULTS.mkdir(exist_ok=True)
    with written_file(RESULTS / f"{told['machine']}.day.json", force=True) as file:
        file.write_text(json.dumps(told) + "\n", encoding="utf-8")


def table() -> str:
    """Return the table of all results."""
    heads = ("machine", "cycles", "operating points seen", "alarms stated", "alarms", "over stated", "told as a fault")
    rows = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for path in sorted(RESULTS.glob("*.day.json")):
        told = json.loads(path.read_text(encoding="utf-8"))
        expected = told["cycles"] / told["arl0"]
        low, high = 0.5 * chi2.ppf(0.025, 2 * told["alarms"]), 0.5 * chi2.ppf(0.975, 2 * told["alarms"] + 2)
        seen = ", ".join(f"{name} {100 * a:+.1f} to {100 * b:+.1f} %" for name, (a, b) in told["extremes"].items())
        ratio = f"{told['alarms'] / expected:.2f} ({max(low, 0.0) / expected:.2f} to {high / expected:.2f})"
        cells = (told["machine"], told["cycles"], seen, f"{expected:.0f}", told["alarms"], ratio, told["lasting"])
        rows.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(rows)


def main() -> None:
    """Watch a day, or write the table."""
    asked = argparse.ArgumentParser(description="false alarms over the operating points of a day")
    asked.add_argument("machines", nargs="*", default=[])
    asked.add_argument("--cycles", type=int, default=300_000)
    asked.add_argument("--write", action="store_true", help="write the table into the page")
    given = asked.parse_args()
    for name in given.machines:
        told = day(name, given.cycles)
        print(f"{name}: {told['cycles']} cycles, {told['alarms']} alarms, {told['cycles'] / ARL0:.0f} stated")
    if given.write:
        begin, end = map(re.escape, MARKS)
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(
            re.sub(f"(?s){begin}.*{end}", lambda _: f"{MARKS[0]}\n{table()}\n{MARKS[1]}", text), encoding="utf-8"
        )


if __name__ == "__main__":
    main()

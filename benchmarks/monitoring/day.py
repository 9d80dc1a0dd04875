# SPDX-License-Identifier: Apache-2.0
"""Proof of the monitor over the operating points of a day: false alarms where supply, load and temperature go about.

    python benchmarks/monitoring/day.py [MACHINE ...] [--cycles N] [--baselines N] [--write]

Baselines are taken at one operating point, as on the day of commissioning; each watches cycles of its own.  Then every
variable that the machine declares goes through its whole range, as a sine of its own period and phase in each motion,
ten minutes to two hours long; in one motion of three, one of them jumps besides, to anywhere in its range.  The weight
of a package's yarn differs from package to package, which is a motion of the drum, and not within it.  Nothing is
at fault, so each alarm is a false one, and the stated mean run length is to hold.  Results stand in
benchmarks/monitoring/results/MACHINE.day.json after each baseline, the table in docs/proof/monitoring.md.
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
from tables import share_of_expected

from mech_twin.capabilities.cycle import TURN
from mech_twin.engine.rollout import RollOut
from mech_twin.files.output_file import written_file
from mech_twin.studies.monitoring.monitor import Monitor
from mech_twin.studies.monitoring.operating_fit import operated_run
from mech_twin.studies.monitoring.sensing import MonitoredMachine

PAGE = Path(__file__).parents[2] / "docs" / "proof" / "monitoring.md"
MARKS = "<!-- day begins -->", "<!-- day ends -->"
KNOT_S, PERIODS_S = 0.5, (600.0, 7200.0)
JUMPS = 3  # a jump in one motion of so many
ARL0, BASELINE = 1000.0, 4_000


def day_run(machine: MonitoredMachine, motion: int, random: np.random.Generator) -> RollOut:
    """Return a healthy motion through operating points."""
    step_s = machine.entry.build(machine.parameters).coupling_step_s
    variables, steps = machine.operating, steps_of_motion(machine)
    ranges = np.array([variable.range for variable in variables])
    at_s = np.arange(0.0, steps * step_s, KNOT_S)
    periods_s, phases = random.uniform(*PERIODS_S, len(ranges)), random.uniform(0.0, TURN, len(ranges))
    shares = np.sin(TURN * at_s[:, None] / periods_s + phases)
    if motion % JUMPS == 0:
        shares[len(at_s) // 2 :, random.integers(len(ranges))] = random.uniform(-1.0, 1.0)
    for k, variable in enumerate(variables):
        if variable.name == "yarn_weight":  # a package that runs off was wound of one yarn
            shares[:, k] = shares[-1, k]
    command = wander(steps, step_s, random)
    if not any(variable.is_commanded for variable in variables):  # a drive gives no more than what is configured
        command = np.minimum(command, 1.0)
    return operated_run(machine, variables, at_s, shares * ranges, command)


def day(name: str, cycles: int, baselines: int) -> None:
    """Watch the cycles over the operating points, by so many baselines in turn; go on from what is on disk."""
    path = RESULTS / f"{name}.day.json"
    told: dict[str, Any] = {"machine": name, "arl0": ARL0, "cycles": cycles, "baselines": []}
    if path.exists():
        earlier = json.loads(path.read_text(encoding="utf-8"))
        if all(earlier.get(key) == told[key] for key in ("machine", "arl0", "cycles")):
            told = earlier
    while len(told["baselines"]) < baselines:
        told["baselines"].append(judged(name, cycles // baselines, len(told["baselines"])))
        with written_file(path, force=True) as file:
            file.write_text(json.dumps(told) + "\n", encoding="utf-8")


def judged(name: str, cycles: int, piece: int) -> dict[str, Any]:
    """Return the alarms over the operating points as one baseline tells them."""
    begun_s, random = time.process_time(), np.random.default_rng([7, piece])
    known, machine = drawn_setup(name, BASELINE, ARL0, random), monitored_machine(name)
    monitor, first, motion = Monitor(known), 0, 0
    told: dict[str, Any] = {"cycles": 0, "alarms": 0, "lasting": 0, "extremes": {}}
    while told["cycles"] < cycles:
        vectors = seen_vectors(machine, day_run(machine, motion, random), random)
        active = {life.name for life in monitor.lives.values() if life.state == "active"}
        for vector in vectors:
            found = monitor.observe(vector._replace(number=first + vector.number))
            told["alarms"] += found.alarm_begins
            told["cycles"] += found.charts is not None and (found.alarm_begins or not found.alarm)
            now = {life.name for life in found.faults if life.state == "active"}
            told["lasting"] += len(now - active)
            active = now
            for value in found.operating:
                low, high = told["extremes"].setdefault(value.name, [0.0, 0.0])
                told["extremes"][value.name] = [min(low, value.share), max(high, value.share)]
        first, motion = first + vectors[-1].number + FAR, motion + 1
    return told | {"spent_s": time.process_time() - begun_s}


def table() -> str:
    """Return the table of all results."""
    heads = ("machine", "cycles", "baselines", "operating points seen", "alarms stated", "alarms", "over stated, 95 %",
             "scatter of baselines", "told as a fault")  # fmt: skip
    rows = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for path in sorted(RESULTS.glob("*.day.json")):
        told = json.loads(path.read_text(encoding="utf-8"))
        pieces, extremes = told["baselines"], dict[str, list[float]]()
        cycles, lasting = (sum(piece[key] for piece in pieces) for key in ("cycles", "lasting"))
        alarms = np.array([piece["alarms"] for piece in pieces])
        expected = np.array([piece["cycles"] for piece in pieces]) / told["arl0"]
        scattered = ""
        low, high = 0.5 * chi2.ppf((0.025, 0.975), 2 * alarms.sum() + np.array([0, 2])) / expected.sum()
        if len(pieces) > 1:  # of one baseline nothing is known of its peers: the interval is of a Poisson count
            share, half, scatter = share_of_expected(alarms, expected)
            low, high, scattered = max(share - half, 0.0), share + half, f"{100 * scatter:.0f} %"
        for piece in pieces:
            for name, (a, b) in piece["extremes"].items():
                least, most = extremes.get(name, (0.0, 0.0))
                extremes[name] = [min(least, a), max(most, b)]
        seen = ", ".join(f"{name} {100 * a:+.1f} to {100 * b:+.1f} %" for name, (a, b) in extremes.items())
        ratio = f"{alarms.sum() / expected.sum():.2f} ({low:.2f} to {high:.2f})"
        cells = (told["machine"], cycles, len(pieces), seen, f"{expected.sum():.0f}", alarms.sum(), ratio,
                 scattered, lasting)  # fmt: skip
        rows.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(rows)


def main() -> None:
    """Watch a day, or write the table."""
    asked = argparse.ArgumentParser(description="false alarms over the operating points of a day")
    asked.add_argument("machines", nargs="*", default=[])
    asked.add_argument("--cycles", type=int, default=300_000)
    asked.add_argument("--baselines", type=int, default=10)
    asked.add_argument("--write", action="store_true", help="write the table into the page")
    given = asked.parse_args()
    for name in given.machines:
        day(name, given.cycles, given.baselines)
    if given.write:
        begin, end = map(re.escape, MARKS)
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(
            re.sub(f"(?s){begin}.*{end}", lambda _: f"{MARKS[0]}\n{table()}\n{MARKS[1]}", text), encoding="utf-8"
        )


if __name__ == "__main__":
    main()

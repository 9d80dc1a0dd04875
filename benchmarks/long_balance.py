# SPDX-License-Identifier: Apache-2.0
"""Worst residuals of a machine over hours of simulated time.

python benchmarks/long_balance.py MACHINE [--hours 8] [--step largest]
python benchmarks/long_balance.py --table      writes the table of docs/proof/random-configurations.md

The machine is its installed configuration, at the configured coupling step or at the largest it accepts.  Every step
of the compiled roll-out is judged, which equals the engine to the bit.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.rollout import roll_out
from mech_twin.engine.trajectory import NO_LIMIT, Residual, broken_lines
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "proof" / "random-configurations.md"
KEPT = ROOT / "build" / "long_balance"
BEGIN, END = "<!-- written by benchmarks/long_balance.py -->", "<!-- end of long runs -->"
LONGEST_STEP_S = 1.0
STEPS_AT_ONCE = 100_000


def largest_step_s(name: str) -> float:
    """Return the largest coupling step (s) that a machine accepts, to three digits below it."""

    def accepted(step_s: float) -> bool:
        try:
            machine(name, overrides={"coupling.step_s": step_s})
        except ConfigurationError:
            return False
        return True

    low, high = machine(name).coupling_step_s, LONGEST_STEP_S
    if accepted(high):
        return high
    while high - low > 1e-3 * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if accepted(middle) else (low, middle)
    return low


def worse(one: float, other: float) -> float:
    """Return the larger of two magnitudes, nan if one is."""
    return one if one >= other or math.isnan(one) else other


def run(twin: Machine, hours: float) -> dict[str, tuple[float, float]]:
    """Return the worst of each residual with its limit; the columns of a run of hours are not kept."""
    steps, done, frame = round(3600.0 * hours / twin.coupling_step_s), 0, None
    found: dict[str, Residual] = {}
    while done < steps:
        block = min(STEPS_AT_ONCE, steps - done)
        part = roll_out(twin, block * twin.coupling_step_s, [], frame)
        if part.error is not None:
            raise part.error
        for name, residual in part.residuals.items():
            known = found.get(name, Residual(0.0, NO_LIMIT))
            found[name] = Residual(worse(residual.worst, known.worst), residual.limit)
        frame, done = part.final, done + block
    for line in broken_lines(found, twin.coupling_step_s):
        sys.stdout.write(f"{twin.name}: {line}\n")
    return {name: (residual.worst, residual.limit) for name, residual in found.items()}


def measured(name: str, hours: float, step: str) -> int:
    """Run, keep and print what was found; return the number of broken residuals."""
    overrides = {} if step == "configured" else {"coupling.step_s": largest_step_s(name)}
    twin = machine(name, overrides=overrides)
    begun = time.perf_counter()
    found = run(twin, hours)
    kept = {
        "machine": name,
        "hours": hours,
        "step_s": twin.coupling_step_s,
        "residuals": found,
        "seconds": time.perf_counter() - begun,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
    }
    KEPT.mkdir(parents=True, exist_ok=True)
    (KEPT / f"{name}_{step}.json").write_text(json.dumps(kept))
    sys.stdout.write(json.dumps(kept, indent=1) + "\n")
    return sum(not worst <= limit for worst, limit in found.values())


def write_table() -> None:
    """Write the table into its page."""
    lines = [
        "| machine | simulated | coupling step | worst of each residual (its limit) | date |",
        "|---|---|---|---|---|",
    ]
    for name in CATALOGUE:
        for file in sorted(KEPT.glob(f"{name}_*.json")):
            kept = json.loads(file.read_text())
            worst = ", ".join(f"`{key}` {found:.2g} ({limit:.2g})" for key, (found, limit) in kept["residuals"].items())
            cells = f"{name} | {kept['hours']:g} h | {1e3 * kept['step_s']:.4g} ms | {worst} | {kept['date']}"
            lines.append(f"| {cells} |")
    head, _, rest = PAGE.read_text().partition(BEGIN)
    PAGE.write_text(head + BEGIN + "\n" + "\n".join(lines) + "\n" + END + rest.partition(END)[2])


def main() -> int:
    """Run one machine, or write the table."""
    asked = argparse.ArgumentParser(description="worst residuals over hours of simulated time")
    asked.add_argument("machine", nargs="?", choices=list(CATALOGUE))
    asked.add_argument("--hours", type=float, default=8.0)
    asked.add_argument("--step", choices=["configured", "largest"], default="configured")
    asked.add_argument("--table", action="store_true")
    given = asked.parse_args()
    if given.table:
        write_table()
        return 0
    return int(measured(given.machine, given.hours, given.step) > 0)


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""How fast is a roll-out?  ``python benchmarks/rollout.py [--write]`` measures each machine on one core.

Prints simulated seconds per second of processor time, of a roll-out and of the roles called one by one in Python, and
the first call in a fresh process with compiled kernels on disk; ``--write`` puts the table into docs/performance.md.
"""

from __future__ import annotations

import argparse
import datetime
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.engine.rollout import roll_out
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine

PAGE = Path(__file__).resolve().parents[1] / "docs" / "performance.md"
BEGIN, END = "<!-- roll-out: begin -->", "<!-- roll-out: end -->"
SIMULATED_S, ENGINE_S, REPEATS = 5.0, 0.5, 7
FIRST_CALL = """
import time
from mech_twin.engine.rollout import roll_out
from mech_twin.parameters.load import machine
built = machine({name!r})
begun = time.process_time()
roll_out(built, 1.0, columns=["time_s"])
print(time.process_time() - begun)
"""
HEAD = (
    "| machine | coupling step | roll-out, times real time | spread | us a step | roles one by one | ratio "
    "| first call, s | aim |"
)
AIMS = {
    "mb10_breaker": 500,
    "compaction_press": 2000,
    "vibration_crank": 2000,
    "impact_mass": None,
    "roller_former": 1500,
    "winding_drum": 2000,
}


class Row(NamedTuple):
    """Measurements of one machine: times real time, their spread, us a step, first call (s)."""

    name: str
    step_s: float
    roll_out: float
    spread: float
    engine: float
    first_s: float


def processor_s(work: Callable[[], object]) -> float:
    """Return the processor time (s) of a call, which other processes do not lengthen."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def stepped(built: Machine) -> None:
    """Run a machine by its roles, one call after the other."""
    frame = complete_frame(built, built.linkage.start(), None, 1.0)
    for _ in range(round(ENGINE_S / built.coupling_step_s)):
        frame = next_frame(built, frame, 1.0)


def measured(name: str) -> Row:
    """Return the measurements of a machine."""
    built = machine(name)
    roll_out(built, 0.01)
    stepped(built)
    taken = [processor_s(lambda: roll_out(built, SIMULATED_S, columns=["time_s"])) for _ in range(REPEATS)]
    engine = min(processor_s(lambda: stepped(built)) for _ in range(3))
    ran = subprocess.run(
        [sys.executable, "-c", FIRST_CALL.format(name=name)], capture_output=True, text=True, check=True
    )
    best = min(taken)
    spread = (statistics.median(taken) - best) / best
    return Row(name, built.coupling_step_s, SIMULATED_S / best, spread, ENGINE_S / engine, float(ran.stdout))


def table(rows: list[Row]) -> str:
    """Return the measurements as a Markdown table."""
    lines = [
        f"Measured {datetime.datetime.now(tz=datetime.UTC):%Y-%m-%d} by `python benchmarks/rollout.py --write`:",
        f"{platform.machine()}, Python {platform.python_version()}, one core, processor time, {SIMULATED_S:g} s of",
        f"each default configuration from its start, best of {REPEATS}; spread: the median over the best.",
        "",
        HEAD,
        "|---" * HEAD.count(" |") + "|",
    ]
    for row in rows:
        cells = (
            row.name,
            f"{row.step_s * 1e3:g} ms",
            f"{row.roll_out:.0f}",
            f"{row.spread:.0%}",
            f"{row.step_s / row.roll_out * 1e6:.2f}",
            f"{row.engine:.1f}",
            f"{row.roll_out / row.engine:.0f}",
            f"{row.first_s:.2f}",
            str(AIMS.get(row.name) or "-"),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("machines", nargs="*")
    asked = parser.parse_args()
    found = table([measured(name) for name in asked.machines or CATALOGUE])
    print(found)
    if asked.write:
        text = PAGE.read_text(encoding="utf-8")
        head, _, rest = text.partition(BEGIN)
        _, _, tail = rest.partition(END)
        PAGE.write_text(f"{head}{BEGIN}\n{found}\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Cost of a coupling step of a page against the machine written by hand, both with force analysis, in one run.

python benchmarks/page_steps.py
"""

from __future__ import annotations

import time
from pathlib import Path

from comparison import put_between, this_machine

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine

PAGES = Path(__file__).resolve().parents[1] / "config" / "pages"
TABLE = PAGES.parents[1] / "docs" / "machines" / "pages.md"
PAIRS = (
    ("impact_mass", "impact_mass", {}),
    ("vibration_crank", "vibration_crank", {}),
    ("compaction_press", "press", {"working_force.peak_n": 0.0}),
    ("roller_former", "roller_former_2", {"load": "none"}),
)
RUN_S, REPEATS = 3.0, 5


def step_cost_us(measured: Machine) -> float:
    """Return the least time of a step over some runs (us)."""
    best = float("inf")
    for _ in range(REPEATS):
        begun = time.perf_counter()
        count = sum(1 for _ in frames(measured, RUN_S))
        best = min(best, (time.perf_counter() - begun) / count)
    return 1e6 * best


def main() -> None:
    """Measure, print the table, and write it into the page of the pages."""
    lines = [f"Measured on {this_machine()}, by `python benchmarks/page_steps.py`.", ""]
    lines += ["| page | machine, us a step | page, us a step | ratio |", "|---|---|---|---|"]
    for name, page, overrides in PAIRS:
        theirs = step_cost_us(machine(name, None, overrides))
        ours = step_cost_us(machine(str(PAGES / f"{page}.yaml")))
        lines.append(f"| `{page}` | {theirs:.1f} | {ours:.1f} | {ours / theirs:.2f} |")
    print("\n".join(lines))
    put_between(TABLE, "page steps", lines)


if __name__ == "__main__":
    main()

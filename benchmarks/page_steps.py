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
    ("mb10_breaker", "breaker", {}),
)
RUN_S, REPEATS = 3.0, 9


def step_costs_us(*measured: Machine) -> list[float]:
    """Return the least processor time of a step of each over some runs, taken by turns (us)."""
    best = [float("inf")] * len(measured)
    for _ in range(REPEATS):
        for i, each in enumerate(measured):
            begun = time.process_time()
            count = sum(1 for _ in frames(each, RUN_S))
            best[i] = min(best[i], (time.process_time() - begun) / count)
    return [1e6 * cost for cost in best]


def main() -> None:
    """Measure, print the table, and write it into the page of the pages."""
    lines = [f"Measured on {this_machine()}, by `python benchmarks/page_steps.py`.", ""]
    lines += ["| page | machine, us a step | page, us a step | ratio |", "|---|---|---|---|"]
    for name, page, overrides in PAIRS:
        theirs, ours = step_costs_us(machine(name, None, overrides), machine(str(PAGES / f"{page}.yaml")))
        lines.append(f"| `{page}` | {theirs:.1f} | {ours:.1f} | {ours / theirs:.2f} |")
    print("\n".join(lines))
    put_between(TABLE, "page steps", lines)


if __name__ == "__main__":
    main()

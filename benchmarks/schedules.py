# SPDX-License-Identifier: Apache-2.0
"""Many schedules of the nodes: ``python benchmarks/schedules.py [--schedules 100000] [--from-seed 0]``.

Each seed gives `EACH` schedules one after the other; a failing seed is named and gives the same schedules again.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
import pytest
from scheduled_run import run_schedules

EACH = 200


def main() -> None:
    """Run the schedules and say how many steps they took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--schedules", type=int, default=100_000)
    parser.add_argument("--from-seed", type=int, default=0)
    asked = parser.parse_args()
    seeds = range(asked.from_seed, asked.from_seed + max(1, asked.schedules // EACH))
    begun, steps = time.process_time(), 0
    patch = pytest.MonkeyPatch()
    for seed in seeds:
        steps += run_schedules(seed, EACH, patch)
        print(f"\rseed {seed}", end="", file=sys.stderr, flush=True)
    spent = time.process_time() - begun
    print(f"\n{len(seeds) * EACH} schedules, {steps} steps, the engine's bits in each; {spent:.0f} s of a processor")


if __name__ == "__main__":
    main()

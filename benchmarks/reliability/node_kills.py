"""Kill each node of a running machine with SIGKILL and restart it, in turn, and hold every step against the engine.

    python benchmarks/reliability/node_kills.py --machine winding_drum --kills 100

Writes one line a kill and a summary; exit code 0 means that every step of the run was the engine's own, to the bit.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
import time
from itertools import cycle
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", "57")

from process_run import ProcessRun


def main() -> None:
    """Run the kills and write what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machine", default="winding_drum")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--pace", default="max")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    chance = random.Random(asked.seed)
    begun = time.monotonic()
    gaps = []
    with tempfile.TemporaryDirectory() as folder, ProcessRun(asked.machine, Path(folder), pace=asked.pace) as run:
        run.start_all()
        for number, role in zip(range(asked.kills), cycle(run.roles), strict=False):
            run.steps(chance.randrange(1, 400), "the run before a kill")
            run.kill(role)
            at = time.monotonic()
            run.spin_for(chance.choice((0.1, 0.3, 0.8)))  # what was under way arrives
            before = run.step
            run.start(role)
            run.steps(50, f"the run after kill {number + 1} ({role})")
            gaps.append(time.monotonic() - at)
            sys.stdout.write(f"{number + 1:4d} {role:15s} step {before:7d} -> {run.checked():7d}  {gaps[-1]:.2f} s\n")
            sys.stdout.flush()
        holds = run.figure("linkage", "holds")
        run.spin_for(1.2)
        sys.stdout.write(
            f"{asked.machine}: {asked.kills} kills in {time.monotonic() - begun:.0f} s, {run.checked() + 1} steps "
            f"equal the engine to the bit, {run.repeated} repeated; gone for {min(gaps):.2f} to {max(gaps):.2f} s; "
            f"holds of the linkage now running: {holds}\n"
        )


if __name__ == "__main__":
    main()

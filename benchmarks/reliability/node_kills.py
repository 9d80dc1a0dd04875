# SPDX-License-Identifier: Apache-2.0
"""Kill each node of a running machine with SIGKILL and restart it, in turn, and hold every step against the engine.

    python benchmarks/reliability/node_kills.py --machine winding_drum --kills 100 [--write]

Prints one line a kill and a summary; ``--write`` adds it to docs/proof/reliability.md.  Exit code 0: every step of
the run was the engine's own, to the bit.
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

from measured import add_rows, here
from process_run import ProcessRun

COLUMNS = ("run", "steps, to the bit", "repeated", "a node was gone for", "took", "made")


def main() -> None:
    """Run the kills and write what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machine", default="winding_drum")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--pace", default="max")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="add the run to the table of docs/proof/reliability.md")
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
        run.spin_for(1.2)
        row = [
            f"{asked.kills} kills of the nodes of {asked.machine}",
            run.checked() + 1,
            run.repeated,
            f"{min(gaps):.1f} to {max(gaps):.1f} s",
            f"{time.monotonic() - begun:.0f} s",
            here(),
        ]
    sys.stdout.write(" | ".join(map(str, row)) + "\n")
    if asked.write:
        add_rows("node_kills", COLUMNS, [row])


if __name__ == "__main__":
    main()

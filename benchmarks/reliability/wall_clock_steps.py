# SPDX-License-Identifier: Apache-2.0
"""Step the wall clock of running nodes by hours, forward and back, and hold every step against the engine.

    apt-get install libfaketime
    python benchmarks/reliability/wall_clock_steps.py [--write]

The nodes alone see the stepped clock (LD_PRELOAD); the steady clock stays.  ``--write`` writes the table into
docs/proof/reliability.md.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", "59")

from measured import write_table
from process_run import ProcessRun

STEPS = ("+0", "+3h", "+30d", "+30d", "-2h", "-30d", "+60d", "+60d")
SECONDS = 4.0
START_LIMIT_S = 300.0  # beside other work, and with kernels to compile


def main() -> None:
    """Run with a clock that jumps, a kill included."""
    libraries = [str(path) for path in Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1")]
    if not libraries:
        raise SystemExit("libfaketime is not installed")
    with tempfile.TemporaryDirectory() as folder:
        clock = Path(folder) / "clock"
        clock.write_text(STEPS[0] + "\n")
        environment = {
            "LD_PRELOAD": libraries[0],
            "FAKETIME_TIMESTAMP_FILE": str(clock),
            "FAKETIME_NO_CACHE": "1",
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",
        }
        rows = []
        with ProcessRun("winding_drum", Path(folder), pace="max") as run:
            run.start_all(environment, START_LIMIT_S)
            for step in STEPS:
                clock.write_text(step + "\n")
                before = run.step
                run.spin_for(SECONDS)
                rows.append([f"`{step}`", f"{(run.step - before) / SECONDS:.0f}", run.checked()])
                sys.stdout.write(" | ".join(map(str, rows[-1])) + "\n")
            sys.stdout.write(f"{run.checked() + 1} steps equal the engine to the bit; nobody ended: {run.alive()}\n")
    if "--write" in sys.argv[1:]:
        write_table("wall_clock_steps", ("wall clock", "steps a second", "steps to the bit so far"), rows)


if __name__ == "__main__":
    main()

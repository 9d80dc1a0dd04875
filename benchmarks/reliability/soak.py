"""Run a machine's nodes, recorded, at full pace, and watch memory, threads and open files of every process.

    python benchmarks/reliability/soak.py --machine winding_drum --minutes 30

Simulated minutes.  Every step is held against the engine, to the bit.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", "58")

from footprint import FootprintLog
from process_run import ProcessRun

from mech_twin.parameters.load import machine

LOOK_EVERY_S = 5.0


def main() -> None:
    """Run the soak and write a table, one row a process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machine", default="winding_drum")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--step-s", type=float, default=0.0, help="coupling step; 0 keeps the configured one")
    asked = parser.parse_args()
    twin = machine(asked.machine, overrides={"coupling.step_s": asked.step_s} if asked.step_s else None)
    steps = round(asked.minutes * 60.0 / twin.coupling_step_s)
    log, begun = FootprintLog(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        with ProcessRun(asked.machine, Path(folder), recorder=True, machine=twin, pace="max") as run:
            run.start_all()
            while run.step < steps:
                run.spin_for(LOOK_EVERY_S)
                run.checked()
                run.diagnostics = run.diagnostics[-50:]
                pids = {role: process.pid for role, process in run.processes.items()}
                log.look(time.monotonic() - begun, pids)
                sys.stderr.write(f"\r{run.step / steps:.1%}")
            counts = run.step + 1, run.repeated, run.finish("recorder")
        size = sum(file.stat().st_size for file in (Path(folder) / "bag").iterdir()) / 2**20
    sys.stdout.write(
        f"\n{asked.machine}: {counts[0]} steps ({asked.minutes:g} min simulated) in {time.monotonic() - begun:.0f} s, "
        f"equal to the engine to the bit, {counts[1]} repeated, bag {size:.0f} MiB\n"
    )
    for role in log.rows:
        sys.stdout.write(f"{role:15s} {log.told(role)}\n")


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Run a machine's nodes, recorded, and watch memory, threads and open files of every process, balances, lag and losses.

    python benchmarks/reliability/soak.py --machine winding_drum --minutes 30    at full pace
    python benchmarks/reliability/soak.py --minutes 480                          eight hours simulated, at full pace
    python benchmarks/reliability/soak.py --minutes 60 --pace realtime --view    by the wall clock, with the web view
    python benchmarks/reliability/soak.py --minutes 10 --pace realtime --view    the form of ten minutes

Simulated minutes.  Every step is held against the engine, to the bit.  ``--write`` writes the run into
docs/reliability.md.  Exit code 1 if a balance broke, a step was missing, or a process grew by more than its limit.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", "58")

from diagnostic_msgs.msg import DiagnosticStatus
from footprint import FootprintLog
from measured import add_rows, here
from process_run import ProcessRun

from mech_twin.parameters.load import machine

LOOK_EVERY_S = 5.0
START_LIMIT_S = 300.0
GROWTH_LIMIT_MIB = 10.0  # of the settled three quarters of a run; the server of the view keeps a history besides
SERVER = "view server"
COLUMNS = ("run", "steps, to the bit", "worst balance over its limit", "lag", "lost", "memory and its growth", "made")
LOSSES = (" missing", " malformed", " conflicting", " timeout")


class Told:
    """What the nodes said of themselves in their diagnostics."""

    def __init__(self, limits: dict[str, float]) -> None:
        self.worst = 0.0
        self.lag_s = self.given_up_s = 0.0
        self.losses: dict[str, int] = {}
        self.errors: set[str] = set()
        self._limits = limits

    def hear(self, statuses: list[DiagnosticStatus]) -> None:
        """Take statuses into account."""
        for status in statuses:
            if status.level == DiagnosticStatus.ERROR:
                self.errors.add(f"{status.name}: {status.message}")
            for pair in status.values:
                self._value(status.name, pair.key, pair.value)

    def _value(self, node: str, key: str, value: str) -> None:
        residual = key.removeprefix("worst ")
        if residual in self._limits:
            self.worst = max(self.worst, float(value) / self._limits[residual])
        elif key == "worst lag s":
            self.lag_s = max(self.lag_s, float(value))
        elif key == "given up s":
            self.given_up_s = max(self.given_up_s, float(value))
        elif key.endswith(LOSSES) and int(value):
            self.losses[f"{node} {key}"] = int(value)


def main() -> int:
    """Run the soak and write what was seen, one line a process."""
    asked = arguments()
    twin = machine(asked.machine, overrides={"coupling.step_s": asked.step_s} if asked.step_s else None)
    steps = round(asked.minutes * 60.0 / twin.coupling_step_s)
    roles = [twin.linkage, twin.forces, *([twin.body] if twin.body is not None else [])]
    told = Told({name: limit for role in roles for name, limit in role.residual_limits.items()})
    log, begun = FootprintLog(), time.monotonic()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        run = ProcessRun(twin.name, folder, recorder=True, machine=twin, pace=asked.pace, viewer=asked.view)
        stack.enter_context(run)
        others = started_view(stack, run) if asked.view else {}
        run.start_all(limit_s=START_LIMIT_S)
        while run.step < steps:
            run.spin_for(LOOK_EVERY_S)
            run.checked()
            told.hear(run.diagnostics)
            run.diagnostics.clear()
            pids = {role: process.pid for role, process in run.processes.items()}
            log.look(time.monotonic() - begun, {**pids, **others})
            sys.stderr.write(f"\r{run.step / steps:.1%}")
        count, repeated = run.step + 1, run.repeated
        run.finish("recorder")
        size = sum(file.stat().st_size for file in run.bag.iterdir()) / 2**20
    took_s = time.monotonic() - begun
    print(f"\n{twin.name}: {count} steps ({asked.minutes:g} min simulated) in {took_s:.0f} s, to the bit")
    print(f"{repeated} repeated, bag {size:.0f} MiB; worst balance {told.worst:.3g} of its limit")
    print(f"worst lag {told.lag_s:.3f} s, given up {told.given_up_s:.1f} s, lost {told.losses or 'nothing'}")
    for role in log.rows:
        print(f"{role:15s} {log.told(role)}")
    print(*sorted(told.errors), sep="\n")
    grown = {role: log.growth_mib(role) for role in log.rows if role != SERVER}
    if asked.write:
        add_rows("soak", COLUMNS, [row(asked, count, took_s, told, log)])
    return int(bool(told.errors) or any(mib > GROWTH_LIMIT_MIB for mib in grown.values()))


def started_view(stack: ExitStack, run: ProcessRun) -> dict[str, int]:
    """Start the web view's server and the node that feeds it; return the process of the server."""
    from mech_twin.view.viewer_process import ViewerProcess

    server = stack.enter_context(ViewerProcess())
    run.start("viewer", "--place", server.grpc_url)
    return {SERVER: server.pid or 0}


def row(asked: argparse.Namespace, count: int, took_s: float, told: Told, log: FootprintLog) -> list[Any]:
    """Return the row of the table."""
    step = f", step {asked.step_s:g} s" if asked.step_s else ""
    view = ", web view" if asked.view else ""
    what = f"{asked.machine}, {asked.minutes:g} min simulated, pace {asked.pace}{view}{step}"
    lag = f"at most {told.lag_s:.2f} s, {told.given_up_s:.0f} s given up" if asked.pace == "realtime" else "-"
    memory = ", ".join(
        f"{role} {log.settled(role)[-1].memory_mib:.0f} MiB ({log.growth_mib(role):+.1f})" for role in log.rows
    )
    lost = ", ".join(f"{name} {number}" for name, number in told.losses.items()) or "nothing"
    return [what, f"{count} in {took_s:.0f} s", f"{told.worst:.2g}", lag, lost, memory, here()]


def arguments() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machine", default="mb10_breaker")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--pace", choices=("max", "realtime"), default="max")
    parser.add_argument("--view", action="store_true", help="with the web view, its node and its server")
    parser.add_argument("--step-s", type=float, default=0.0, help="coupling step; 0 keeps the configured one")
    parser.add_argument("--write", action="store_true", help="add the run to the table of docs/reliability.md")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""Run a machine's nodes, recorded, and watch memory, threads and open files of every process, balances, lag and losses.

    python benchmarks/reliability/soak.py --machine winding_drum --minutes 30    at full pace
    python benchmarks/reliability/soak.py --minutes 480                          eight hours simulated, at full pace
    python benchmarks/reliability/soak.py --minutes 60 --pace realtime --view    by the wall clock, with the web view
    python benchmarks/reliability/soak.py --minutes 10 --pace realtime --view    the form of ten minutes

Simulated minutes.  While it runs only the diagnostics are listened to; when it has ended, every sample of the recording
is held against the engine, to the bit.  A signal ends the run early, and what ran is compared and judged; a second one
ends the comparison.  ``--write`` writes the run into docs/proof/reliability.md, one that ended early as well.

Exit code 1, and a line for each, if a balance broke, a sample differed or was missing, a run by the wall clock was
behind it after it had settled, or a process grew by more than its limit.  A run settles in its first quarter, in ten
minutes at most; the view's server is judged where it had twenty minutes to fill its history.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", "58")

import psutil
from footprint import FootprintLog
from measured import add_rows, here
from process_run import ProcessRun
from soak_report import SERVER, Comparison, Told, faults, lag_cell, memory_cell

from mech_twin.nodes.run.domain import PARENT
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine

LOOK_EVERY_S = 5.0
START_LIMIT_S = 300.0
STANDS_STILL_S = 120.0
FINISH_LIMIT_S = 60.0
COLUMNS = ("run", "steps, to the bit", "worst balance over its limit", "lag", "lost", "memory and its growth", "made")


class Soak:
    """A run that is watched: what was seen, and what ended it before its time."""

    def __init__(self, asked: argparse.Namespace, twin: Machine) -> None:
        self.asked = asked
        self.twin = twin
        roles = [twin.linkage, twin.forces, *([twin.body] if twin.body is not None else [])]
        self.told = Told({name: limit for role in roles for name, limit in role.residual_limits.items()})
        self.log = FootprintLog()
        self.compared = Comparison()
        self.ended = ""
        self.interrupted = False
        self.took_s = 0.0
        self.last_step = -1
        self._end_asked = False

    def watch(self, folder: Path) -> Path:
        """Run to the end, or until something ends it; return the recording."""
        asked = self.asked
        os.environ[PARENT] = str(os.getpid())
        steps = round(asked.minutes * 60.0 / self.twin.coupling_step_s)
        with ExitStack() as stack:
            run = ProcessRun(
                self.twin.name,
                folder,
                recorder=True,
                machine=self.twin,
                hears_steps=False,
                pace=asked.pace,
                viewer=asked.view,
            )
            stack.enter_context(run)
            begun = time.monotonic()
            try:
                others = started_view(stack, run) if asked.view else {}
                run.start_all(limit_s=START_LIMIT_S)
                answer_signals(self._ask_end)  # from now on ROS calls back: what is raised there is lost
                self._look_until(steps, run, others, begun)
            except KeyboardInterrupt:
                self.ended = "ended by a signal"
            except (AssertionError, psutil.Error, OSError) as error:
                self.ended = f"ended early: {error}"
            answer_signals(signal.SIG_IGN)  # what was seen so far is kept, whoever presses twice
            self.took_s = time.monotonic() - begun
            self.last_step = run.step
            code = run.finish("recorder", FINISH_LIMIT_S) if "recorder" in run.processes else 0
            if code:
                self.ended += f" the recorder ended with {code}: {run.log('recorder')[-500:]}"
        self._end_asked = False
        answer_signals(self._ask_end)
        return run.bag

    def _ask_end(self, number: int, frame: FrameType | None) -> None:
        self._end_asked = True

    def _look_until(self, steps: int, run: ProcessRun, others: dict[str, int], begun: float) -> None:
        newest, moved = -1, time.monotonic()
        while run.step < steps:
            run.spin_for(LOOK_EVERY_S)
            if self._end_asked:
                raise KeyboardInterrupt
            now = time.monotonic()
            self.told.hear(now - begun, run.diagnostics)
            run.diagnostics.clear()
            newest, moved = (run.step, now) if run.step > newest else (newest, moved)
            gone = [
                f"{role} ended: {run.log(role)[-500:]}" for role, it in run.processes.items() if it.poll() is not None
            ]
            assert not gone, "; ".join(gone)
            assert now - moved < STANDS_STILL_S, f"step {newest} was the last for {now - moved:.0f} s"
            self.log.look(now - begun, {**{role: process.pid for role, process in run.processes.items()}, **others})
            self._show(run.step, steps)

    @staticmethod
    def _show(step: int, last: int) -> None:
        sys.stderr.write(f"\r{step / max(last, 1):.1%}")

    def compare(self, bag: Path) -> None:
        """Hold the recording against the engine; a signal ends that."""
        try:
            self.compared.run(bag, self.twin, self._compared)
        except KeyboardInterrupt:
            self.interrupted = True

    def _compared(self, step: int) -> None:
        self._show(step, self.last_step)
        if self._end_asked:
            raise KeyboardInterrupt

    def write(self) -> None:
        """Put the row into the page, in place of one of the same run."""
        if self.log.rows:
            add_rows("soak", COLUMNS, [row(self)])

    def faults(self) -> list[str]:
        """Return everything about the run that must not be."""
        ended = [self.ended.strip()] if self.ended else []
        ended += [f"comparison ended by a signal after {self.compared.steps} steps"] * self.interrupted
        return ended + faults(self.told, self.log, self.compared, self.asked.pace == "realtime")


def main() -> int:
    """Run the soak and write what was seen, one line a process."""
    asked = arguments()
    answer_signals(interrupt)
    soak = Soak(asked, machine(asked.machine, overrides={"coupling.step_s": asked.step_s} if asked.step_s else None))
    with tempfile.TemporaryDirectory() as folder:
        bag = soak.watch(Path(folder))
        if asked.write:  # the comparison takes a fifth of the time that was simulated: a row stands before it
            soak.write()
        size = sum(file.stat().st_size for file in bag.iterdir()) / 2**20 if bag.is_dir() else 0.0
        sys.stderr.write(f"\n{soak.last_step} steps in {soak.took_s:.0f} s, recording {size:.0f} MiB; comparing\n")
        if size:
            soak.compare(bag)
    sys.stdout.write(f"{row(soak)}\n")
    for role in soak.log.rows:
        sys.stdout.write(f"{role:15s} {soak.log.told(role)}\n")
    found = soak.faults()
    sys.stdout.write("".join(f"fault: {line}\n" for line in found))
    if asked.write:
        soak.write()
    return int(bool(found))


def answer_signals(answer: Any) -> None:
    """Answer every signal that ends a run alike."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, answer)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Take a signal as Ctrl-C."""
    raise KeyboardInterrupt


def started_view(stack: ExitStack, run: ProcessRun) -> dict[str, int]:
    """Start the web view's server and the node that feeds it, as `mech-twin run` does; return the server's process."""
    from mech_twin.view.bench.started import StartedBench

    server = stack.enter_context(StartedBench())
    run.start("viewer", "--place", server.place)
    return {SERVER: server.pid or 0}


def row(soak: Soak) -> list[Any]:
    """Return the row of the table."""
    asked, compared = soak.asked, soak.compared
    step = f", step {asked.step_s:g} s" if asked.step_s else ""
    view = ", web view" if asked.view else ""
    ended = f", {soak.ended.strip()}" if soak.ended else ""
    what = f"{asked.machine}, {asked.minutes:g} min simulated, pace {asked.pace}{view}{step}{ended}"
    lag = lag_cell(soak.told, soak.log) if asked.pace == "realtime" else "-"
    losses = {**soak.told.losses, **compared.lost} | ({"samples": compared.missing} if compared.missing else {})
    lost = ", ".join(f"{name} {number}" for name, number in losses.items()) or "nothing"
    partly = "" if compared.complete else f" of {soak.last_step + 1}, others not compared,"
    steps = f"{compared.steps}{partly} in {soak.took_s:.0f} s" + (f", then {compared.first}" if compared.first else "")
    cells = [what, steps, f"{soak.told.worst:.2g}", lag, lost, memory_cell(soak.log), here()]
    return [" ".join(str(cell).replace("|", "/").split()) for cell in cells]


def arguments() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machine", default="mb10_breaker")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--pace", choices=("max", "realtime"), default="max")
    parser.add_argument("--view", action="store_true", help="with the web view, its node and its server")
    parser.add_argument("--step-s", type=float, default=0.0, help="coupling step; 0 keeps the configured one")
    parser.add_argument("--write", action="store_true", help="add the run to the table of docs/proof/reliability.md")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())

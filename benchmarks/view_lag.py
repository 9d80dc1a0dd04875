# SPDX-License-Identifier: Apache-2.0
"""How far the browser's view lags behind a run, what a frame and each panel cost, memory of browser and server.

Each machine runs in this process in real time into the viewer, and Chromium without a window, which draws on the
processor, shows it.  Lag is the run's clock less the time the page shows (the cursor of the viewer's own state), looked
at twice a second after the page has come up; frames are counted where the page draws them.

Run with ``python benchmarks/view_lag.py [MACHINE ...] [--layout light|full] [--seconds S] [--panels] [--write]``.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun.blueprint as rrb

sys.path.insert(0, str(Path(__file__).parent.parent / "test"))

from browser import Page
from comparison import Table, measure

from mech_twin.cli.live_view import LIVE_HISTORY
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine as load
from mech_twin.samples import Drawing
from mech_twin.view.flow import Flow
from mech_twin.view.layout import banner_view, blueprint, mechanism_view, page, plot
from mech_twin.view.rerun_scene import RerunScene
from mech_twin.view.sending import LIVE
from mech_twin.view.viewer_process import ViewerProcess

SECONDS, LOOK_S, SETTLE_S = 20.0, 0.5, 3.0
UP_LIMIT_S = 240.0
ALLOWED_S = 0.5  # of lag, beside one frame
PANEL_MACHINE, PANEL_S = "mb10_breaker", 8.0
TICKS = os.sysconf("SC_CLK_TCK")


class Feed(threading.Thread):
    """A run in real time, shown in a scene until stopped."""

    def __init__(self, name: str, scene: RerunScene) -> None:
        super().__init__()
        self._machine, self._scene = load(name), scene
        self.stop = threading.Event()
        self.time_s = self.view_cpu_s = 0.0

    def run(self) -> None:
        """Step, wait for the wall clock, show."""
        machine, begin = self._machine, time.monotonic()
        if machine.mechanism is not None:
            self._scene.know(machine.mechanism, machine.blow_energy)
        for frame in frames(machine, 1e6):
            while frame.linkage.time_s > time.monotonic() - begin and not self.stop.is_set():
                time.sleep(0.005)
            if self.stop.is_set():
                return
            before = time.thread_time()
            self._scene.frame(frame.motor, frame.linkage, frame.forces, frame.body)
            for event in frame_events(frame):
                self._scene.event(event)
            if self._scene.drawing_due(frame.linkage.time_s):
                shapes = machine.draw(frame.linkage, frame.body)
                self._scene.drawing(Drawing(frame.linkage.step, frame.linkage.time_s, shapes))
            self.view_cpu_s += time.thread_time() - before
            self.time_s = frame.linkage.time_s


class Use(NamedTuple):
    """Processor time (s) and resident memory (MiB) of some processes."""

    cpu_s: float
    memory_mib: float


class Shown(NamedTuple):
    """A run that is shown: the scene, what feeds it, and the page."""

    scene: RerunScene
    feed: Feed
    page: Page


def children(pid: int) -> list[Path]:
    """Return the folders in /proc of all processes below one."""
    below: dict[int, list[Path]] = {}
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdecimal():
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                below.setdefault(parent, []).append(entry)
        except OSError:  # the process has ended
            continue
    found, left = [], [pid]
    while left:
        for entry in below.get(left.pop(), []):
            found.append(entry)
            left.append(int(entry.name))
    return found


def used(*words: str) -> Use:
    """Return what those processes below this one use whose command line holds one of the words."""
    cpu_s = memory_mib = 0.0
    for entry in children(os.getpid()):
        try:
            command = (entry / "cmdline").read_text()
            numbers = (entry / "stat").read_text().rpartition(")")[2].split()
            pages = int((entry / "statm").read_text().split()[1])
        except OSError:
            continue
        if any(word in command for word in words):
            cpu_s += (int(numbers[11]) + int(numbers[12])) / TICKS
            memory_mib += pages * os.sysconf("SC_PAGE_SIZE") / 2**20
    return Use(cpu_s, memory_mib)


browser_use = partial(used, "--type=renderer", "--type=gpu-process")
server_use = partial(used, "rerun_cli/rerun")


@contextmanager
def shown(name: str, layout: str) -> Iterator[Shown]:
    """Yield a machine that runs and a page that has come up and shows it."""
    with (
        ViewerProcess(memory_limit=LIVE_HISTORY, newest_first=True) as viewer,
        RerunScene(
            name,
            grpc_url=viewer.grpc_url,
            sending=LIVE,
            light=lambda: layout == "light",
            flow=Flow(viewer.reports_directory),
        ) as scene,
    ):
        feed = Feed(name, scene)
        feed.start()
        try:
            with Page(viewer.web_url, counted=True) as opened:
                end = time.monotonic() + UP_LIMIT_S
                while opened.shown_s() <= 0.0:
                    if time.monotonic() > end:
                        raise TimeoutError(f"{name}: the page showed nothing within {UP_LIMIT_S:g} s")
                    opened.wait(LOOK_S)
                opened.wait(SETTLE_S)
                yield Shown(scene, feed, opened)
        finally:
            feed.stop.set()
            feed.join()


def lag_row(name: str, layout: str, seconds: float) -> Sequence[object]:
    """Return the row of a machine."""
    with shown(name, layout) as (_, feed, opened):
        opened.frames()
        before, server, view_s, clock_s = browser_use(), server_use(), feed.view_cpu_s, feed.time_s
        begin, lags = time.monotonic(), []
        while time.monotonic() - begin < seconds:
            opened.wait(LOOK_S)
            seen = opened.shown_s()
            lags.append(feed.time_s - seen)
        passed, count = time.monotonic() - begin, max(opened.frames(), 1)
        after, server_after = browser_use(), server_use()
        share = (feed.view_cpu_s - view_s) / (feed.time_s - clock_s)
    allowed = passed / count + ALLOWED_S
    inside = float(np.mean(np.array(lags) <= allowed))
    return (
        name,
        f"{count / passed:.1f}",
        f"{1e3 * (after.cpu_s - before.cpu_s) / count:.0f}",
        f"{np.median(lags):.2f}",
        f"{max(lags):.2f}",
        f"{allowed:.2f}",
        f"{100.0 * inside:.0f} %",
        f"{before.memory_mib:.0f} - {after.memory_mib:.0f}",
        f"{server.memory_mib:.0f} - {server_after.memory_mib:.0f}",
        f"{100.0 * share:.1f} %",
    )


def lag_table(machines: Sequence[str], layout: str, seconds: float) -> Table:
    """Return lag, frames and memory of the machines."""
    columns = (
        "machine",
        "frames a second",
        "processor time a frame, ms",
        "lag, median, s",
        "largest, s",
        "a frame and 0.5 s",
        "looks within that",
        "memory of the browser, MiB",
        "of the server, MiB",
        "view in the run, of a core",
    )
    how = (
        f"The {layout} layout in Chromium without a window and without a graphics card, 1400 x 900, {seconds:g} s each "
        "from when the page shows something; memory at the beginning and at the end."
    )
    return Table(how, columns, [lag_row(name, layout, seconds) for name in machines])


def panel_table() -> Table:
    """Return what a frame costs the browser by what it shows."""
    with shown(PANEL_MACHINE, "full") as (scene, _, opened):
        contents = scene.contents
        assert contents is not None
        pins = plot("Pin reactions, N", ["pins/magnitude"], 1.0)
        torque = plot("Torque, N m", ["motor/torque"], 1.0)
        layouts = {
            "state": page(rrb.Vertical(banner_view())),
            "mechanism": page(rrb.Vertical(mechanism_view(contents.bounds))),
            "one plot": page(rrb.Vertical(pins)),
            "two plots": page(rrb.Vertical(pins, torque)),
            "light layout": blueprint(contents, 1.0, light=True),
            "full layout": blueprint(contents, 1.0),
        }
        rows = []
        for name, layout in layouts.items():
            scene.stream.send_blueprint(layout)
            opened.wait(SETTLE_S)
            opened.frames()
            before, begin = browser_use(), time.monotonic()
            opened.wait(PANEL_S)
            count, passed = max(opened.frames(), 1), time.monotonic() - begin
            rows.append((name, f"{1e3 * (browser_use().cpu_s - before.cpu_s) / count:.0f}", f"{count / passed:.1f}"))
    how = f"What a frame costs the browser by what it shows, `{PANEL_MACHINE}`, {PANEL_S:g} s each."
    return Table(how, ("shown", "processor time a frame, ms", "frames a second"), rows)


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINE", default=list(CATALOGUE))
    parser.add_argument("--layout", choices=("light", "full"), default="light")
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--panels", action="store_true", help="also what each panel costs")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/performance.md")
    asked = parser.parse_args()

    def measured() -> list[Table]:
        tables = [lag_table(asked.machines, asked.layout, asked.seconds)]
        return [*tables, panel_table()] if asked.panels else tables

    measure("view_lag", measured, write=asked.write)


if __name__ == "__main__":
    main()

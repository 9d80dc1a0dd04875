# SPDX-License-Identifier: Apache-2.0
"""How far the browser's view lags behind a run, what a frame costs, and the memory of browser and server.

A machine runs in this process in real time into the viewer; Chromium without a window opens the page.  The time the
page shows is read from the viewer's own state, frames are counted where the page draws them.

Run with ``python benchmarks/view_lag.py MACHINE [--layout light|full] [--seconds S] [--join S]``.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "test"))

from browser import Page

from mech_twin.cli.live_view import LIVE_HISTORY
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events
from mech_twin.parameters.load import machine as load
from mech_twin.samples import Drawing
from mech_twin.view.flow import Flow
from mech_twin.view.rerun_scene import RerunScene
from mech_twin.view.sending import LIVE
from mech_twin.view.viewer_process import ViewerProcess

EVERY_S = 10.0
ROW = "{:>8} {:>10} {:>8} {:>9} {:>12} {:>12} {:>9} {:>6}"


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


def resident_mib(word: str) -> float:
    """Return the greatest resident memory of a process whose command line holds a word (MiB)."""
    largest = 0.0
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdecimal() and word in (entry / "cmdline").read_text():
                pages = int((entry / "statm").read_text().split()[1])
                largest = max(largest, pages * os.sysconf("SC_PAGE_SIZE") / 2**20)
        except OSError:  # the process has ended
            continue
    return largest


def main() -> None:
    """Print a row every ten seconds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("machine")
    parser.add_argument("--layout", choices=("light", "full"), default="light")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--join", type=float, default=0.0, help="seconds after which the page is opened")
    asked = parser.parse_args()
    with (
        ViewerProcess(memory_limit=LIVE_HISTORY, newest_first=True) as viewer,
        RerunScene(
            asked.machine,
            grpc_url=viewer.grpc_url,
            sending=LIVE,
            light=lambda: asked.layout == "light",
            flow=Flow(viewer.reports_directory),
        ) as scene,
    ):
        feed = Feed(asked.machine, scene)
        feed.start()
        try:
            time.sleep(asked.join)
            with Page(viewer.web_url, counted=True) as page:
                watch(page, feed, asked.seconds)
        finally:
            feed.stop.set()
            feed.join()


def watch(page: Page, feed: Feed, seconds: float) -> None:
    """Print lag, frames and memory of a page for a while."""
    print(ROW.format("wall, s", "clock, s", "lag, s", "frames/s", "browser, MiB", "server, MiB", "view, %", "load"))
    begin = last = time.monotonic()
    while time.monotonic() - begin < seconds:
        page.wait(EVERY_S)
        shown, count = page.shown_s(), page.frames()
        now, clock = time.monotonic(), feed.time_s
        print(
            ROW.format(
                f"{now - begin:.0f}",
                f"{clock:.1f}",
                f"{clock - shown:.2f}",
                f"{count / (now - last):.2f}",
                f"{resident_mib('--type=renderer'):.0f}",
                f"{resident_mib('rerun_cli/rerun'):.0f}",
                f"{100.0 * feed.view_cpu_s / max(clock, 1e-9):.1f}",
                f"{os.getloadavg()[0]:.1f}",
            ),
            flush=True,
        )
        last = now


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""How far the bench in a browser lags behind a run, how soon it obeys, what it costs.

Each machine runs as ``mech-twin run`` does, in real time, and Chromium without a window, which draws on the processor,
shows its page.  Lag is the newest time the run has told its bench less the time the page has drawn, both read in the
page; orders are timed from the click to the answer of the node, and to the first picture that shows the change.
Trials are timed from the movement of a slider to the drawn curves; their processor time is all that browser,
bench and roll-out take meanwhile, the pictures of the run that goes on included: other programs do not lengthen it.

Run with ``python benchmarks/view_lag.py [MACHINE ...] [--seconds S] [--write]``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "test"))

from browser import FLAGS, chromium
from comparison import Table, measure
from playwright.sync_api import Page, sync_playwright

from mech_twin.machines.catalog import CATALOGUE

SECONDS, SETTLE_S = 10.0, 2.0
UP_LIMIT_MS = 240_000
ORDERS, TRIALS = 8, 40
TICKS = os.sysconf("SC_CLK_TCK")
BROWSER, BENCH = ("--type=renderer", "--type=gpu-process"), ("bench_process",)
COMMAND = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
# at each frame the age of what it shows: since the run sent it, by the wall clock that both ends read
WATCH = """() => { window.ages = []; window.bench.frames = 0;
  window.bench.onshow = (picture) => window.ages.push(Date.now() / 1000 - picture.sent_s); }"""
TIMED = """async (wanted) => {
  const start = performance.now();
  const seen = new Promise((done) => {
    window.bench.onshow = (picture) => { if (Math.abs(picture.command - wanted) < 0.002) done(performance.now()); };
  });
  const first = document.getElementById("answers").firstChild;
  const speed = document.getElementById("speed");
  speed.value = wanted;
  speed.dispatchEvent(new Event("change"));
  while (document.getElementById("answers").firstChild === first) await new Promise((next) => setTimeout(next, 1));
  const answered = performance.now();
  return [answered - start, (await seen) - start];
}"""

# trials of a value while its slider moves, from the movement to the curves; the first loads the machine
TRIED = """async (count) => {
  const slider = document.querySelector("#keys input[type=range]");
  for (let n = 0; slider && n <= count; n += 1) {
    const seen = new Promise((done) => { window.bench.onghost = done; setTimeout(done, 30000); });
    slider.value = slider.value * (n % 2 ? 1.02 : 0.98);
    slider.dispatchEvent(new Event("input"));
    await seen;
  }
  return window.bench.ghosts.slice(1);
}"""


class Use(NamedTuple):
    """Processor time (s) and resident memory (MiB) of some processes."""

    cpu_s: float
    memory_mib: float


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


@contextmanager
def shown(name: str) -> Iterator[Page]:
    """Yield the page of a machine that runs, once it shows it."""
    words = [*COMMAND, "run", name, "--no-record"]
    run = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert run.stderr is not None
    try:
        url = next(line.split("view: ", 1)[1].strip() for line in run.stderr if line.startswith("view: "))
        threading.Thread(target=run.stderr.read, daemon=True).start()
        with sync_playwright() as play:
            browser = play.chromium.launch(executable_path=chromium(), headless=True, args=FLAGS)
            page = browser.new_page(viewport={"width": 1280, "height": 720})
            page.goto(url)
            page.wait_for_function("() => window.bench.shown > 0.5", timeout=UP_LIMIT_MS)
            page.wait_for_timeout(1000 * SETTLE_S)
            yield page
            browser.close()
    finally:
        run.terminate()
        run.wait(30)


def rows(name: str, seconds: float) -> tuple[Sequence[Any], Sequence[Any]]:
    """Return the row of lag and cost of a machine, and the row of its answers to orders and of its trials."""
    with shown(name) as page:
        page.evaluate(WATCH)
        (browser, bench), passed = spent(lambda: page.wait_for_timeout(1000 * seconds))
        ages = np.array(page.evaluate("() => window.ages"))
        answers = np.array([page.evaluate(TIMED, [0.95, 1.0][n % 2]) for n in range(ORDERS)])
        page.evaluate(TRIED, 1)  # the first one loads the machine
        page.evaluate("() => { window.bench.ghosts.length = 0; }")
        trials: list[float] = []
        (browser_then, bench_then), _ = spent(lambda: trials.extend(page.evaluate(TRIED, TRIALS)))
        memory = used(*BROWSER), used(*BENCH)
    load = os.getloadavg()[0]
    lag = (
        name,
        f"{load:.1f}",
        f"{len(ages) / passed:.1f}",
        *(f"{1e3 * np.percentile(ages, part):.0f}" for part in (50, 95, 100)),
        f"{100.0 * browser / passed:.0f} %",
        f"{100.0 * bench / passed:.0f} %",
        *(f"{each.memory_mib:.0f}" for each in memory),
    )
    told = [f"{np.percentile(answers[:, column], part):.0f}" for column in (0, 1) for part in (50, 95)]
    tried = [f"{np.percentile(trials, part):.0f}" for part in (50, 95)] if trials else ["-", "-"]
    each_ms = 1e3 * (browser_then + bench_then) / (len(trials) + 1)
    return lag, (name, *told, *tried, f"{each_ms:.0f}" if trials else "-")


def spent(act: Callable[[], object]) -> tuple[tuple[float, float], float]:
    """Return the processor time (s) of browser and bench, and the time (s), while something is done."""
    before, begin = (used(*BROWSER), used(*BENCH)), time.monotonic()
    act()
    after = used(*BROWSER), used(*BENCH)
    browser, bench = (now.cpu_s - then.cpu_s for now, then in zip(after, before, strict=True))
    return (browser, bench), time.monotonic() - begin


def tables(machines: Sequence[str], seconds: float) -> list[Table]:
    """Return lag and cost, and answers to orders."""
    found = [rows(name, seconds) for name in machines]
    columns = (
        "machine",
        "load",
        "pictures a second",
        "lag, median, ms",
        "95 %, ms",
        "largest, ms",
        "browser, of a core",
        "bench, of a core",
        "memory of the browser, MiB",
        "of the bench, MiB",
    )
    how = (
        "The bench of `mech-twin run MACHINE` in Chromium without a window and without a graphics card, 1280 x 720, "
        f"{seconds:g} s each on the two cores that also run the machine. Lag: from the run's sending a picture to its "
        "being drawn."
    )
    orders = (
        "machine",
        "answer, median, ms",
        "95 %, ms",
        "seen, median, ms",
        "95 %, ms",
        "trial, median, ms",
        "95 %, ms",
        "processor, ms",
    )
    asked = (
        f"{ORDERS} changes of the speed between 95 % and 100 % from the page: until the answer stands there, "
        "and until a picture shows the supply at the new share (the ramp of the supply included). "
        f"Trial: from a movement of a slider to the drawn dashed curves of the next 0.3 s, {TRIALS} in a row. "
        "The last column is the processor time of browser, bench and roll-out for each, the pictures that go on "
        "included: above a load of 2 read that, and not the times."
    )
    return [Table(how, columns, [lag for lag, _ in found]), Table(asked, orders, [told for _, told in found])]


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINE", default=list(CATALOGUE))
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--write", action="store_true", help="put the tables into docs/proof/performance.md")
    asked = parser.parse_args()
    measure("view_lag", lambda: tables(asked.machines, asked.seconds), write=asked.write)


if __name__ == "__main__":
    main()

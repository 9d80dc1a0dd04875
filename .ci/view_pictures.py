# SPDX-License-Identifier: Apache-2.0
"""Photograph the bench of machines that run for the documentation, in a real browser.

Usage: PYTHONPATH=. python .ci/view_pictures.py [PICTURE...], such as view_vibration_crank; all without one.
Needs Chromium.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "test"))

from browser import FLAGS, chromium  # noqa: E402 - beside the tests
from playwright.sync_api import sync_playwright  # noqa: E402

COMMAND = [sys.executable, "-m", "mech_twin"]
ADDRESS = "view: "
SIZE = {"width": 1280, "height": 720}
LIMIT_MS = 300_000
SHOWN_S = 4.0  # of the machine's time, by which the curves are full
SHADOW = "view_shadow"
PICTURES = {
    f"view_{name}": ("run", name, "--no-record")
    for name in ("mb10_breaker", "compaction_press", "vibration_crank", "impact_mass", "roller_former", "winding_drum")
} | {SHADOW: ("shadow", "vibration_crank", "--from", "plant", "--view", "web")}
PLANT = ("run", "vibration_crank", "--namespace", "plant", "--no-record", "--view", "none")


@contextmanager
def running(words: tuple[str, ...]) -> Iterator[subprocess.Popen[str]]:
    """Yield a command that runs, and end it."""
    process = subprocess.Popen([*COMMAND, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(60)


def photograph(name: str, file: Path) -> None:
    """Run, open the bench, and keep what it shows when the curves are full."""
    with ExitStack() as stack:
        if name == SHADOW:
            stack.enter_context(running(PLANT))
        process = stack.enter_context(running(PICTURES[name]))
        assert process.stderr is not None
        url = next(line for line in process.stderr if line.startswith(ADDRESS)).removeprefix(ADDRESS).strip()
        threading.Thread(target=process.stderr.read, daemon=True).start()
        play = stack.enter_context(sync_playwright())
        browser = play.chromium.launch(executable_path=chromium(), headless=True, args=FLAGS)
        stack.callback(browser.close)
        page = browser.new_page(viewport=SIZE)
        page.goto(url)
        page.wait_for_function("() => window.bench.shown > 0", timeout=LIMIT_MS)
        begin = page.evaluate("() => window.bench.shown")
        page.wait_for_function(f"() => window.bench.shown > {begin + SHOWN_S}", timeout=LIMIT_MS)
        page.screenshot(path=file)


def main() -> None:
    """Photograph what is named."""
    for name in sys.argv[1:] or PICTURES:
        photograph(name, ROOT / "docs" / "images" / f"{name}.png")


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Chromium without a window, looking at the viewer's page: what the picture holds and whether it moves."""

from __future__ import annotations

import io
import os
import re
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt
from PIL import Image
from playwright.sync_api import Error, sync_playwright

Picture = npt.NDArray[np.uint8]

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--no-proxy-server",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # nothing but this machine is reachable
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
]
CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "chrome")
NOISE = 12
# the viewer's state, in which the name of the time line is followed by its kind and the time of the cursor (ns)
STATE = "() => window._handle ? Array.from(window._handle.viewer_state()) : []"
COUNT = """
  window._frames = 0;
  const ask = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (draw) => ask((now) => { window._frames += 1; draw(now); });
"""
CURSOR = re.compile(rb".*sim_time\x10\x02\x1a.[\x08\x10]", re.DOTALL)  # the last one: the first is the data's range


def chromium() -> str:
    """Return the browser's binary: ``CHROMIUM`` of the environment, else the first one on the path."""
    named = os.environ.get("CHROMIUM")
    found = [named] if named else [path for name in CHROMIUM if (path := shutil.which(name))]
    if not found:
        raise FileNotFoundError("no Chromium on the path; install it or name it in the variable CHROMIUM")
    return found[0]


class Page:
    """The viewer's page in a browser of its own; a context manager.

    Parameters
    ----------
    url : str
        What to open (``ViewerProcess.web_url``).
    width, height : int
        Size of the picture in pixels.
    scheme : str
        ``dark`` or ``light``.
    counted : bool
        Whether to count the frames the page draws.
    """

    def __init__(
        self, url: str, *, width: int = 1400, height: int = 900, scheme: str = "dark", counted: bool = False
    ) -> None:
        self._counted = counted
        self._url = url
        self._size = {"width": width, "height": height}
        self._scheme = scheme
        self.messages: list[str] = []

    def __enter__(self) -> Page:
        self._playwright = sync_playwright().start()
        self._browser = self._playwright.chromium.launch(executable_path=chromium(), headless=True, args=FLAGS)
        self._page = self._browser.new_page(viewport=self._size, color_scheme=self._scheme)
        self._page.on("console", lambda message: self.messages.append(message.text))
        if self._counted:
            self._page.add_init_script(COUNT)
        self._page.goto(self._url, wait_until="domcontentloaded", timeout=60_000)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._browser.close()
        self._playwright.stop()

    def wait(self, seconds: float) -> None:
        """Let the page live for a while."""
        self._page.wait_for_timeout(1000.0 * seconds)

    def frames(self) -> int:
        """Return how many frames the page has drawn since it was last asked."""
        return int(self._page.evaluate("() => { const n = window._frames; window._frames = 0; return n; }"))

    def shown_s(self) -> float:
        """Return the simulated time the page shows (s); 0 before it shows any."""
        state = bytes(self._page.evaluate(STATE))
        found = CURSOR.match(state)
        value = 0
        for place, byte in enumerate(state[found.end() :] if found else b""):
            value |= (byte & 127) << 7 * place  # a variable-length integer: seven bits a byte, the lowest first
            if byte < 128:
                break
        return value * 1e-9

    def picture(self, path: Path | None = None) -> Picture:
        """Return what the page shows, shape (height, width, 3); keep it as PNG too when a path is given."""
        png = self._page.screenshot(timeout=120_000, animations="allow", path=path)
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))

    def picture_when(self, holds: Callable[[Picture], bool], limit_s: float, every_s: float = 1.0) -> Picture:
        """Return the first picture for which the condition holds.

        Raises
        ------
        AssertionError
            If there was none within the limit; the page's last messages are told.
        """
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            try:
                seen = self.picture()
            except Error:  # a page still compiling its program may be too busy to be photographed
                seen = np.zeros((1, 1, 3), dtype=np.uint8)
            if holds(seen):
                return seen
            self.wait(every_s)
        raise AssertionError(f"the page did not come to show it in {limit_s:g} s; it said {self.messages[-5:]}")


def region(picture: Picture, left: float, top: float, right: float, bottom: float) -> Picture:
    """Return a part of the picture; edges as fractions of its width and height."""
    height, width = picture.shape[:2]
    return picture[round(top * height) : round(bottom * height), round(left * width) : round(right * width)]


def colours(picture: Picture) -> int:
    """Return how many clearly different colours there are: 1 or 2 for an empty page, dozens for a drawn one."""
    coarse = (picture // 16).reshape(-1, 3).astype(np.int64)
    codes, counts = np.unique(coarse @ np.array([256, 16, 1]), return_counts=True)
    return int((counts[codes >= 0] >= 10).sum())


def share_of(picture: Picture, colour: tuple[int, int, int], within: int = 24) -> float:
    """Return the share of pixels that are near a colour."""
    distance = np.abs(picture.astype(np.int16) - np.array(colour, dtype=np.int16)).max(axis=2)
    return float((distance <= within).mean())


def changed_share(before: Picture, after: Picture) -> float:
    """Return the share of pixels that differ by more than noise."""
    return float((np.abs(before.astype(np.int16) - after.astype(np.int16)).max(axis=2) > NOISE).mean())

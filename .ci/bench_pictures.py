# SPDX-License-Identifier: Apache-2.0
"""Photographs the bench in Chromium for the documentation, and films a slider that is moved.

Usage: python .ci/bench_pictures.py [NAME ...]; without names all of them, into docs/images.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "test"))
from browser import COMMAND, FLAGS, UP_MS, chromium, running  # noqa: E402

IMAGES = ROOT / "docs" / "images"
COLOURS = 192
LARGEST_BYTES = 2_000_000
HALTS, HALT_S, FULL_S = 6, 1.0, 1.1
FRAMES, FRAME_S, FILM_PX = 24, 0.25, 800
MACHINES = (
    "mb10_breaker",
    "compaction_press",
    "vibration_crank",
    "impact_mass",
    "roller_former",
    "winding_drum",
)
Act = Callable[[Any], None]
Palette = NDArray[np.int32]


def run_for_a_while(page: Any) -> None:
    """Wait until the plots are full and the numbers are there, and the run keeps up with the clock.

    Where a machine is busy a run falls behind: it begins anew after a halt, and is looked at as soon as the plots are
    full again.
    """
    page.wait_for_function("() => window.bench.shown > 1.5", timeout=UP_MS)
    page.wait_for_selector("#metrics tr", timeout=UP_MS)
    for _ in range(HALTS):
        page.locator("#order-pause").click()
        page.wait_for_selector("#order-pause[aria-pressed=true]")
        page.wait_for_timeout(1000 * HALT_S)
        halted = page.evaluate("() => window.bench.shown")
        page.locator("#order-pause").click()
        page.wait_for_function(f"() => window.bench.shown > {halted + FULL_S}", timeout=UP_MS)
        if page.locator("#lamp.good").count():
            return
    raise SystemExit("this machine is too busy for pictures: the run does not keep up with the clock")


def followed(page: Any) -> None:
    """Wait until the shadow is locked, and its curves are full."""
    page.wait_for_function("() => window.bench.shown > 0", timeout=UP_MS)
    page.wait_for_function("() => document.getElementById('state').textContent === 'locked'", timeout=UP_MS)
    page.wait_for_timeout(4000)


def compared(page: Any) -> None:
    """Wait until both runs are there, and lay them over each other at equal angle."""
    page.wait_for_function("() => window.bench.apart().rows > 1000", timeout=UP_MS)
    page.wait_for_selector("#compared tr", state="attached", timeout=UP_MS)
    page.locator("#align").select_option("angle")
    page.locator("#span").select_option("0.5")
    page.wait_for_timeout(1000)


def listed(page: Any) -> None:
    """Open a recording of the list."""
    page.wait_for_selector(".recording", timeout=UP_MS)
    page.locator(".recording").first.get_by_role("button", name="Open").click()
    page.wait_for_function("() => Number(document.getElementById('cursor').max) > 1.9", timeout=UP_MS)
    page.locator("#events button").nth(2).click()
    page.wait_for_timeout(1000)


def tried(page: Any) -> None:
    """Move a slider without letting it go."""
    run_for_a_while(page)
    move(page, 1.6)
    page.wait_for_selector("text=/^with /", timeout=UP_MS)
    page.evaluate("() => { window.bench.ghosts.length = 0; }")
    move(page, 1.7)  # the first trial loads the machine, and is over by now
    page.wait_for_function("() => window.bench.ghosts.length > 0", timeout=UP_MS)


def move(page: Any, factor: float) -> None:
    """Move the slider of the preload to so many times its value."""
    slider = page.locator("[data-name='body.preload_deflection_m'] input[type=range]")
    slider.scroll_into_view_if_needed()
    slider.evaluate(
        "(it, factor) => { it.dataset.base ??= it.value; it.value = factor * it.dataset.base;"
        " it.dispatchEvent(new Event('input')); }",
        factor,
    )


def photograph(page: Any, file: Path) -> None:
    """Keep what a page shows, in few colours."""
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    in_colours(picture, palette_of(picture)).save(file, optimize=True)
    checked(file)


def palette_of(picture: Image.Image) -> Palette:
    """Return the most frequent colours: those of every curve are among them, a mean of two is not."""
    found, counts = np.unique(np.asarray(picture).reshape(-1, 3), axis=0, return_counts=True)
    return found[np.argsort(-counts)[:COLOURS]].astype(np.int32)


def in_colours(picture: Image.Image, palette: Palette) -> Image.Image:
    """Return a picture in the colours of a palette, each the nearest."""
    found, places = np.unique(np.asarray(picture).reshape(-1, 3), axis=0, return_inverse=True)
    nearest = np.square(found.astype(np.int32)[:, None] - palette[None]).sum(axis=2).argmin(axis=1).astype(np.uint8)
    drawn = Image.fromarray(nearest[places.ravel()].reshape(picture.height, picture.width), "P")
    drawn.putpalette(palette.ravel().tolist())
    return drawn


def film(page: Any, file: Path) -> None:
    """Film the breaker while its slider is moved and let go."""
    tried(page)
    frames = []
    for place in range(FRAMES):
        begin = time.monotonic()
        move(page, 1.0 + 0.8 * min(1.0, place / (0.6 * FRAMES)))
        frame = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        frames.append(frame.resize((FILM_PX, FILM_PX * frame.height // frame.width), Image.Resampling.LANCZOS))
        time.sleep(max(0.0, FRAME_S - (time.monotonic() - begin)))
    palette = frames[-1].quantize(96)
    drawn = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    drawn[0].save(file, save_all=True, append_images=drawn[1:], duration=round(1000 * FRAME_S), loop=0, optimize=True)
    checked(file)


def checked(file: Path) -> None:
    """Refuse a file that is too large for the tree."""
    size = file.stat().st_size
    if size > LARGEST_BYTES:
        raise SystemExit(f"{file}: {size} bytes, expected at most {LARGEST_BYTES}")
    sys.stdout.write(f"{file}: {size // 1000} kB\n")


def main(names: list[str]) -> None:
    """Take the pictures of these names, or all."""
    run = ("--no-record",)
    scenes: dict[str, tuple[tuple[str, ...], Act, str]] = {
        f"view_{name}.png": (("run", name, *run), run_for_a_while, "light") for name in MACHINES
    }
    scenes |= {
        "bench_dark.png": (("run", "mb10_breaker", *run), run_for_a_while, "dark"),
        "bench_comparison.png": (
            ("compare", "mb10_breaker", "soft.yaml", "--duration", "2", "--tolerance", "1", "--view", "web"),
            compared,
            "light",
        ),
        "bench_recordings.png": (("bench", "recordings"), listed, "light"),
        "view_shadow.png": (("shadow", "vibration_crank", "--from", "plant", "--view", "web"), followed, "light"),
        "bench.gif": (("run", "mb10_breaker", *run), run_for_a_while, "light"),
    }
    with tempfile.TemporaryDirectory() as kept, sync_playwright() as play:
        folder = Path(kept)
        prepare(folder)
        browser = play.chromium.launch(executable_path=chromium(), headless=True, args=FLAGS)
        for name in names or scenes:
            words, act, scheme = scenes[name]
            with plant(folder, name), running(*words, folder=folder) as (url, _):
                context = browser.new_context(viewport={"width": 1280, "height": 720}, color_scheme=scheme)
                page = context.new_page()
                page.goto(url)
                if name.endswith(".gif"):
                    film(page, IMAGES / name)
                else:
                    act(page)
                    photograph(page, IMAGES / name)
                context.close()
        browser.close()


@contextmanager
def plant(folder: Path, name: str) -> Iterator[None]:
    """Run the machine that a shadow follows, for a picture of one."""
    if "shadow" not in name:
        yield
        return
    words = ["run", "vibration_crank", "--namespace", "plant", "--no-record", "--view", "none"]
    process = subprocess.Popen([*COMMAND, *words], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait(60)


def prepare(folder: Path) -> None:
    """Make what the scenes open: a changed configuration, and two recordings."""
    text = (ROOT / "config" / "mb10_breaker.yaml").read_text(encoding="utf-8")
    folder.joinpath("soft.yaml").write_text(text.replace("restitution: 0.35", "restitution: 0.15"), encoding="utf-8")
    folder.joinpath("recordings").mkdir()
    for machine in ("compaction_press", "mb10_breaker"):
        words = ["simulate", machine, "--duration", "2", "--bag", f"recordings/{machine}-1"]
        subprocess.run([*COMMAND, *words], check=True, cwd=folder, stdout=subprocess.DEVNULL, env=os.environ)


if __name__ == "__main__":
    main(sys.argv[1:])

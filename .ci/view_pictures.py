# SPDX-License-Identifier: Apache-2.0
"""Photograph the web view of machines for the documentation, in a real browser.

Usage: PYTHONPATH=. python .ci/view_pictures.py [PICTURE...], such as view_vibration_crank; all without one.
Needs Chromium.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "test"))

from browser import Page, Picture, changed_share, colours  # noqa: E402 - beside the tests

COMMAND = [sys.executable, "-m", "mech_twin"]
ADDRESS, COMPLETE = "view: ", "complete"
WIDTH, HEIGHT = 1400, 900
DRAWN = 20  # colours of a page that shows something
LIMIT_S = 300.0
SETTLE_S = 5.0  # between pictures that are the same when all is drawn


class Shown(NamedTuple):
    """A machine at the end of a run of this length, in this scheme."""

    machine: str
    duration_s: float = 2.0
    scheme: str = "light"


PICTURES = {
    "view_compaction_press": Shown("compaction_press"),
    "view_impact_mass": Shown("impact_mass"),
    "view_mb10_breaker": Shown("mb10_breaker"),  # a blow has just been
    "view_mb10_breaker_dark": Shown("mb10_breaker", scheme="dark"),
    "view_planar_linkage": Shown("planar_linkage"),
    "view_roller_former": Shown("roller_former"),
    "view_vibration_crank": Shown("vibration_crank"),
    "view_winding_drum": Shown("winding_drum"),
}


def photograph(shown: Shown, file: Path) -> None:
    """Simulate, show the recording, and keep what the page shows at its end."""
    with tempfile.TemporaryDirectory() as folder:
        bag = str(Path(folder) / "bag")
        words = ["simulate", shown.machine, "--duration", str(shown.duration_s), "--bag", bag]
        subprocess.run([*COMMAND, *words], check=True, stdout=subprocess.DEVNULL)
        view = subprocess.Popen([*COMMAND, "view", bag], stderr=subprocess.PIPE, text=True)
        try:
            assert view.stderr is not None
            url = next(line for line in view.stderr if line.startswith(ADDRESS)).removeprefix(ADDRESS).strip()
            next(line for line in view.stderr if line.startswith(COMPLETE))
            with Page(url, width=WIDTH, height=HEIGHT, scheme=shown.scheme) as page:
                seen = page.picture_when(lambda seen: colours(seen) >= DRAWN, LIMIT_S)
                page.picture_when(partial(_still, [seen]), LIMIT_S, SETTLE_S)
                page.picture(file)
        finally:
            view.terminate()
            view.wait()


def _still(last: list[Picture], seen: Picture) -> bool:
    """Return whether a picture is the one before it, and keep it."""
    before, last[0] = last[0], seen
    return changed_share(before, seen) == 0.0


def main() -> None:
    """Photograph what is named."""
    for name in sys.argv[1:] or PICTURES:
        photograph(PICTURES[name], ROOT / "docs" / "images" / f"{name}.png")


if __name__ == "__main__":
    main()

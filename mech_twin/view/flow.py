# SPDX-License-Identifier: Apache-2.0
"""When the next picture of a live run goes out: once the page has shown the one before.

What is sent before that would queue up in the page, and what it shows would lag behind the run ever more.  So the page
says what time it shows, and samples that it could not take in are dropped::

    run ---- samples ----> scene ---- picture ----> page
                             ^                        |
                             +------ time shown ------+
"""

from __future__ import annotations

import threading
import time
from pathlib import Path

SHOWN = "shown_s"
LOADING = ""  # stands for a page that has been opened and has shown nothing yet
UNHEARD_S = 0.25  # least interval where no page says what it shows
PATIENCE_S = 3.0  # interval while a page has not shown the last picture: loading, paused, hidden or gone
FORGOTTEN_S = 10.0  # a page that has said nothing for so long is gone
LOADING_LIMIT_S = 300.0
MOST_PAGES = 32  # that are kept apart; of more, those heard last
LOOK_S = 0.01
ROUNDING_S = 1e-6


class PageReports:
    """Keeps in a file what the pages that are open show: the earliest time of them.

    Parameters
    ----------
    directory : Path
        Folder of the file, which `Flow` reads, perhaps in another process.
    """

    def __init__(self, directory: Path) -> None:
        self._file = directory / SHOWN
        self._lock = threading.Lock()
        self._pages: dict[str, tuple[float, float]] = {}

    def opened(self) -> None:
        """Note that a page begins to load."""
        with self._lock:
            self._note(LOADING, 0.0, LOADING_LIMIT_S)

    def shown(self, page: str, time_s: float) -> None:
        """Note what time (s) a page shows."""
        with self._lock:
            self._pages.pop(LOADING, None)
            self._note(page, time_s, FORGOTTEN_S)

    def _note(self, page: str, time_s: float, kept_s: float) -> None:
        now = time.monotonic()
        self._pages.pop(page, None)
        alive = [(name, told) for name, told in self._pages.items() if told[1] > now]
        self._pages = dict([*alive, (page, (time_s, now + kept_s))][-MOST_PAGES:])
        fresh = self._file.with_suffix(".new")
        fresh.write_text(f"{min(shown_s for shown_s, _ in self._pages.values()):.9f}", encoding="ascii")
        fresh.replace(self._file)


class Flow:
    """Tells when the next picture may go out.

    Parameters
    ----------
    directory : Path, optional
        Where `PageReports` keeps what is shown; without it nobody tells, and pictures go out at fixed intervals.
    """

    def __init__(self, directory: Path | None = None) -> None:
        self._file = None if directory is None else directory / SHOWN
        self._sent_s = -1.0
        self._sent_at = self._looked_at = -PATIENCE_S

    def is_open(self, least_interval_s: float) -> bool:
        """Return whether a picture may go out, not sooner than this after the one before (s, by the wall clock)."""
        now = time.monotonic()
        passed = now - self._sent_at
        if passed < least_interval_s or now - self._looked_at < LOOK_S:
            return False
        self._looked_at = now
        shown_s = self.shown_s()
        if shown_s is None:
            return passed >= UNHEARD_S
        return shown_s >= self._sent_s - ROUNDING_S or passed >= PATIENCE_S

    def sent(self, time_s: float) -> None:
        """Note that a picture of this time has gone out."""
        self._sent_s, self._sent_at = time_s, time.monotonic()

    def shown_s(self) -> float | None:
        """Return the time the pages show (s), None where no page has been opened."""
        try:
            return None if self._file is None else float(self._file.read_text(encoding="ascii"))
        except (OSError, ValueError):
            return None

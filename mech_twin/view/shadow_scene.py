# SPDX-License-Identifier: Apache-2.0
"""A shadow on the bench, or in a file for rerun: measured and model curves overlaid, residuals, faults and advice."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from mech_twin.process.closing import Closing
from mech_twin.view.bench.picture import Curves, Panel, packed_layout
from mech_twin.view.extent import Bounds, DrawnExtent, with_placed_texts
from mech_twin.view.shadow_picture import (
    BANDED,
    CURVES,
    ChannelReading,
    ShadowPicture,
    ShownAdvice,
    ShownChannel,
    ShownFault,
    ShownFit,
    as_measured,
    channel_rows,
)

if TYPE_CHECKING:
    from mech_twin.view.bench.link import BenchLink
    from mech_twin.view.rerun_pictures import RerunFile

PICTURE_S = 0.05  # least time between two pictures
KEPT_SAMPLES = 4000  # per channel, while the bench accepts none
WINDOW = 5


class ShadowScene(Closing):
    """The scene of a shadow; a context manager.  A bench gets pictures by the wall clock, a file by machine time."""

    def __init__(self, channels: Sequence[ShownChannel], link: BenchLink | RerunFile) -> None:
        self._channels, self._link = tuple(channels), link
        self._pending: dict[str, deque[tuple[float, ChannelReading]]] = {
            each.column: deque(maxlen=KEPT_SAMPLES) for each in channels
        }
        self._extent = DrawnExtent()
        self._bounds: Bounds | None = None
        self._time_s = 0.0
        self._sent_at = -1.0
        self._faults: tuple[ShownFault, ...] | None = None
        self._advice: ShownAdvice | None = None
        self._fit: ShownFit | None = None
        shown: list[Panel] = []
        for each in self._channels:
            shown += [Panel(each.title, (each.curves,)), Panel(f"Residual: {each.title}", (each.residual,))]
        names = {each.curves: CURVES for each in channels} | {each.residual: BANDED for each in channels}
        link.tell("layout", packed_layout(shown, names))

    def take(self, time_s: float, readings: Mapping[str, ChannelReading]) -> None:
        """Store the channels of a sample for the next picture."""
        if time_s < self._time_s - 1.0:
            self._link.tell("anew", {})
            self._time_s, self._sent_at = time_s, -1.0
        self._time_s = max(self._time_s, time_s)
        for column, reading in readings.items():
            self._pending[column].append((time_s, reading))

    def is_due(self) -> bool:
        """Return whether the next picture is due: 20 per second."""
        return self._now_s() - self._sent_at >= PICTURE_S

    def show(self, picture: ShadowPicture) -> None:
        """Send a picture, and the curves up to it."""
        self._sent_at = self._now_s()
        shapes = (*picture.model, *as_measured(picture.measured))
        self._extent.widen(shapes)
        self._bounds = self._extent.kept(self._bounds)
        active = [each.name for each in picture.faults if each.state != "pending" and each.shelved_until_s is None]
        self._link.show(
            {
                "time_s": round(self._time_s, 9),
                "sent_s": time.time(),
                "state": picture.state,
                "banner": picture.banner,
                "alarm": f"fault: {', '.join(active)}" if active else "",
                "command": None,
                "cards": picture.cards,
                "bounds": self._bounds,
                "shapes": self._link.shapes(with_placed_texts(shapes, (), self._bounds)) if shapes else None,
                "curves": self._link.curves(self._taken()),
                "events": [],
                "lanes": [],
            }
        )
        self._tell_faults(picture)

    def close(self) -> None:
        """Close the connection to the bench, or the file."""
        self._link.close()

    def _now_s(self) -> float:
        return time.monotonic() if self._link.is_live else self._time_s

    def _tell_faults(self, picture: ShadowPicture) -> None:
        if picture.faults != self._faults:
            self._faults = picture.faults
            self._link.tell("alarms", {"faults": [each._asdict() for each in picture.faults]})
        if picture.advice != self._advice:
            self._advice = picture.advice
            self._link.tell("advice", picture.advice._asdict())
        if picture.fit is not None and picture.fit != self._fit:
            self._fit = picture.fit
            self._link.tell("fit", picture.fit._asdict())

    def _taken(self) -> list[Curves]:
        rows = (channel_rows(each, self._pending[each.column], WINDOW) for each in self._channels)
        return [each for found in rows for each in found]

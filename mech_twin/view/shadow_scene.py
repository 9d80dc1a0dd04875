# SPDX-License-Identifier: Apache-2.0
"""A shadow in rerun: measured and model curves overlaid, residuals with their band, a status line.

::

    +---------------------------------------+
    | state, level, residual, fault         |
    +---------------------+-----------------+
    |                     | channel 1       |  measured, model
    |  mechanism:         +-----------------+
    |  model, and as it   | its residual    |  with plus and minus two sigma
    |  is measured        +-----------------+
    |                     | further ones    |
    +---------------------+-----------------+
"""

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from mech_twin.process.closing import Closing
from mech_twin.view.curves import send_rows, series_lines
from mech_twin.view.extent import Bounds
from mech_twin.view.layout import BANNER, banner_view, mechanism_view, page, plot
from mech_twin.view.rerun_pictures import Mechanism, closed_stream, opened_stream, set_time
from mech_twin.view.shadow_picture import (
    BANDED,
    CURVES,
    MEASURED_COLOUR,
    ChannelReading,
    ShadowPicture,
    ShownChannel,
    as_measured,
    channel_rows,
)

MODEL_COLOUR = (86, 180, 233)
BAND_COLOURS = ((213, 94, 0), (130, 130, 130), (130, 130, 130))  # of the residual and its band
WINDOW = 5
PICTURE_S = 0.05  # least machine time between two pictures
KEPT_S = 1.0  # time span of the curves
FLUSH_LIMIT_S = 0.5
STACKED = 2  # channels with separate plots; further ones share tabs


class ShadowScene(Closing):
    """The scene of a shadow; a context manager."""

    def __init__(self, name: str, channels: Sequence[ShownChannel], rrd_path: str | Path) -> None:
        self._channels = tuple(channels)
        self._stream = opened_stream(name, rrd_path)
        self._mechanism = Mechanism(self._stream)
        self._pending: dict[str, deque[tuple[float, ChannelReading]]] = {each.column: deque() for each in channels}
        self._bounds: Bounds | None = None
        self._drawn_s = -1.0
        self._time_s = 0.0
        self._is_laid_out = False
        self._is_closed = False
        for each in self._channels:
            self._stream.log(each.curves, series_lines(CURVES, colours=(MEASURED_COLOUR, MODEL_COLOUR)), static=True)
            self._stream.log(each.residual, series_lines(BANDED, colours=BAND_COLOURS), static=True)

    def take(self, time_s: float, readings: Mapping[str, ChannelReading]) -> None:
        """Store the channels of a sample for the next picture."""
        self._time_s = max(self._time_s, time_s)
        for column, reading in readings.items():
            self._pending[column].append((time_s, reading))

    def is_due(self) -> bool:
        """Return whether the next picture is due: 20 per second of machine time."""
        return self._time_s - self._drawn_s >= PICTURE_S

    def show(self, picture: ShadowPicture) -> None:
        """Send a picture, and the curves up to it."""
        self._drawn_s = self._time_s
        self._send_curves()
        set_time(self._stream, self._time_s)
        self._stream.log(BANNER, rr.TextDocument(picture.banner, media_type=rr.MediaType.MARKDOWN))
        if picture.model:
            self._mechanism.widen((*picture.model, *picture.measured))
            self._mechanism.show(picture.model, as_measured(picture.measured))
        self._lay_out()

    def close(self) -> None:
        """Write the remaining data, and close the file; idempotent."""
        if not self._is_closed:
            self._is_closed = True
            self._send_curves()
            closed_stream(self._stream, FLUSH_LIMIT_S)

    def _send_curves(self) -> None:
        for each in self._channels:
            for rows in channel_rows(each, self._pending[each.column], WINDOW):
                send_rows(self._stream, rows.path, rows.values, rows.time_s)

    def _lay_out(self) -> None:
        if self._is_laid_out and self._mechanism.within(self._bounds):
            return
        self._is_laid_out = True
        self._bounds = self._mechanism.bounds()
        self._stream.send_blueprint(shadow_blueprint(self._channels, self._bounds))


def shadow_blueprint(channels: Sequence[ShownChannel], bounds: Bounds | None) -> rrb.Blueprint:
    """Return the blueprint of the panels."""
    panels: list[rrb.View | rrb.Container] = []
    for each in channels[:STACKED]:
        panels += _plots(each)
    rest = [view for each in channels[STACKED:] for view in _plots(each)]
    if rest:
        panels.append(rrb.Tabs(*rest, active_tab=0))
    below = rrb.Horizontal(mechanism_view(bounds), rrb.Vertical(*panels), column_shares=[5, 4])
    return page(rrb.Vertical(banner_view(), below, row_shares=[6, 94]))


def _plots(channel: ShownChannel) -> list[rrb.View]:
    return [
        plot(channel.title, [channel.curves], KEPT_S, CURVES),
        plot(f"Residual: {channel.title}", [channel.residual], KEPT_S, BANDED),
    ]

# SPDX-License-Identifier: Apache-2.0
"""What a shadow sees, in rerun: measured and model over each other, residuals with their band, a line of state.

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

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mech_twin.samples import Shape
from mech_twin.view.curves import send_rows, series_lines
from mech_twin.view.decimation import extreme_rows
from mech_twin.view.destination import Destination
from mech_twin.view.layout import BANNER, Bounds, banner_view, mechanism_view, page, plot
from mech_twin.view.mechanism import Mechanism
from mech_twin.view.stream import closed_stream, opened_stream, set_time

CHANNELS, RESIDUALS = "channels", "residuals"
MEASURED_COLOUR = (204, 90, 180)
MODEL_COLOUR = (86, 180, 233)
BAND_COLOURS = ((213, 94, 0), (130, 130, 130), (130, 130, 130))  # of the residual, and of its band
CURVES = ("measured", "model")
BANDED = ("residual", "+2 sigma", "-2 sigma")
WINDOW = 5
KEPT_S = 1.0  # of the curves, which is what they show
FLUSH_LIMIT_S = 0.5
STACKED = 2  # channels that have plots of their own at once; further ones are in tabs


class ShownChannel(NamedTuple):
    """A channel: its column, a title with its unit, and the entity paths of its two plots."""

    column: str
    title: str

    @property
    def curves(self) -> str:
        """Path of measured and model."""
        return f"{CHANNELS}/{self.column}"

    @property
    def residual(self) -> str:
        """Path of the residual and its band."""
        return f"{RESIDUALS}/{self.column}"


class ChannelReading(NamedTuple):
    """A channel at a sample: measured value, measured less predicted, its standard deviation (SI units)."""

    measured: float
    residual: float
    sigma: float


class ShadowPicture(NamedTuple):
    """What goes out with one picture beside the curves: drawings of model and measurement, the line of state."""

    model: Sequence[Shape]
    measured: Sequence[Shape]
    banner: str


class ShadowScene:
    """The scene of a shadow; a context manager.

    Parameters
    ----------
    name : str
        Name in the viewer.
    channels : sequence of ShownChannel
        What is measured.
    to : Destination
        Viewer or file.
    """

    def __init__(self, name: str, channels: Sequence[ShownChannel], to: Destination) -> None:
        self._channels = tuple(channels)
        self._to = to
        self._stream = opened_stream(name, to.grpc_url, to.rrd_path)
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
        """Keep the channels of a sample for the next picture."""
        self._time_s = max(self._time_s, time_s)
        for column, reading in readings.items():
            kept = self._pending[column]
            kept.append((time_s, reading))
            while self._to.flow is not None and time_s - kept[0][0] > KEPT_S:
                kept.popleft()

    def is_due(self) -> bool:
        """Return whether the next picture may go out: 20 in a second of the machine, fewer where a page is slower."""
        if self._to.flow is None:
            return self._time_s - self._drawn_s >= 0.05
        return self._to.flow.is_open(self._to.sending.least_interval_s(light=False))

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
        if self._to.flow is not None:
            self._to.flow.sent(self._time_s)

    def close(self) -> bool:
        """Send what is left and disconnect; return whether everything was accepted; idempotent."""
        if self._is_closed:
            return True
        self._is_closed = True
        self._send_curves()
        return closed_stream(self._stream, FLUSH_LIMIT_S, live=self._to.grpc_url is not None)

    def __enter__(self) -> ShadowScene:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _send_curves(self) -> None:
        for each in self._channels:
            kept = self._pending[each.column]
            if not kept:
                continue
            time_s = np.array([at_s for at_s, _ in kept])
            measured, residual, sigma = np.array([reading for _, reading in kept]).T
            kept.clear()
            values = np.column_stack([measured, measured - residual])
            banded = np.column_stack([residual, 2.0 * sigma, -2.0 * sigma])
            for path, columns in ((each.curves, values), (each.residual, banded)):
                rows = extreme_rows(columns, WINDOW)
                send_rows(self._stream, path, columns[rows], time_s[rows])

    def _lay_out(self) -> None:
        if self._is_laid_out and self._mechanism.within(self._bounds):
            return
        self._is_laid_out = True
        self._bounds = self._mechanism.bounds()
        self._stream.send_blueprint(shadow_blueprint(self._channels, self._bounds))


def as_measured(shapes: Sequence[Shape]) -> list[Shape]:
    """Return the lines of a drawing thinner, in the colour of what is measured, with no names."""
    return [
        shape._replace(name=f"measured_{shape.name}", colour=MEASURED_COLOUR, width_m=0.3 * shape.width_m, text="")
        for shape in shapes
        if shape.kind == "line"
    ]


def shadow_blueprint(channels: Sequence[ShownChannel], bounds: Bounds | None) -> rrb.Blueprint:
    """Return the layout."""
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

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
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from mech_twin.process.closing import Closing
from mech_twin.samples import Shape
from mech_twin.view.annotations import Card
from mech_twin.view.curves import send_rows, series_lines
from mech_twin.view.extent import Bounds
from mech_twin.view.layout import BANNER, banner_view, mechanism_view, page, plot
from mech_twin.view.rerun_pictures import Mechanism, closed_stream, opened_stream, set_time
from mech_twin.view.sending import extreme_rows

Array = NDArray[np.float64]

CHANNELS, RESIDUALS = "channels", "residuals"
MEASURED_COLOUR = (204, 90, 180)
CURVES = ("measured", "model")
BANDED = ("residual", "+2 sigma", "-2 sigma")


class ShownChannel(NamedTuple):
    """A channel for display: its column, title with unit, and the entity paths of its two plots."""

    column: str
    title: str

    @property
    def curves(self) -> str:
        """Entity path of the measured and model curves."""
        return f"{CHANNELS}/{self.column}"

    @property
    def residual(self) -> str:
        """Entity path of the residual and its 2-sigma band."""
        return f"{RESIDUALS}/{self.column}"


class ChannelReading(NamedTuple):
    """A channel at a sample: measured value, residual (measured minus predicted), its standard deviation (SI units)."""

    measured: float
    residual: float
    sigma: float


class ChannelRows(NamedTuple):
    """Data of one plot of a channel: entity path, names of the columns, times (n,) and values (n, columns)."""

    path: str
    names: tuple[str, ...]
    time_s: Array
    values: Array


def channel_rows(channel: ShownChannel, kept: deque[tuple[float, ChannelReading]], window: int) -> list[ChannelRows]:
    """Return and clear the rows of a channel's two plots, reduced to the extremes of each window."""
    if not kept:
        return []
    time_s = np.array([at_s for at_s, _ in kept])
    measured, residual, sigma = np.array([reading for _, reading in kept]).T
    kept.clear()
    values = np.column_stack([measured, measured - residual])
    banded = np.column_stack([residual, 2.0 * sigma, -2.0 * sigma])
    found = []
    for path, names, columns in ((channel.curves, CURVES, values), (channel.residual, BANDED, banded)):
        rows = extreme_rows(columns, window)
        found.append(ChannelRows(path, names, time_s[rows], columns[rows]))
    return found


class ShownFault(NamedTuple):
    """A fault on the panel.

    Attributes
    ----------
    name, state : str
        Name of the fault, and its state.
    since_s : float
        Time at which it entered that state (s).
    size : str
        Size of the best candidate, with interval and unit; empty if there is none.
    is_acknowledged : bool
        Whether an operator has acknowledged it.
    shelved_until_s : float or None
        Time until which it is shelved, i.e. not announced (s); None if it is not shelved.
    """

    name: str
    state: str
    since_s: float
    size: str = ""
    is_acknowledged: bool = False
    shelved_until_s: float | None = None


class ShownFit(NamedTuple):
    """An identification from the last minutes on the panel.

    Attributes
    ----------
    phase, status_line : str
        State (``idle``, ``running``, ``found``, ``not better``, ``failed``, ``taken over``), and a line on it.
    free : tuple of str
        Keys that may change.
    kept_s : int
        Length of the buffered data (s).
    rows : tuple of rows
        Key, value before, value found, 95 % interval, verdict.
    held_out : tuple of rows
        Channel, and its fit before and after on the held-out data.
    text : str
        The configuration found, as a parameter file; empty if none is found.
    """

    phase: str
    status_line: str
    free: tuple[str, ...]
    kept_s: int
    rows: tuple[tuple[str, str, str, str, str], ...] = ()
    held_out: tuple[tuple[str, str, str], ...] = ()
    text: str = ""


class ShadowPicture(NamedTuple):
    """One picture, besides the curves: drawings of model and measurement, state, faults, advice and identification.

    ``banner`` is the state line; ``cards`` are headline numbers; ``advice`` has names and values of a recommendation
    that waits for an answer (empty: none); ``fit`` is an identification, if one can be requested.
    """

    model: Sequence[Shape]
    measured: Sequence[Shape]
    banner: str
    state: str = ""
    cards: tuple[Card, ...] = ()
    faults: tuple[ShownFault, ...] = ()
    advice: tuple[tuple[str, str], ...] = ()
    fit: ShownFit | None = None


def as_measured(shapes: Sequence[Shape]) -> list[Shape]:
    """Return the lines of a drawing thinner, in the colour of measurements, without names."""
    return [
        shape._replace(name=f"measured_{shape.name}", colour=MEASURED_COLOUR, width_m=0.3 * shape.width_m, text="")
        for shape in shapes
        if shape.kind == "line"
    ]


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

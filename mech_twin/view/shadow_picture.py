# SPDX-License-Identifier: Apache-2.0
"""Contents of one picture of a shadow."""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mech_twin.samples import Shape
from mech_twin.view.annotations import Card
from mech_twin.view.bench.picture import Curves
from mech_twin.view.sending import extreme_rows

CHANNELS, RESIDUALS = "channels", "residuals"
CURVES = ("measured", "model")
BANDED = ("residual", "+2 sigma", "-2 sigma")
MEASURED_COLOUR, MODEL_COLOUR, BAND_COLOUR = (204, 90, 180), (86, 180, 233), (130, 130, 130)
COLOURS = {CURVES: (MEASURED_COLOUR, MODEL_COLOUR), BANDED: ((213, 94, 0), BAND_COLOUR, BAND_COLOUR)}


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


def channel_rows(channel: ShownChannel, kept: deque[tuple[float, ChannelReading]], window: int) -> list[Curves]:
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
        found.append(Curves(path, names, time_s[rows], columns[rows]))
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


class ShownAdvice(NamedTuple):
    """An advice on the panel: its contents by name (empty: none), whether it is on trial, and the last answer."""

    rows: tuple[tuple[str, str], ...] = ()
    is_on_trial: bool = False
    decided: str = ""


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

    ``banner`` is the state line of rerun's viewer; ``cards`` are headline numbers; ``advice`` is a recommendation that
    waits for an answer, or is on trial; ``fit`` is an identification, if one can be requested.
    """

    model: Sequence[Shape]
    measured: Sequence[Shape]
    banner: str
    state: str = ""
    cards: tuple[Card, ...] = ()
    faults: tuple[ShownFault, ...] = ()
    advice: ShownAdvice = ShownAdvice()
    fit: ShownFit | None = None


def as_measured(shapes: Sequence[Shape]) -> list[Shape]:
    """Return the lines of a drawing thinner, in the colour of measurements, without names."""
    return [
        shape._replace(name=f"measured_{shape.name}", colour=MEASURED_COLOUR, width_m=0.3 * shape.width_m, text="")
        for shape in shapes
        if shape.kind == "line"
    ]

# SPDX-License-Identifier: Apache-2.0
"""Matches model events with measured ones: mutually nearest, within a share of their usual spacing."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mech_twin.measurements.blocks import Array

SHARE = 0.3  # of the usual spacing of events: farther apart, they are different events
SERIES = 0.1  # of the usual spacing: events that follow sooner belong to a series, and only its first is compared


def first_of_series(times_s: Array) -> npt.NDArray[np.bool_]:
    """Return which events begin a series, shape (n,): of chatter, only the first impact counts."""
    if len(times_s) < 3:
        return np.ones(len(times_s), dtype=np.bool_)
    return np.diff(times_s, prepend=-np.inf) > SERIES * usual_spacing(times_s)


def usual_spacing(times_s: Array) -> float:
    """Return the median spacing of events (s), without the bounces within a series."""
    spacing = np.diff(np.unique(times_s))
    long = spacing[spacing > SERIES * spacing.max()] if len(spacing) else spacing
    return float(np.median(long)) if len(long) else np.inf


def matched(measured_s: Array, model_s: Array) -> npt.NDArray[np.int64]:
    """Return the index of the model event matched with each measured one, -1 without a match, shape (measured,).

    Matches are mutually nearest, which keeps the order, and at most `SHARE` of the spacing apart.
    """
    if not len(measured_s) or not len(model_s):
        return np.full(len(measured_s), -1, dtype=np.int64)
    there = _nearest(measured_s, model_s)
    back = _nearest(model_s, measured_s)
    near = np.abs(model_s[there] - measured_s) <= SHARE * min(usual_spacing(measured_s), usual_spacing(model_s))
    return np.where((back[there] == np.arange(len(measured_s))) & near, there, -1)


def _nearest(times_s: Array, among_s: Array) -> npt.NDArray[np.int64]:
    """Return the index of the nearest of ascending times, shape (times,)."""
    after = np.clip(np.searchsorted(among_s, times_s), 1, max(len(among_s) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(among_s) - 1)
    nearer = np.abs(among_s[before] - times_s) <= np.abs(among_s[after] - times_s)
    return np.where(nearer, before, after).astype(np.int64)

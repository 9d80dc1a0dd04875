# SPDX-License-Identifier: Apache-2.0
"""State of a machine whose motion is computed from its last event: it is in that event's memory, not in the joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class AnchoredMotion(NamedTuple):
    """Columns of that state, and the function that moves its time origin.

    Attributes
    ----------
    later : mapping
        For each state column: the column that holds it one step later, and the sign.
    origin, tau : str
        Columns of the step at which the anchor's time is 0, which is a state too, and of that time (s).
    not_below_zero : tuple of str
        State columns that cannot be negative.
    anchor_at : callable
        ``anchor_at(model, row, step)`` moves the anchor of a linkage row to this step; the motion is unchanged.
    """

    later: Mapping[str, tuple[str, float]]
    origin: str
    tau: str
    not_below_zero: tuple[str, ...]
    anchor_at: Callable[[Any, Array, int], None]

# SPDX-License-Identifier: Apache-2.0
"""The state of a machine that goes on from its last event: it stands in the memory of that event, not in the joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class AnchoredMotion(NamedTuple):
    """Columns of the state, and how a frame is told from its own instant.

    Attributes
    ----------
    later : mapping
        State column -> where it stands in the frame one step later, and with which sign.
    origin, tau : str
        Columns of the step from which the time of the anchor counts, which is state too, and of that time (s).
    not_below_zero : tuple of str
        State columns that cannot be negative.
    anchor_at : callable
        ``anchor_at(model, row, step)`` tells a linkage row from this step on; the motion stays the same.
    """

    later: Mapping[str, tuple[str, float]]
    origin: str
    tau: str
    not_below_zero: tuple[str, ...]
    anchor_at: Callable[[Any, Array, int], None]

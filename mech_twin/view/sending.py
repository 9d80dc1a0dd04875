# SPDX-License-Identifier: Apache-2.0
r"""Rate and decimation of the data sent to a viewer.

A live view gets thirty pictures a second, and curves reduced to the extremes of each window; the full data is in the
recording.

Decimation keeps extremes: a peak of one sample remains in the curve::

    value  |      *                 * kept (largest of its window)
           |  .  / \   .
           | * .    \ /            * kept (smallest of its window)
           |         *
           +-----------+---> row
            one window
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Rows = npt.NDArray[np.intp]
Values = npt.NDArray[np.float64]


def extreme_rows(values: Values, window: int) -> Rows:
    """Return the rows, ascending, at which any column has the smallest or the largest value of its window.

    The decimated curve consists of original samples at their original times and has in every window the extremes
    of the full curve.  NaN counts as an extreme, so it is never hidden.

    Parameters
    ----------
    window : int
        Rows per window, counted from row 0; the last window may be shorter.
    """
    if window < 1:
        raise ValueError(f"window: expected at least 1 row, got {window}")
    count = len(values)
    if window <= 2 or values.size == 0:
        return np.arange(count)
    columns = values.reshape(count, -1)
    width = columns.shape[1]
    whole = count - count % window
    kept = np.zeros(count, dtype=bool)
    blocks = columns[:whole].reshape(-1, window, width)
    first = np.arange(0, whole, window)[:, np.newaxis]
    kept[blocks.argmin(axis=1) + first] = True
    kept[blocks.argmax(axis=1) + first] = True
    if whole < count:
        kept[columns[whole:].argmin(axis=0) + whole] = True
        kept[columns[whole:].argmax(axis=0) + whole] = True
    return np.flatnonzero(kept)


class PictureRate(NamedTuple):
    """Decimation and rate of the pictures of a scene.

    Attributes
    ----------
    window : int
        Least number of samples per decimation window of the curves; each window keeps its extremes.
    window_s : float
        Least simulated time per decimation window (s).
    picture_s : float
        Least wall-clock time between two pictures (s).
    drawing_s : float
        Least simulated time between two drawings (s).
    """

    window: int
    window_s: float = 0.0
    picture_s: float = 0.0
    drawing_s: float = 0.0


RECORDED = PictureRate(window=5, drawing_s=0.01)  # for a recording, at the speed of reading
LIVE = PictureRate(window=10, window_s=0.01, picture_s=0.033)

# SPDX-License-Identifier: Apache-2.0
"""Rate and decimation of the data sent to a viewer.

A live view gets thirty pictures a second, and curves reduced to the extremes of each window; the full data is in the
recording.
"""

from __future__ import annotations

from typing import NamedTuple


class Sending(NamedTuple):
    """Decimation and batches of a scene.

    Attributes
    ----------
    window : int
        Least number of samples per decimation window of the curves; each window keeps its extremes.
    window_s : float
        Least simulated time per decimation window (s).
    batch_s : float
        Least simulated time per batch of curve data (s).
    picture_s : float
        Least wall-clock time between two pictures (s).
    """

    window: int
    batch_s: float
    window_s: float = 0.0
    picture_s: float = 0.0


AT_ONCE = Sending(window=5, batch_s=0.1)  # for a file
RECORDED = Sending(window=5, batch_s=1.0)  # for a recording, at the speed of reading
LIVE = Sending(window=10, window_s=0.01, batch_s=0.03, picture_s=0.033)

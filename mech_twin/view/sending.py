# SPDX-License-Identifier: Apache-2.0
"""How much goes to a viewer, and how often.

A browser takes in a limited number of messages with each frame it draws.  What comes faster queues up, and the picture
falls behind for good.  So a live view gets few, larger messages, and a drawing that comes too soon is dropped: the full
data is in the recording.
"""

from __future__ import annotations

from typing import NamedTuple


class Sending(NamedTuple):
    """Decimation and batches of a scene.

    Attributes
    ----------
    window : int
        Samples per decimation window of the curves; each window keeps its extremes.
    batch_s : float
        Simulated time per batch of curve data (s).
    drawing_s, light_drawing_s : float
        Least time between two drawings by the wall clock (s), in the full and in the light layout; 0 drops none.
    """

    window: int
    batch_s: float
    drawing_s: float
    light_drawing_s: float

    def least_interval_s(self, *, light: bool) -> float:
        """Return the least time between two drawings by the wall clock (s)."""
        return self.light_drawing_s if light else self.drawing_s


AT_ONCE = Sending(window=5, batch_s=0.1, drawing_s=0.0, light_drawing_s=0.0)  # all that a file should keep
RECORDED = Sending(window=5, batch_s=1.0, drawing_s=0.0, light_drawing_s=0.0)  # a recording, as fast as it is read
LIVE = Sending(window=10, batch_s=0.25, drawing_s=0.030, light_drawing_s=0.095)

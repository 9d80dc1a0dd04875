# SPDX-License-Identifier: Apache-2.0
"""Force of a compacted layer: it grows with the depth of the stroke and is zero on the return.

::

    Q |          * peak         y_t  top of the loaded point's path     y_c = y_t - contact_fraction (y_t - y_b)
      |        .                y_b  bottom
      |     .                   Q = peak ((y_c - y)/(y_c - y_b))^n  for y < y_c on the way down, else 0
      |  .
      +--+-------+--> depth
        y_c     y_b
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.kernels.kernel import embedded_kernel, kernel


class StrokeLoad(NamedTuple):
    """Peak (N), heights where the layer begins and ends (m), exponent n."""

    peak_n: float
    contact_y_m: float
    bottom_y_m: float
    exponent: float


@kernel
def with_peak(load: StrokeLoad, peak_n: float) -> StrokeLoad:
    """Return the load with another peak (N)."""
    return StrokeLoad(peak_n, load.contact_y_m, load.bottom_y_m, load.exponent)


@embedded_kernel
def layer_force(load: StrokeLoad, y: float) -> float:
    """Return the force (N) at height ``y`` (m) while the layer is in contact.

    The regime decides on contact: with exponent 0 the force is the whole peak on first contact.
    """
    share = max((load.contact_y_m - y) / (load.contact_y_m - load.bottom_y_m), 0.0)
    return load.peak_n * math.pow(share, load.exponent)


@kernel
def layer_work(load: StrokeLoad, y: float) -> float:
    """Return the work (J) done on the layer from first contact down to height ``y`` (m): the force's integral."""
    depth = load.contact_y_m - load.bottom_y_m
    share = (load.contact_y_m - y) / depth
    return load.peak_n * depth / (load.exponent + 1.0) * share ** (load.exponent + 1.0) if share > 0.0 else 0.0

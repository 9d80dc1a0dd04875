# SPDX-License-Identifier: Apache-2.0
r"""Flywheel that keeps a cyclic machine's speed within bounds, from its work and its reduced inertia.

::

    W |        .-~-.            Wittenbauer: tangents of slope w_max^2/2 (from above) and w_min^2/2 (from below) to
      |   a __/_____\__ /       the closed curve of work W over inertia I cut the W axis at a and b;
      |     (       /  )         J = (a - b)/(delta w_m^2)
      | b __\__.--'__/
      +------------------- I    w_max,min = w_m (1 +- delta/2), delta = (w_max - w_min)/w_m

W(f) is the work of drive and loads from the start of the cycle; it comes back to zero.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Tangents(NamedTuple):
    """Wittenbauer's construction: cuts a, b of the W axis (J), positions where the tangents touch, inertia (kg m2)."""

    upper_j: float
    lower_j: float
    upper_position: int
    lower_position: int
    inertia_kg_m2: float


def wittenbauer(work: Array, inertia: Array, delta: float, mean_speed: float) -> Tangents:
    """Return the tangents to the energy-mass diagram and the flywheel they give.

    J = {max[W - w_max^2 I/2] - min[W - w_min^2 I/2]}/(delta w_m^2); exact where W and I are.

    Parameters
    ----------
    work, inertia : ndarray
        W (J) and reduced inertia I (kg m2) at the same positions, shape (n,).
    delta : float
        Asked non-uniformity.
    mean_speed : float
        w_m (rad/s).
    """
    fast, slow = mean_speed * (1.0 + 0.5 * delta), mean_speed * (1.0 - 0.5 * delta)
    upper = work - 0.5 * fast * fast * inertia
    lower = work - 0.5 * slow * slow * inertia
    high, low = int(np.argmax(upper)), int(np.argmin(lower))
    a, b = float(upper[high]), float(lower[low])
    return Tangents(a, b, high, low, (a - b) / (delta * mean_speed * mean_speed))


def exact_inertia(work: Array, inertia: Array, delta: float, mean_speed: float) -> float:
    """Return the flywheel (kg m2) with which the speed stays within w_m (1 +- delta/2), touching both."""
    return wittenbauer(work, inertia, delta, mean_speed).inertia_kg_m2


def textbook_inertia(work: Array, inertia: Array, delta: float, mean_speed: float) -> float:
    """Return the flywheel (kg m2) with w_max,min^2 replaced by w_m^2 (1 +- delta)."""
    square = mean_speed * mean_speed
    upper = work - 0.5 * square * (1.0 + delta) * inertia
    lower = work - 0.5 * square * (1.0 - delta) * inertia
    return float(upper.max() - lower.min()) / (delta * square)


def mertsalov_inertia(work: Array, inertia: Array, delta: float, mean_speed: float) -> float:
    """Return the flywheel (kg m2) after Mertsalov: range of W - w_m^2 I/2 over delta w_m^2."""
    square = mean_speed * mean_speed
    return float(np.ptp(work - 0.5 * square * inertia)) / (delta * square)


def start_speed(work: Array, inertia: Array, delta: float, mean_speed: float, flywheel: float) -> float:
    """Return the speed (rad/s) at the first position from which a run with this flywheel just reaches w_max."""
    fast = mean_speed * (1.0 + 0.5 * delta)
    energy = 0.5 * fast * fast * flywheel - float(np.max(work - 0.5 * fast * fast * inertia))
    return float(np.sqrt(2.0 * (energy + work[0]) / (flywheel + inertia[0])))


def non_uniformity(work: Array, inertia: Array, mean_speed: float, flywheel: float = 0.0) -> float:
    """Return delta of a machine with this flywheel (kg m2) and mean speed (w_max + w_min)/2; at most 2 (it stops)."""

    def missing(delta: float) -> float:
        return delta * (exact_inertia(work, inertia, delta, mean_speed) - flywheel)

    if missing(2.0) >= 0.0:
        return 2.0
    from scipy.optimize import brentq  # 0.2 s

    low = 1e-9
    return low if missing(low) <= 0.0 else float(brentq(missing, low, 2.0, xtol=1e-14))

# SPDX-License-Identifier: Apache-2.0
"""Curves of the breaker's linkage over a turn of its crank, the body at angle 0: what its bounds are taken from."""

from __future__ import annotations

import math

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker, Masses, masses_at, weight_moments
from mech_twin.parts.four_bar import FourBar, coefficients, position


@kernel
def turn_masses(b: Breaker, count: int) -> Masses:
    """Return the generalised masses at equal angles of a turn of the crank: (count,) each."""
    found = np.empty((8, count))
    for i in range(count):
        m = masses_at(b, 2.0 * math.pi * i / count, 0.0)
        found[0, i], found[1, i], found[2, i], found[3, i] = m.m11, m.m12, m.m22, m.m11_q
        found[4, i], found[5, i], found[6, i], found[7, i] = m.m12_q, m.m22_q, m.g_q, m.g_phi
    return Masses(found[0], found[1], found[2], found[3], found[4], found[5], found[6], found[7])


@kernel
def turn_heights(b: Breaker, count: int) -> Array:
    """Return the first moments of the links' masses above the crank's bearing (kg m) at equal angles of a turn."""
    found = np.empty(count)
    for i in range(count):
        found[i] = weight_moments(b, position(b.bar, 2.0 * math.pi * i / count))[1]
    return found


@kernel
def turn_rocker_rates(bar: FourBar, count: int) -> Array:
    """Return the rocker's angle per crank angle at equal angles of a turn, the last that of the first: (count + 1,)."""
    found = np.empty(count + 1)
    for i in range(count + 1):
        found[i] = coefficients(position(bar, 2.0 * math.pi * i / count)).g3
    return found

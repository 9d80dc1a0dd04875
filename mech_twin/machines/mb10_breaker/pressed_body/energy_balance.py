# SPDX-License-Identifier: Apache-2.0
"""Energy of the body in free swing: what its speed gained against the work of spring, load and damper, by quadrature.

::

    J (w1^2 - w0^2)/2  =  int_t0^t1 [M(t) - c l^2 (phi + phi0) - d w] w dt

The closed form of the motion enters only by its values: one that does not fulfil the equation of motion, or whose rate
is not the derivative of its angle, leaves the balance open.
"""

from __future__ import annotations

import math

import numpy as np

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, motion
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # good to rounding over a radian of the fastest oscillation


@kernel
def work_per_inertia(body: PressedBody, stretch: SwingStretch, start: float, end: float) -> float:
    """Return the work of load, spring and damper on the body between two times of a stretch, over J (rad2/s2)."""
    fastest = max(body.k, body.mu) if stretch.load > 0.0 else body.k
    panels = max(math.ceil((end - start) * fastest), 1)
    half = 0.5 * (end - start) / panels
    total = 0.0
    for panel in range(panels):
        for j in range(len(NODES)):
            s = start + half * (2.0 * panel + 1.0 + NODES[j])
            angle, rate = motion(body, stretch, s)
            pushed = stretch.load / body.inertia * math.sin(stretch.theta + body.mu * s)
            pressed = body.k * body.k * (angle + body.rest_angle) + 2.0 * body.damping * body.k * rate
            total += half * WEIGHTS[j] * (pushed - pressed) * rate
    return total


@kernel
def energy_left_open(body: PressedBody, stretch: SwingStretch, start: float, end: float) -> float:
    """Return what the balance leaves open between two times (s) of a stretch, over the energy.

    That is the largest of the two ends and of the seated body, in whose angle phi + phi0 is rounded.
    """
    angle0, rate0 = motion(body, stretch, start)
    angle1, rate1 = motion(body, stretch, end)
    work = work_per_inertia(body, stretch, start, end)
    before = 0.5 * (rate0 * rate0 + (body.k * (angle0 + body.rest_angle)) ** 2)
    after = 0.5 * (rate1 * rate1 + (body.k * (angle1 + body.rest_angle)) ** 2)
    seated = 0.5 * (body.k * body.rest_angle) ** 2
    scale = max(before, after, seated)
    return (0.5 * (rate1 * rate1 - rate0 * rate0) - work) / scale if scale > 0.0 else 0.0

# SPDX-License-Identifier: Apache-2.0
"""The breaker's body as the linkage computes it, with its spring force and regime.

Crank, body and tool move under one set of equations, which the linkage solves.  Angle and rate of the body come to
this role in the row of the forces.  A user's own body can replace it on the topics.  It integrates the moments and
impulses that the force analysis gives at each event and step end, and the linkage then uses its angle.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_roles import CompiledBody
from mech_twin.engine.compiled_steps import body_step, step_of
from mech_twin.engine.sample_vectors import (
    BODY_JOINTS,
    LOAD_IMPULSE,
    LOAD_KIND,
    PRESSING_FORCE,
    REGIME,
    Array,
    BodyLayout,
    row_of,
)
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.force_row import QUANTITIES_AT, STRIKES
from mech_twin.machines.mb10_breaker.forces import QUANTITIES
from mech_twin.machines.mb10_breaker.roles import BreakerForces
from mech_twin.machines.mb10_breaker.state import BODY_STARTED, BODY_STOPPED, LIFT_OFF, SETTLED, TOUCHDOWN
from mech_twin.samples import BodySample, ForceSample

CONTACT, FLYING, HANGING = 0, 1, 2
LED_ANGLE, LED_RATE = (QUANTITIES_AT + QUANTITIES.index(name) for name in ("body_angle_rad", "body_rate_rad_per_s"))


class Body(NamedTuple):
    """Constants of the body role."""

    breaker: Breaker


@kernel
def after_load(regime: int, kind: int, impulse: float) -> int:
    """Return the regime of the body after an event of the linkage with an angular impulse (N m s)."""
    if kind in STRIKES:
        return FLYING if regime != CONTACT or impulse > 0.0 else CONTACT
    if kind == SETTLED:
        return CONTACT
    if kind in (TOUCHDOWN, LIFT_OFF, BODY_STARTED):
        return FLYING
    return HANGING if kind == BODY_STOPPED else regime


@kernel
def fill_body(b: Breaker, forces: Array, regime: int, out: Array) -> None:
    """Fill the row of the body from the linkage's result."""
    phi = forces[LED_ANGLE]
    force = b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_m)
    out[REGIME], out[PRESSING_FORCE] = regime, force
    out[BODY_JOINTS], out[BODY_JOINTS + 1], out[BODY_JOINTS + 2] = phi, forces[LED_RATE], -force * b.spring_arm_m


@step_of(body_step, Body)
def follow_linkage(
    model: Body, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill ``out`` with the body one step later."""
    regime = int(body[REGIME])
    for i in range(count):
        regime = after_load(regime, int(loads[i, LOAD_KIND]), loads[i, LOAD_IMPULSE])
    fill_body(model.breaker, forces, regime, out)
    return log, 0


class DrivenBody(CompiledBody):
    """The body role for the excitation ``from_forces``.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    step_s : float
        Coupling step.
    """

    joints = ("body",)
    regimes = ("rest", "flight", "hanging")
    residual_limits: Mapping[str, float] = MappingProxyType({})
    model: Body
    layout = BodyLayout(joints, (), ())
    force_layout = BreakerForces.layout

    def __init__(self, breaker: Breaker, step_s: float) -> None:
        self.step_s = step_s
        self.model = Body(breaker)

    def start(self, forces: ForceSample) -> BodySample:
        """Return the body at rest on its collar."""
        out = np.empty(self.layout.size)
        fill_body(self.model.breaker, row_of(forces), CONTACT, out)
        return self.layout.sample(forces.step, forces.time_s, out.tolist(), ())

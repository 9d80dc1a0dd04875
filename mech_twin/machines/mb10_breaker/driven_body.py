# SPDX-License-Identifier: Apache-2.0
"""The breaker's body under the moments and impulses of the force analysis: closed form between knots, no stepping.

J p' + d p + c (l phi + a) l + c_phi sign p = M0 + M1 t on each piece between knots; the knots are the ends of the step
and the linkage's events, which alone decide when the body touches, settles or leaves, when it turns back, and when the
friction of its pivot holds it off its collar (`hanging`) or lets it go.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_roles import CompiledBody
from mech_twin.engine.compiled_steps import body_step, step_of
from mech_twin.engine.sample_vectors import (
    BODY_JOINTS,
    BODY_MOMENT,
    LOAD_IMPULSE,
    LOAD_KIND,
    LOAD_TIME,
    MOMENT_AFTER,
    MOMENT_BEFORE,
    PRESSING_FORCE,
    REGIME,
    Array,
    BodyLayout,
    row_of,
)
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.constants import CouplingLimits
from mech_twin.machines.mb10_breaker.dynamics import Breaker, spring_moment
from mech_twin.machines.mb10_breaker.force_row import QUANTITIES_AT, STRIKES
from mech_twin.machines.mb10_breaker.forces import QUANTITIES
from mech_twin.machines.mb10_breaker.roles import BreakerForces
from mech_twin.machines.mb10_breaker.state import (
    BODY_REVERSED,
    BODY_STARTED,
    BODY_STOPPED,
    LIFT_OFF,
    SETTLED,
    TOUCHDOWN,
)
from mech_twin.samples import BodySample, ForceSample

CONTACT, FLYING, HANGING = 0, 1, 2
ON_COLLAR = (TOUCHDOWN, SETTLED, LIFT_OFF)
OF_PIVOT = (BODY_STOPPED, BODY_STARTED, BODY_REVERSED)
LED_ANGLE, LED_RATE, BEGIN_MOMENT = (
    QUANTITIES_AT + QUANTITIES.index(name) for name in ("body_angle_rad", "body_rate_rad_per_s", "step_begin_moment_nm")
)
SHORT_SWING_RAD = 1e-5  # of the free swing, or of its decay, in a span
RESIDUALS = ("angle_difference_rad", "rate_difference_rad_per_s", "penetration_rad")


@kernel
def pushed(
    inertia: float, stiffness: float, damping: float, phi: float, p: float, moment: float, slope: float, span: float
) -> tuple[float, float]:
    """Return angle and rate of the body after a span (s) in which it hardly swings, from its acceleration.

    ``moment`` is all that turns it at the start (N m).  The series to the fifth order in time: what is left out is the
    square of `SHORT_SWING_RAD` squared below acceleration and slope.
    """
    first = (moment - damping * p) / inertia
    second = (slope - stiffness * p - damping * first) / inertia
    third = -(stiffness * first + damping * second) / inertia
    fourth = -(stiffness * second + damping * third) / inertia
    bent = first / 2.0 + span * (second / 6.0 + span * (third / 24.0 + span * fourth / 120.0))
    rate = p + span * (first + span * (second / 2.0 + span * (third / 6.0 + span * fourth / 24.0)))
    return phi + span * (p + span * bent), rate


@kernel
def swung(
    inertia: float,
    stiffness: float,
    damping: float,
    preload: float,
    phi: float,
    p: float,
    moment: float,
    slope: float,
    span: float,
) -> tuple[float, float]:
    """Return angle and rate of the body after a span (s) under the moment ``moment + slope t`` (N m, N m/s).

    J p' + d p + kappa phi = M0 - preload + M1 t: the particular solution alpha + beta t with beta = M1/kappa,
    alpha = (M0 - preload - d beta)/kappa, and a damped oscillation on top.  Of a heavy body on a soft spring alpha is
    so far that the motion of a span is below its rounding; there the motion is its series.
    """
    if stiffness * span * span <= SHORT_SWING_RAD**2 * inertia and damping * span <= SHORT_SWING_RAD * inertia:
        return pushed(inertia, stiffness, damping, phi, p, moment - preload - stiffness * phi, slope, span)
    beta = slope / stiffness
    alpha = (moment - preload - damping * beta) / stiffness
    decay = 0.5 * damping / inertia
    k = math.sqrt(stiffness / inertia - decay * decay)
    x, v = phi - alpha, p - beta
    c, s, fade = math.cos(k * span), math.sin(k * span), math.exp(-decay * span)
    sine = (v + decay * x) / k
    angle = alpha + beta * span + fade * (x * c + sine * s)
    rate = beta + fade * (v * c - (k * x + decay * sine) * s)
    return angle, rate


class Body(NamedTuple):
    """Constants of the body role: the breaker's, and the coupling step (s)."""

    breaker: Breaker
    step_s: float


@kernel
def flown(
    b: Breaker, phi: float, p: float, regime: int, sense: float, moment: float, final: float, span: float
) -> tuple[float, float]:
    """Return angle and rate after a span (s) under a moment (N m) that goes in a line from one value to another."""
    if regime != FLYING or span <= 0.0:
        return phi, p
    return swung(
        b.body_inertia_kg_m2,
        b.spring_rate_n_per_m * b.spring_arm_m * b.spring_arm_m,
        b.body_damping_nms_per_rad,
        b.spring_rate_n_per_m * b.preload_m * b.spring_arm_m + b.body_coulomb_nm * sense,
        phi,
        p,
        moment,
        (final - moment) / span,
        span,
    )


@kernel
def after_load(b: Breaker, phi: float, p: float, regime: int, kind: int, impulse: float) -> tuple[float, float, int]:
    """Return angle, rate and regime after an event of the linkage, which may bring an angular impulse (N m s)."""
    if kind in STRIKES:
        p += impulse / b.body_inertia_kg_m2
        return phi, p, (FLYING if regime != CONTACT or p > 0.0 else regime)
    if kind == TOUCHDOWN:
        return 0.0, -b.collar_restitution * p, FLYING
    if kind == SETTLED:
        return 0.0, 0.0, CONTACT
    if kind == LIFT_OFF:
        return 0.0, 0.0, FLYING
    if kind == BODY_STOPPED:
        return phi, 0.0, HANGING
    return phi, p, (FLYING if kind == BODY_STARTED else regime)


@kernel
def sliding_sense(b: Breaker, phi: float, p: float, moment: float) -> float:
    """Return the sense (+1, -1) in which the body slides in its pivot: at no speed the one in which it sets off."""
    moved_by = p if p != 0.0 else moment - spring_moment(b, phi)
    return 1.0 if moved_by >= 0.0 else -1.0


@kernel
def fill_body(b: Breaker, forces: Array, phi: float, p: float, regime: int, found: float, out: Array) -> None:
    """Fill the row of the body in a state; ``found`` is the largest angle (rad) at which it met its collar."""
    force = b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_m)
    out[REGIME], out[PRESSING_FORCE] = regime, force
    out[BODY_JOINTS], out[BODY_JOINTS + 1], out[BODY_JOINTS + 2] = phi, p, -force * b.spring_arm_m
    at = BODY_JOINTS + 3
    out[at], out[at + 1], out[at + 2] = forces[LED_ANGLE] - phi, forces[LED_RATE] - p, found


@step_of(body_step, Body)
def follow_loads(
    model: Body, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill in the body one step later, under the moments and impulses of the force analysis."""
    b, time, found = model.breaker, (step - 1) * model.step_s, 0.0
    phi, p, regime = body[BODY_JOINTS], body[BODY_JOINTS + 1], int(body[REGIME])
    moment = forces[BEGIN_MOMENT]
    sense = sliding_sense(b, phi, p, moment)
    for i in range(count):
        at, kind = loads[i, LOAD_TIME], int(loads[i, LOAD_KIND])
        phi, p = flown(b, phi, p, regime, sense, moment, loads[i, MOMENT_BEFORE], at - time)
        if kind in (TOUCHDOWN, SETTLED):
            found = max(found, abs(phi))
        phi, p, regime = after_load(b, phi, p, regime, kind, loads[i, LOAD_IMPULSE])
        time, moment = at, loads[i, MOMENT_AFTER]
        if kind in OF_PIVOT:
            sense = sliding_sense(b, phi, 0.0, moment)
        elif kind in STRIKES or kind in ON_COLLAR:
            sense = sliding_sense(b, phi, p, moment)
    phi, p = flown(b, phi, p, regime, sense, moment, forces[BODY_MOMENT], step * model.step_s - time)
    fill_body(b, forces, phi, p, regime, found, out)
    return log, 0


class DrivenBody(CompiledBody):
    """The body role for the excitation ``from_forces``.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    step_s : float
        Coupling step.
    limits : CouplingLimits
        How far the body's own motion may lie from the one the linkage led it to.
    """

    joints = ("body",)
    regimes = ("rest", "flight", "hanging")
    model: Body
    layout = BodyLayout(joints, (), RESIDUALS)
    force_layout = BreakerForces.layout

    def __init__(self, breaker: Breaker, step_s: float, limits: CouplingLimits) -> None:
        allowed = (limits.angle_rad, limits.rate_rad_per_s, limits.angle_rad)
        self.residual_limits: Mapping[str, float] = MappingProxyType(dict(zip(RESIDUALS, allowed, strict=True)))
        self.step_s = step_s
        self.model = Body(breaker, float(step_s))

    def start(self, forces: ForceSample) -> BodySample:
        """Return the body at rest on its collar."""
        out = np.empty(self.layout.size)
        fill_body(self.model.breaker, row_of(forces), 0.0, 0.0, CONTACT, 0.0, out)
        return self.layout.sample(forces.step, forces.time_s, out.tolist(), ())

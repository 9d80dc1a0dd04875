"""The breaker's body under the moments and impulses of the force analysis: closed form between knots, no stepping.

J p' + d p + c (l phi + a) l + c_phi sign p = M0 + M1 t on each piece between knots; the knots are the ends of the step
and the linkage's events, which alone decide when the body touches, settles or leaves, when it turns back, and when the
friction of its pivot holds it off its collar (`hanging`) or lets it go.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from mech_twin.kernel import kernel
from mech_twin.machines.mb10_breaker.coupling_limits import CouplingLimits
from mech_twin.machines.mb10_breaker.dynamics import Breaker, spring_moment
from mech_twin.machines.mb10_breaker.forces import QUANTITIES
from mech_twin.samples import BodySample, ForceSample, Load, Named

CONTACT, FLYING, HANGING = 0, 1, 2
STRIKES = frozenset(("blow", "catch_up", "push_begins"))
ON_COLLAR = frozenset(("touchdown", "settled", "lift_off"))
OF_PIVOT = frozenset(("body_stopped", "body_started", "body_reversed"))
LED_ANGLE, LED_RATE, BEGIN_MOMENT = (
    QUANTITIES.index(name) for name in ("body_angle_rad", "body_rate_rad_per_s", "step_begin_moment_nm")
)
RESIDUALS = ("angle_difference_rad", "rate_difference_rad_per_s", "penetration_rad")


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
    alpha = (M0 - preload - d beta)/kappa, and a damped oscillation on top.
    """
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


class DrivenBody:
    """The body role for the excitation ``from_forces``.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    limits : CouplingLimits
        How far the body's own motion may lie from the one the linkage led it to.
    """

    joints = ("body",)
    regimes = ("rest", "flight", "hanging")

    def __init__(self, breaker: Breaker, limits: CouplingLimits) -> None:
        self._b = breaker
        allowed = (limits.angle_rad, limits.rate_rad_per_s, limits.angle_rad)
        self.residual_limits: Mapping[str, float] = MappingProxyType(dict(zip(RESIDUALS, allowed, strict=True)))

    def start(self, forces: ForceSample) -> BodySample:
        """Return the body at rest on its collar."""
        return self._sample(forces, 0.0, 0.0, CONTACT, 0.0)

    def follow(self, body: BodySample, forces: ForceSample) -> BodySample:
        """Return the body at the step of these forces, its moment linear between the knots."""
        (phi,), (p,), regime = body.position, body.velocity, body.regime
        time, found = body.time_s, 0.0
        moment = forces.quantities.values[BEGIN_MOMENT]
        sense = self._sense(phi, p, moment)
        for load in forces.loads:
            phi, p = self._flown(phi, p, regime, sense, moment, load.moment_before_nm, load.time_s - time)
            if load.kind in {"touchdown", "settled"}:
                found = max(found, abs(phi))
            phi, p, regime = self._after(phi, p, regime, load)
            time, moment = load.time_s, load.moment_after_nm
            if load.kind in OF_PIVOT:
                sense = self._sense(phi, 0.0, moment)
            elif load.kind in STRIKES or load.kind in ON_COLLAR:
                sense = self._sense(phi, p, moment)
        phi, p = self._flown(phi, p, regime, sense, moment, forces.body_moment_nm, forces.time_s - time)
        return self._sample(forces, phi, p, regime, found)

    def _sense(self, phi: float, p: float, moment: float) -> float:
        """Return the sense (+1, -1) in which the body slides in its pivot: at no speed the one in which it sets off."""
        b = self._b
        moved_by = p if p != 0.0 else moment - spring_moment(b, phi)
        return 1.0 if moved_by >= 0.0 else -1.0

    def _flown(
        self, phi: float, p: float, regime: int, sense: float, moment: float, final: float, span: float
    ) -> tuple[float, float]:
        if regime != FLYING or span <= 0.0:
            return phi, p
        b = self._b
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

    def _after(self, phi: float, p: float, regime: int, load: Load) -> tuple[float, float, int]:
        if load.kind in STRIKES:
            p += load.impulse_nms / self._b.body_inertia_kg_m2
            return phi, p, (FLYING if regime != CONTACT or p > 0.0 else regime)
        if load.kind in ON_COLLAR:
            rebound = -self._b.collar_restitution * p if load.kind == "touchdown" else 0.0
            return 0.0, rebound, (CONTACT if load.kind == "settled" else FLYING)
        if load.kind == "body_stopped":
            return phi, 0.0, HANGING
        return phi, p, (FLYING if load.kind == "body_started" else regime)

    def _sample(self, forces: ForceSample, phi: float, p: float, regime: int, found: float) -> BodySample:
        b = self._b
        force = b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_m)
        led_phi, led_p = forces.quantities.values[LED_ANGLE], forces.quantities.values[LED_RATE]
        return BodySample(
            forces.step,
            forces.time_s,
            self.joints,
            (phi,),
            (p,),
            (-force * b.spring_arm_m,),
            regime,
            force,
            Named(),
            Named(RESIDUALS, (led_phi - phi, led_p - p, found)),
        )

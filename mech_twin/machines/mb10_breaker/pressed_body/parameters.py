# SPDX-License-Identifier: Apache-2.0
"""Parameters of the spring-pressed body and of its excitation, and the constants of the kernels.

::

      spring c, preload a
            |                     phi, M > 0: the body leaves the tool
            v                         ^
    A o-----+-----------------+------ )        A   crank axis, the body turns about it
      |<-l->|                 |                l   arm of the spring
      |<------- r_tool ------>|                r_tool   arm of the collar
                           =====               collar of the tool: phi >= 0
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Literal, NamedTuple

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, keep_at_most, quantity, upper
from mech_twin.parts.friction_and_gear import Friction

STIFFEST = 1000.0  # k over the cycle frequency up to which the half sine's chain of events is followed
MOST_DAMPING = 0.99
MATCH = 1e-9  # how far a stated frequency ratio may lie from the one that follows from the onset


class BodyParameters(Parameters):
    """The body that turns about the crank axis, its pressing spring and the collar of the tool."""

    inertia_kg_m2: float = quantity("kg m^2", "inertia of the body about the crank axis, J", ge=1e-3, le=1e6)
    spring_arm_m: float = quantity("m", "arm of the pressing spring about the crank axis, l", ge=1e-3, le=10.0)
    spring_rate_n_per_m: float = quantity("N/m", "rate of the pressing spring, c", live=True, ge=1.0, le=1e10)
    preload_deflection_m: float = quantity(
        "m", "spring deflection with the body on the tool, a", live=True, ge=0, le=1000.0
    )
    restitution: float = quantity("1", "restitution of body on tool collar, e", live=True, ge=0, le=0.99)
    tool_radius_m: float = quantity("m", "arm of the tool collar about the crank axis, r_tool", ge=1e-3, le=10.0)
    damping_ratio: float = quantity("1", "damping of the body on its spring, zeta", live=True, ge=0, le=0.99)
    blow_impulse_nms: float = quantity(
        "N m s", "angular impulse of the blow on the body, S, lifting positive", ge=0, le=1e6, default=0.0
    )
    contact: Literal["one_sided", "none"] = choice(
        "one_sided: the collar only pushes (phi >= 0); none: the body swings freely through it, as published",
        default="one_sided",
    )
    friction: Friction = choice("friction of the body's pivot", default=Friction())

    @property
    def damping(self) -> float:
        """Damping ratio with the friction of the pivot, zeta + v/(2 k J)."""
        k = self.spring_arm_m * sqrt(self.spring_rate_n_per_m / self.inertia_kg_m2)
        return self.damping_ratio + self.friction.viscous_nms_per_rad / (2.0 * k * self.inertia_kg_m2)

    @model_validator(mode="after")
    def _swings(self) -> BodyParameters:
        most = 2.0 * (MOST_DAMPING - self.damping_ratio) * self.spring_arm_m
        most *= sqrt(self.spring_rate_n_per_m * self.inertia_kg_m2)
        why = f"so that with damping_ratio the body still swings (zeta at most {MOST_DAMPING:g})"
        keep_at_most("friction.viscous_nms_per_rad", self.friction.viscous_nms_per_rad, most, why)
        return self


class ExcitationParameters(Parameters):
    """The moment on the body: the published half sine, or that of the force analysis."""

    kind: Literal["approximated", "from_forces"] = choice(
        "approximated: half sine at the end of the cycle; from_forces: moment and blow of the running linkage"
    )
    form: Literal["shifted", "printed"] = choice(
        "shifted: +|H| sin(mu (t - t1)), lifting; printed: H sin(mu t) to the letter", default="shifted"
    )
    amplitude_nm: float = quantity(
        "N m", "amplitude of the half sine, H (shifted takes its magnitude)", live=True, ge=-1e6, le=1e6
    )
    frequency_ratio: float | None = quantity(
        "1", "mu over the cycle frequency; half a period fills the stretch after the onset", gt=0, default=None
    )
    onset_fraction: float = quantity("1", "part of the cycle before the half sine begins, t1/T", ge=0.01, le=0.999)
    blow_rate_hz: float = quantity("Hz", "blows per second of the approximated excitation", ge=0.1, le=100.0)

    @model_validator(mode="after")
    def _half_a_period_fills_the_stretch(self) -> ExcitationParameters:
        derived = 0.5 / (1.0 - self.onset_fraction)
        if self.frequency_ratio is not None and abs(self.frequency_ratio - derived) > MATCH * derived:
            raise ValueError(
                f"frequency_ratio must be 1/(2 (1 - onset_fraction)) = {derived:.9g} so that half a period fills the "
                f"rest of the cycle, or be left out; got {self.frequency_ratio:.9g}"
            )
        return self


def motion_refusal(body: BodyParameters, excitation: ExcitationParameters) -> str:
    """Return why the motion of the body under the half sine is not computed, or an empty string.

    A cycle of a stiff body holds some k/omega swings, each with its returns to the collar.  The printed half sine is
    zero at the end of a cycle: rounding decides whether a body without preload leaves its collar there.
    """
    if excitation.form == "printed" and body.contact == "one_sided" and body.preload_deflection_m == 0.0:
        return (
            "body.preload_deflection_m must be above 0 under the half sine of excitation.form printed, which without "
            f"preload lifts the body by rounding alone as each cycle ends; got {body.preload_deflection_m:g}"
        )
    omega = 2.0 * pi * excitation.blow_rate_hz
    k = body.spring_arm_m * sqrt(body.spring_rate_n_per_m / body.inertia_kg_m2)
    if k <= STIFFEST * omega:
        return ""
    most = body.inertia_kg_m2 * (STIFFEST * omega / body.spring_arm_m) ** 2
    return (
        f"body.spring_rate_n_per_m must be at most {upper(most)} under the half sine, so that the body swings at most "
        f"{STIFFEST:g} times a cycle; got {body.spring_rate_n_per_m:g}"
    )


class PressedBody(NamedTuple):
    """The constants of one body under one half sine, as the kernels take them.

    Lengths in m, angles in rad, times in s.  The load is ``amplitude sin(mu t + phase)`` with ``amplitude >= 0``.
    """

    inertia: float
    arm: float
    rate: float
    deflection: float
    restitution: float
    damping: float
    radius: float
    impulse: float
    one_sided: bool
    k: float
    rest_angle: float  # phi0 = a/l
    amplitude: float  # |H|
    mu: float
    phase: float
    period: float  # T
    onset: float  # t1


def pressed_body(body: BodyParameters, excitation: ExcitationParameters) -> PressedBody:
    """Return the constants of the body under the approximated excitation.

    k^2 = c l^2/J, phi0 = a/l, T = 1/blow rate, mu = pi/(T - t1).  The form ``shifted`` is
    M = |H| sin(mu t - mu t1); the form ``printed`` is M = H sin(mu t), a negative H being a phase of pi.
    """
    period = 1.0 / excitation.blow_rate_hz
    onset = excitation.onset_fraction * period
    mu = pi / (period - onset)
    printed_phase = 0.0 if excitation.amplitude_nm >= 0.0 else pi
    phase = -mu * onset if excitation.form == "shifted" else printed_phase
    return PressedBody(
        inertia=body.inertia_kg_m2,
        arm=body.spring_arm_m,
        rate=body.spring_rate_n_per_m,
        deflection=body.preload_deflection_m,
        restitution=body.restitution,
        damping=body.damping,
        radius=body.tool_radius_m,
        impulse=body.blow_impulse_nms,
        one_sided=body.contact == "one_sided",
        k=body.spring_arm_m * sqrt(body.spring_rate_n_per_m / body.inertia_kg_m2),
        rest_angle=body.preload_deflection_m / body.spring_arm_m,
        amplitude=abs(excitation.amplitude_nm),
        mu=mu,
        phase=phase,
        period=period,
        onset=onset,
    )

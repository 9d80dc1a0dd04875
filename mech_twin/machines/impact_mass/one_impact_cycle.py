# SPDX-License-Identifier: Apache-2.0
"""The motion with one impact per period: synthesis, closed form, multipliers.

::

        v- |     /|            /|        one period: blow, recoil under A2, stroke under A1, wait w under A2
           |    / |           / |
      -----+---/--|----------/--|---> t
       -R v-  /   |   ______/   |
           |      |__/          |
              t1  ^ blow at t1 + w

m is the mass, d = xc - x0 the stroke, R the restitution, A1 = P1/m, A2 = P2/m, <A> their mean over the period T.
Velocities are positive towards the stop.

Source: manzhosov_novikov, section 3 (synthesis); the closed form, its multipliers and limits are derived here.
"""

import cmath
import math
from dataclasses import dataclass
from typing import NamedTuple

from mech_twin.errors import StudyError
from mech_twin.machines.impact_mass.dynamics import ImpactSystem, mean_acceleration


@dataclass(frozen=True)
class CycleSpec:
    """Specification of a cycle: mass, stop, start of the stroke, impact speed, restitution."""

    mass_kg: float
    stop_position_m: float
    initial_position_m: float
    initial_velocity_m_per_s: float
    impact_speed_m_per_s: float
    restitution: float

    @property
    def stroke_m(self) -> float:
        """Distance d = xc - x0, m."""
        return self.stop_position_m - self.initial_position_m


class SynthesisedCycle(NamedTuple):
    """A one-impact cycle and the forces that make it, SI units."""

    rebound_velocity_m_per_s: float
    phase1_duration_s: float
    period_s: float
    phase1_force_n: float
    phase2_force_n: float


class OneImpactCycle(NamedTuple):
    """A period-T motion with one impact: time of the impact and state at the start of a period.

    ``position_share`` is the time of the blow within its phase, 0 at the phase's start and 1 at its end; the motion
    exists if it lies between.
    """

    phase: int
    impact_tau_s: float
    impact_speed_m_per_s: float
    start_gap_m: float
    start_velocity_m_per_s: float
    position_share: float
    multipliers: tuple[complex, complex]


def synthesised_cycle(spec: CycleSpec) -> SynthesisedCycle:
    """Return forces and times of the cycle that starts at x0, v0 and strikes with v- at the change of phase.

    v+ = -R v-; t1 = 2 d/(v- + v0); T = t1 - 2 d/(v+ + v0); P1 = m (v-^2 - v0^2)/(2 d); P2 = m (v0 - v+)/(T - t1).

    Raises
    ------
    StudyError
        If the cycle cannot exist, naming the inequality and its numbers.

    Notes
    -----
    manzhosov_novikov, section 3.
    """
    d, mass_kg, x0 = spec.stroke_m, spec.mass_kg, spec.initial_position_m
    v0, v1, r = spec.initial_velocity_m_per_s, spec.impact_speed_m_per_s, spec.restitution
    _require(0.0 < r < 1.0, "0 < restitution < 1", f"restitution = {r!r}")
    _require(mass_kg > 0.0, "mass_kg > 0", f"mass_kg = {mass_kg!r}")
    _require(d > 0.0, "initial_position_m < stop_position_m", f"{x0!r}, {spec.stop_position_m!r}")
    _require(v1 > 0.0, "impact_speed_m_per_s > 0", f"impact_speed_m_per_s = {v1!r}")
    _require(v0 < r * v1, "initial_velocity_m_per_s < restitution * impact_speed_m_per_s", f"{v0!r}, {r * v1!r}")
    _require(v0 > -v1, "initial_velocity_m_per_s > -impact_speed_m_per_s", f"{v0!r}, {-v1!r}")
    rebound = -r * v1
    stroke_s = 2.0 * d / (v1 + v0)
    recoil_s = 2.0 * d / -(rebound + v0)
    return SynthesisedCycle(
        rebound,
        stroke_s,
        stroke_s + recoil_s,
        mass_kg * (v1 - v0) * (v1 + v0) / (2.0 * d),
        mass_kg * (v0 - rebound) / recoil_s,
    )


def _require(holds: bool, inequality: str, numbers: str) -> None:
    if not holds:
        raise StudyError(f"no cycle: {inequality} does not hold: {numbers}")


def multipliers(stability_number: float, restitution: float) -> tuple[complex, complex]:
    """Return the two multipliers of a one-impact cycle, larger modulus first.

    With q = A_c/<A>, A_c the acceleration at the blow: l^2 - ((1+R)^2 q - 2R) l + R^2 = 0, from the product of the
    free flight (1 T; 0 1) and the jump (-R 0; (1+R) A_c/v- -R).  Stable if and only if -((1-R)/(1+R))^2 < q < 1.
    """
    trace = (1.0 + restitution) ** 2 * stability_number - 2.0 * restitution
    root = cmath.sqrt(trace * trace - 4.0 * restitution**2)
    large = 0.5 * (trace + root) if (trace * root.real >= 0.0) else 0.5 * (trace - root)
    return large, restitution**2 / large


def least_stability_number(restitution: float) -> float:
    """Return the lower limit of stability of q = A_c/<A>: -((1-R)/(1+R))^2."""
    return -(((1.0 - restitution) / (1.0 + restitution)) ** 2)


def one_impact_cycle(system: ImpactSystem, phase: int) -> OneImpactCycle | None:
    """Return the period-T motion whose blow falls in the given phase (0 or 1), or None if <A> <= 0 or A1 = A2.

    Every such motion strikes with v- = <A> T/(1 + R).
    The blow falls at w after the start of its phase (length l, acceleration A; the other phase: k, B).
    The displacement over a period is zero, which is linear in w: w = (R v- T - A l^2/2 - A l k - B k^2/2)/(k (B - A)).
    The motion exists if 0 <= w <= l and there is no earlier impact; the caller checks the second condition.
    """
    mean, restitution, period_s = mean_acceleration(system), system.restitution, system.period_s
    accelerations = system.acceleration1, system.acceleration2
    a, b = accelerations[phase], accelerations[1 - phase]
    if mean <= 0.0 or a == b:
        return None
    own_s = (system.phase1_s, period_s - system.phase1_s)[phase]
    other_s = period_s - own_s
    v = mean * period_s / (1.0 + restitution)
    travel = restitution * v * period_s - 0.5 * a * own_s**2 - a * own_s * other_s - 0.5 * b * other_s**2
    steepness = other_s * (b - a)
    if steepness == 0.0:  # levels so close that their difference is lost
        return None
    w = travel / steepness
    if phase == 0:
        gap, velocity = v * w - 0.5 * a * w * w, v - a * w
    else:
        left = own_s - w
        gap, velocity = restitution * v * left - 0.5 * a * left * left, a * left - restitution * v
    tau = w if phase == 0 else system.phase1_s + w
    return OneImpactCycle(phase, tau, v, gap, velocity, w / own_s, multipliers(a / mean, restitution))


def phase1_chatter_share(system: ImpactSystem) -> float:
    """Return f: phase-1 chatter completes every period if t1 >= f (T - t1); inf unless A1 > 0 > A2.

    f = b/A1 + sqrt(b^2 + A1 b)/A1 (1 + 2R/(1-R)) with b = -A2 > 0.
    """
    a, b, restitution = system.acceleration1, -system.acceleration2, system.restitution
    if a <= 0.0 or b <= 0.0:
        return math.inf
    return b / a + math.sqrt(b * b + a * b) / a * (1.0 + 2.0 * restitution / (1.0 - restitution))

# SPDX-License-Identifier: Apache-2.0
"""Growth of a small perturbation in closed form (tangent map): flight, impact, and a whole series of impacts.

A perturbation is (dx, dv) at one time, with dx divided by the period so that both are speeds.  Flight: (1 t; 0 1).
Impact with speed v- under A: (-R 0; (1 + R) A/v- -R).  A completed series erases every perturbation.
"""

from __future__ import annotations

import math

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.impact_mass.dynamics import (
    ImpactSystem,
    MassMotion,
    MotionEvent,
    acceleration,
    next_event,
    phase_end,
)
from mech_twin.machines.impact_mass.states import (
    CHATTER_END,
    FLIGHT,
    IMPACT,
    IMPACTS_SUMMED,
    PHASE_1,
    PHASE_2,
    PHASE_CHANGE,
)

GENERIC = (1.0, 0.7)  # a direction that is no eigenvector of a flight or an impact


@kernel
def after_summed(
    dx: float, dv: float, motion: MassMotion, event: MotionEvent, system: ImpactSystem
) -> tuple[float, float]:
    """Return the perturbation at the last of several impacts of one series, from that right after the preceding one.

    The speed of the next impact changes by dv_1 = (v dv - A dx)/v_1 and its time by dt_1 = (dv_1 - dv)/A; from there
    dv_n = R^(n-1) dv_1 and dt_n = dt_1 + 2 R dv_1/A (1 - R^(n-1))/(1 - R).
    """
    a, r = acceleration(motion, system) * system.period_s, system.restitution
    change = (motion.velocity_m_per_s * dv - a * dx) / event.pre_m_per_s
    later = (change - dv) / a
    decay = math.pow(r, event.impacts - 1.0)
    later += 2.0 * r * change / a * (1.0 - decay) / (1.0 - r)
    return -event.post_m_per_s * later, -r * decay * change - a * later


@kernel
def tangent_after(
    dx: float, dv: float, motion: MassMotion, event: MotionEvent, system: ImpactSystem
) -> tuple[float, float]:
    """Return the perturbation after an event (impacts or a change of phase), from that after the last event."""
    if event.kind == IMPACTS_SUMMED:
        return after_summed(dx, dv, motion, event, system)
    if event.kind == IMPACT:
        dx += dv * (event.tau_s - motion.tau_s) / system.period_s
        turn = (1.0 + system.restitution) * acceleration(motion, system) * system.period_s / event.pre_m_per_s
        return -system.restitution * dx, turn * dx - system.restitution * dv
    return dx + dv * (phase_end(motion, system) - motion.tau_s) / system.period_s, dv


@kernel
def exponent(motion: MassMotion, system: ImpactSystem, periods: int) -> tuple[MassMotion, float]:
    """Return the motion after a number of periods and the largest Lyapunov exponent per period (natural log).

    A completed series erases every perturbation: the exponent is -inf.
    """
    dx, dv = GENERIC
    growth, last = 0.0, motion.period + periods
    while motion.period < last:
        event, after = next_event(motion, system)
        if event.impacts == 0.0 and event.kind != PHASE_CHANGE:
            return after, -math.inf
        dx, dv = tangent_after(dx, dv, motion, event, system)
        size = math.hypot(dx, dv)
        growth += math.log(size)
        dx, dv, motion = dx / size, dv / size, after
    return motion, growth / periods


@kernel
def release_growth(system: ImpactSystem, most_periods: float) -> tuple[float, float]:
    """Return the periods from one release to the end of the next completed series, and the growth between (log).

    Every release from rest starts the same motion.  The growth is the largest of a perturbation between any two
    changes of phase; rounding errors grow by it.  Returns 0 periods if no series completes within ``most_periods``.
    """
    phase = PHASE_2 if system.acceleration2 < 0.0 else PHASE_1
    tau = system.phase1_s if phase == PHASE_2 else 0.0
    motion = MassMotion(0.0, tau, phase, 0.0, 0.0, FLIGHT, 0.0, 0.0, 0.0)
    dx, dv = GENERIC
    size, least, growth = 0.0, 0.0, 0.0
    while motion.period <= most_periods:
        event, after = next_event(motion, system)
        if event.kind == CHATTER_END:
            return (motion.period if phase == PHASE_2 else motion.period + 1.0), growth
        dx, dv = tangent_after(dx, dv, motion, event, system)
        now = math.hypot(dx, dv)
        size += math.log(now)
        dx, dv, motion = dx / now, dv / now, after
        if event.kind == PHASE_CHANGE:
            least, growth = min(least, size), max(growth, size - least)
    return 0.0, growth

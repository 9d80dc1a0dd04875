# SPDX-License-Identifier: Apache-2.0
"""Long event-driven simulation: periods one after the other in constant memory, and what becomes of initial states."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.impact_mass.dynamics import (
    CHATTER_END,
    FLIGHT,
    IMPACT,
    RELEASE,
    ImpactSystem,
    MassMotion,
    initial_motion,
    mean_acceleration,
    next_event,
    rests_for_good,
)

AT_REST, LEFT, WANDERING = -1, -2, -3  # fates of a start that does not reach the cycle


class PeriodOutcome(NamedTuple):
    """One period: the motion at its end, its impacts (those listed), completed series, hardest blow, and releases."""

    motion: MassMotion
    impacts: float
    chatter_ends: float
    largest_blow_m_per_s: float
    releases: float


@kernel
def next_period(motion: MassMotion, system: ImpactSystem) -> PeriodOutcome:
    """Return the outcome of the rest of the present period."""
    number = motion.period
    impacts, ends, largest, releases = 0.0, 0.0, 0.0, 0.0
    while motion.period == number:
        event, motion = next_event(motion, system)
        if event.impacts > 0.0:
            impacts += event.impacts
            largest = max(largest, event.pre_m_per_s)
        elif event.kind == CHATTER_END:
            ends += 1.0
        elif event.kind == RELEASE:
            releases += 1.0
    return PeriodOutcome(motion, impacts, ends, largest, releases)


@kernel
def strikes_once_a_period(motion: MassMotion, system: ImpactSystem, tolerance_s: float) -> bool:
    """Return whether the next impact is one period after this one; ``motion`` is right after a blow."""
    period, tau = motion.period, motion.tau_s
    while motion.period <= period + 1.0:
        event, motion = next_event(motion, system)
        if event.kind == IMPACT:
            return abs((event.period - period - 1.0) * system.period_s + event.tau_s - tau) <= tolerance_s
    return False


@kernel
def leaves_for_good(before: MassMotion, after: MassMotion, impacts: float, system: ImpactSystem) -> bool:
    """Return whether the mass escapes for ever, from the motion at the start and at the end of one period.

    With <A> <= 0, a period without contact that ends no nearer and no faster than it began is followed by periods
    that lie wholly below it.  With <A> > 0 the mass always comes back.
    """
    if mean_acceleration(system) > 0.0 or impacts > 0.0 or before.mode != FLIGHT or after.mode != FLIGHT:
        return False
    return after.gap_m >= before.gap_m > 0.0 and after.velocity_m_per_s <= before.velocity_m_per_s


@kernel
def settled_at(
    motion: MassMotion, system: ImpactSystem, target: MassMotion, tolerances: tuple[float, float], limit: int
) -> int:
    """Return the number of periods until a motion has converged to the period-1 orbit through ``target``.

    Returns -1 if it rests for ever, -2 if it escapes, -3 if nothing is decided within ``limit`` periods.  Converged:
    gap and velocity at three period starts in a row are within the tolerances (m, m/s).
    """
    near = 0
    for number in range(limit):
        close = abs(motion.gap_m - target.gap_m) <= tolerances[0]
        close = close and abs(motion.velocity_m_per_s - target.velocity_m_per_s) <= tolerances[1]
        near = near + 1 if close else 0
        if near == 3:
            return number - 2
        if rests_for_good(motion, system):
            return AT_REST
        period = next_period(motion, system)
        if leaves_for_good(motion, period.motion, period.impacts, system):
            return LEFT
        motion = period.motion
    return WANDERING


@kernel
def fates(
    gaps_m: NDArray[np.float64],
    velocities_m_per_s: NDArray[np.float64],
    system: ImpactSystem,
    target: MassMotion,
    tolerances: tuple[float, float],
    limit: int,
) -> NDArray[np.int64]:
    """Return the outcome of `settled_at` for each initial state at the start of a period."""
    found = np.empty(len(gaps_m), np.int64)
    for i in range(len(gaps_m)):
        start = initial_motion(gaps_m[i], velocities_m_per_s[i], system)
        found[i] = settled_at(start, system, target, tolerances, limit)
    return found

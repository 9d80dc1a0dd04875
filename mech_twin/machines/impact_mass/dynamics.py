# SPDX-License-Identifier: Apache-2.0
"""Event-driven simulation of the impact mass: from one event to the next in closed form, without a time step.

A motion is stored as its last event: the number of the period, the time tau within it, gap and velocity there.
Only tau enters the computation, so no digits are lost at large times: the instant of an event is
period * T + tau, formed once.  Between events the motion is a parabola, or rest at the stop.

Events are *impact*, *phase* (the force changes) and *chatter_end*: an endless series, or its kept part with a cut-off,
is over and the mass rests.  At *release* the force turns away from a resting mass, right after the phase at the same
instant.  An event *impacts_summed* stands for several impacts of one series: near R = 1 it has millions.  Those after
the first thousand are summed in closed form up to the end of the phase or of the coupling step.

Ties: an impact or a chatter end at exactly the instant of a change belongs to the phase that ends and comes before
the change.  A phase that starts at the stop with v > 0 (rounding put the blow behind the change) strikes at once.

At the end: periods one after the other in constant memory, and what becomes of initial states.

Named states and events are floats, because they stand beside numbers in the arrays and samples of the compiled event
walk.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.impact_mass.impact_stop import (
    LISTED_RATIO,
    arrival,
    exact_product,
    flown_gap,
    impacts_kept,
    impacts_within,
    series_delay,
    series_length,
    series_sum,
)

FLIGHT, SERIES, STUCK = 0.0, 1.0, 2.0  # mode of the motion after an event
MODE_NAMES = ("free", "chatter", "stuck")
PHASE_1, PHASE_2 = 0.0, 1.0  # phase of the force

IMPACT, CHATTER_END, RELEASE, PHASE_CHANGE, IMPACTS_SUMMED = 0.0, 1.0, 2.0, 3.0, 4.0  # kinds of events
KIND_NAMES = ("impact", "chatter_end", "release", "phase", "impacts_summed")
KIND_CONTACTS = ("stop", "stop", "stop", "generator", "stop")

FREE_REGIME, IMPACT_REGIME, CHATTER_REGIME, STUCK_REGIME = 0, 1, 2, 3  # regime of a sample
REGIME_NAMES = ("free", "impact", "chatter", "stuck")
LISTED_MOST = 1000.0  # impacts of one series that are events of their own; later ones are summed in one event


class MassMotion(NamedTuple):
    """State of the mass at its last event.

    ``phase`` is 0 or 1; ``mode`` is flight, series (between impacts of one series in one phase) or stuck; the last
    three belong to a series: number of the last impact, speed and tau of its first.
    """

    period: float
    tau_s: float
    phase: float
    gap_m: float
    velocity_m_per_s: float
    mode: float
    series_number: float
    series_speed_m_per_s: float
    series_tau_s: float


class ImpactSystem(NamedTuple):
    """Constants of the motion: period T and duration t1 (s), both accelerations (m/s2), restitution; rule of series.

    ``listed`` is how many impacts of a completed series count one by one before its end.

    ``exact`` is 1 for the endless series (impacts below 1e-12 of the first are booked with its end) and 0 for the
    published cut-off.
    """

    period_s: float
    phase1_s: float
    acceleration1: float
    acceleration2: float
    restitution: float
    listed: float
    exact: float


class MotionEvent(NamedTuple):
    """One event: kind, time, velocities before and after (m/s), impulse per unit of mass (m/s), number of impacts.

    For ``impacts_summed`` the velocities are those before the first and after the last of its impacts.
    """

    kind: float
    period: float
    tau_s: float
    pre_m_per_s: float
    post_m_per_s: float
    impulse_per_mass: float
    impacts: float


def impact_system(
    times_s: tuple[float, float], accelerations: tuple[float, float], restitution: float, cutoff: float
) -> ImpactSystem:
    """Return the constants of the motion from (T, t1), (A1, A2), R and the relative cut-off speed (0: exact limit)."""
    listed = impacts_kept(cutoff if cutoff > 0.0 else LISTED_RATIO, restitution)
    return ImpactSystem(*times_s, *accelerations, restitution, listed, 0.0 if cutoff > 0.0 else 1.0)


@kernel
def mean_acceleration(system: ImpactSystem) -> float:
    """Return <A> = (A1 t1 + A2 (T - t1))/T, m/s2."""
    first, rest = system.phase1_s, system.period_s - system.phase1_s
    return (system.acceleration1 * first + system.acceleration2 * rest) / system.period_s


@kernel
def acceleration(motion: MassMotion, system: ImpactSystem) -> float:
    """Return the acceleration of the phase the motion is in, m/s2."""
    return system.acceleration1 if motion.phase == PHASE_1 else system.acceleration2


@kernel
def phase_end(motion: MassMotion, system: ImpactSystem) -> float:
    """Return tau at which the phase of the motion ends, s."""
    return system.phase1_s if motion.phase == PHASE_1 else system.period_s


@kernel
def anchored(
    period: float, tau_s: float, phase: float, gap_m: float, velocity: float, acceleration_now: float
) -> MassMotion:
    """Return the motion from this state on; at the stop without speed and with A >= 0 it is at rest."""
    mode = STUCK if gap_m == 0.0 and velocity == 0.0 and acceleration_now >= 0.0 else FLIGHT
    return MassMotion(period, tau_s, phase, gap_m, velocity, mode, 0.0, 0.0, 0.0)


@kernel
def initial_motion(gap_m: float, velocity: float, system: ImpactSystem) -> MassMotion:
    """Return the motion at the start of the first period."""
    return anchored(0.0, 0.0, PHASE_1, gap_m, velocity, system.acceleration1)


@kernel
def gap_after(motion: MassMotion, system: ImpactSystem, duration_s: float) -> tuple[float, float]:
    """Return gap (m) and velocity (m/s) at a time (s) after the last event, with no event in between."""
    if motion.mode == STUCK:
        return 0.0, 0.0
    a = acceleration(motion, system)
    gap = flown_gap(motion.gap_m, motion.velocity_m_per_s, a, duration_s)
    return gap, motion.velocity_m_per_s + a * duration_s


@kernel
def after_impact(
    motion: MassMotion, system: ImpactSystem, tau_s: float, speed: float
) -> tuple[MotionEvent, MassMotion]:
    """Return the impact and the motion after it; with the force towards the stop it starts or continues a series."""
    post = -system.restitution * speed
    number, first, first_tau = 1.0, speed, tau_s
    if motion.mode == SERIES:
        number, first, first_tau = motion.series_number + 1.0, motion.series_speed_m_per_s, motion.series_tau_s
    mode = SERIES if acceleration(motion, system) > 0.0 else FLIGHT
    event = MotionEvent(IMPACT, motion.period, tau_s, speed, post, speed - post, 1.0)
    return event, MassMotion(motion.period, tau_s, motion.phase, 0.0, post, mode, number, first, first_tau)


@kernel
def after_series(motion: MassMotion, system: ImpactSystem, tau_s: float) -> tuple[MotionEvent, MassMotion]:
    """Return the end of a series and the rest after it.

    The impulse closes the momentum balance.  Exact limit: the unlisted tail, sum (1 + R) v_i = R v_k (1 + R)/(1 - R)
    for all i > k.  Cut-off: the dropped impact stops the mass dead, R v_k.
    """
    r = system.restitution
    arriving = -motion.velocity_m_per_s
    rest = MassMotion(motion.period, tau_s, motion.phase, 0.0, 0.0, STUCK, 0.0, 0.0, 0.0)
    if system.exact == 1.0:
        impulse = arriving * (1.0 + r) / (1.0 - r)
        return MotionEvent(CHATTER_END, motion.period, tau_s, 0.0, 0.0, impulse, 0.0), rest
    return MotionEvent(CHATTER_END, motion.period, tau_s, arriving, 0.0, arriving, 0.0), rest


@kernel
def after_phase(motion: MassMotion, system: ImpactSystem) -> tuple[MotionEvent, MassMotion]:
    """Return the change of the force and the motion into the next phase."""
    end = phase_end(motion, system)
    gap, velocity = gap_after(motion, system, end - motion.tau_s)
    period, tau, phase, a = motion.period, end, PHASE_2, system.acceleration2
    if motion.phase == PHASE_2:
        period, tau, phase, a = motion.period + 1.0, 0.0, PHASE_1, system.acceleration1
    event = MotionEvent(PHASE_CHANGE, period, tau, velocity, velocity, 0.0, 0.0)
    if motion.mode == STUCK:
        return event, MassMotion(period, tau, phase, 0.0, 0.0, STUCK, 0.0, 0.0, 0.0)
    return event, anchored(period, tau, phase, gap, velocity, a)


@kernel
def after_summed_impacts(motion: MassMotion, system: ImpactSystem, last: float) -> tuple[MotionEvent, MassMotion]:
    """Return the impacts of a series up to number ``last`` as one event, and the motion after them."""
    a, r, first = acceleration(motion, system), system.restitution, motion.series_speed_m_per_s
    tau = motion.series_tau_s + series_delay(last, first, a, r)
    count = last - motion.series_number
    speed, post = -motion.velocity_m_per_s, -first * math.pow(r, last)
    impulse = (1.0 + r) * series_sum(count, speed, r)
    event = MotionEvent(IMPACTS_SUMMED, motion.period, tau, speed, post, impulse, count)
    return event, MassMotion(motion.period, tau, motion.phase, 0.0, post, SERIES, last, first, motion.series_tau_s)


@kernel
def last_impact_by(motion: MassMotion, system: ImpactSystem, until_s: float, completes: bool) -> float:
    """Return the number of the last impact of the present series at or before ``until_s``."""
    a, r, first = acceleration(motion, system), system.restitution, motion.series_speed_m_per_s
    last = impacts_within(until_s - motion.series_tau_s, first, a, r)
    most = system.listed if completes or system.exact == 0.0 else 2.0 * system.listed  # then too late to tell apart
    last = max(min(last, most), motion.series_number)
    low = motion.series_number
    while last > low:  # rounding may have put the last few behind the limit
        if motion.series_tau_s + series_delay(last, first, a, r) <= until_s:
            return last
        middle = math.floor(0.5 * (low + last))
        if motion.series_tau_s + series_delay(middle, first, a, r) <= until_s and middle > low:
            low = middle
        elif middle == low:
            return low
        else:
            last = middle
    return last


@kernel
def next_event(motion: MassMotion, system: ImpactSystem) -> tuple[MotionEvent, MassMotion]:
    """Return the next event and the motion right after it."""
    return next_event_until(motion, system, math.inf, LISTED_MOST)


@kernel
def next_event_until(
    motion: MassMotion, system: ImpactSystem, until_s: float, listed_most: float
) -> tuple[MotionEvent, MassMotion]:
    """Return the next event and the motion right after it.

    Impacts of a series after the first ``listed_most`` are summed up to ``until_s`` within the period.
    """
    a = acceleration(motion, system)
    end = phase_end(motion, system)
    if motion.mode == SERIES:
        first, r = motion.series_speed_m_per_s, system.restitution
        number = motion.series_number + 1.0
        tau = motion.series_tau_s + series_delay(number, first, a, r)
        limit = tau
        if system.exact == 1.0:
            limit = motion.series_tau_s + series_length(first, a, r)
            tau = min(tau, limit)  # rounding may put a late impact behind the end of its series
        if number > system.listed and limit <= end:
            return after_series(motion, system, limit)
        if number > listed_most:
            last = last_impact_by(motion, system, min(end, until_s), limit <= end)
            if last >= number:
                return after_summed_impacts(motion, system, last)
        if tau <= end:
            return after_impact(motion, system, tau, first * math.pow(r, number - 1.0))
    elif motion.mode == STUCK:
        if a < 0.0:
            event = MotionEvent(RELEASE, motion.period, motion.tau_s, 0.0, 0.0, 0.0, 0.0)
            return event, anchored(motion.period, motion.tau_s, motion.phase, 0.0, 0.0, a)
    else:
        flight = arrival(motion.gap_m, motion.velocity_m_per_s, a)
        if flight.reaches and motion.tau_s + flight.duration_s <= end:
            return after_impact(motion, system, motion.tau_s + flight.duration_s, flight.speed_m_per_s)
    return after_phase(motion, system)


@kernel
def tau_at(period: float, system: ImpactSystem, steps: float, step_s: float) -> float:
    """Return the time within a period at a coupling step counted from the origin, s; error-free products."""
    now, now_low = exact_product(steps, step_s)
    begun, begun_low = exact_product(period, system.period_s)
    return (now - begun) + (now_low - begun_low)


@kernel
def elapsed(motion: MassMotion, system: ImpactSystem, steps: float, step_s: float) -> float:
    """Return the time since the last event at a coupling step counted from the origin, s.

    steps * h - period * T - tau with error-free products: a sample long after the start is as exact as the first.
    """
    now, now_low = exact_product(steps, step_s)
    begun, begun_low = exact_product(motion.period, system.period_s)
    return max(((now - begun) - motion.tau_s) + (now_low - begun_low), 0.0)


@kernel
def rests_for_good(motion: MassMotion, system: ImpactSystem) -> bool:
    """Return whether the mass rests at the stop for ever: A1 >= 0 and A2 >= 0."""
    return motion.mode == STUCK and system.acceleration1 >= 0.0 and system.acceleration2 >= 0.0


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

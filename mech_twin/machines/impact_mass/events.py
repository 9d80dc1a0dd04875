"""The event walk of the impact mass: from one event to the next, in closed form, without a time step.

A motion is anchored at its last event: the number of the period, the time tau within it, gap and velocity there.
Time within the period is all the walk computes with, so nothing is lost at large times: the instant of an event is
period * T + tau, formed once.  Between events the motion is a parabola, or rest at the stop.

The events: *impact*; *chatter_end*, when an endless series (or, with a cut-off, its kept part) is over and the mass
rests; *phase*, when the force changes; *release*, when the force turns away from a resting mass, right after the
phase at the same instant.

Ties: an impact or a chatter end at exactly the instant of a change belongs to the phase that ends and comes before
the change.  A phase that starts at the stop with v > 0 (rounding put the blow behind the change) strikes at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.kernel import kernel
from mech_twin.machines.impact_mass.impact_stop import (
    LISTED_RATIO,
    arrival,
    exact_product,
    flown_gap,
    impacts_kept,
    series_delay,
    series_length,
)

KINDS = ("impact", "chatter_end", "release", "phase")
IMPACT, CHATTER_END, RELEASE, PHASE = 0.0, 1.0, 2.0, 3.0
FLIGHT, SERIES, STUCK = 0.0, 1.0, 2.0


class Motion(NamedTuple):
    """The mass at its last event: everything needed to go on.

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


class Drive(NamedTuple):
    """What acts on the mass: period, phase, both accelerations, restitution; how many impacts a series lists.

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


class Happening(NamedTuple):
    """One event: kind, where in time, velocities on either side, impulse per unit of mass (m/s)."""

    kind: float
    period: float
    tau_s: float
    pre_m_per_s: float
    post_m_per_s: float
    impulse_per_mass: float


def drive(times_s: tuple[float, float], accelerations: tuple[float, float], restitution: float, cutoff: float) -> Drive:
    """Return the drive of (T, t1), (A1, A2), R and the relative cut-off speed (0: exact limit)."""
    listed = impacts_kept(cutoff if cutoff > 0.0 else LISTED_RATIO, restitution)
    return Drive(*times_s, *accelerations, restitution, listed, 0.0 if cutoff > 0.0 else 1.0)


@kernel
def acceleration(motion: Motion, acting: Drive) -> float:
    """Return the acceleration of the phase the motion is in, m/s2."""
    return acting.acceleration1 if motion.phase == 0.0 else acting.acceleration2


@kernel
def phase_end(motion: Motion, acting: Drive) -> float:
    """Return tau at which the phase of the motion ends, s."""
    return acting.phase1_s if motion.phase == 0.0 else acting.period_s


@kernel
def placed(period: float, tau_s: float, phase: float, gap_m: float, velocity: float, acceleration_now: float) -> Motion:
    """Return a motion anchored here, at rest at the stop if it is there without speed and nothing pulls it away."""
    mode = STUCK if gap_m == 0.0 and velocity == 0.0 and acceleration_now >= 0.0 else FLIGHT
    return Motion(period, tau_s, phase, gap_m, velocity, mode, 0.0, 0.0, 0.0)


@kernel
def initial_motion(gap_m: float, velocity: float, acting: Drive) -> Motion:
    """Return the motion at the start of the first period."""
    return placed(0.0, 0.0, 0.0, gap_m, velocity, acting.acceleration1)


@kernel
def gap_after(motion: Motion, acting: Drive, duration_s: float) -> tuple[float, float]:
    """Return gap (m) and velocity (m/s) a time after the last event, no other event between."""
    if motion.mode == STUCK:
        return 0.0, 0.0
    a = acceleration(motion, acting)
    gap = flown_gap(motion.gap_m, motion.velocity_m_per_s, a, duration_s)
    return gap, motion.velocity_m_per_s + a * duration_s


@kernel
def after_impact(motion: Motion, acting: Drive, tau_s: float, speed: float) -> tuple[Happening, Motion]:
    """Return the blow and the motion after it; with the force towards the stop it opens or goes on with a series."""
    post = -acting.restitution * speed
    number, first, first_tau = 1.0, speed, tau_s
    if motion.mode == SERIES:
        number, first, first_tau = motion.series_number + 1.0, motion.series_speed_m_per_s, motion.series_tau_s
    mode = SERIES if acceleration(motion, acting) > 0.0 else FLIGHT
    event = Happening(IMPACT, motion.period, tau_s, speed, post, speed - post)
    return event, Motion(motion.period, tau_s, motion.phase, 0.0, post, mode, number, first, first_tau)


@kernel
def after_series(motion: Motion, acting: Drive, tau_s: float) -> tuple[Happening, Motion]:
    """Return the end of a series and the rest after it.

    The impulse closes the momentum book.  Exact limit: the unlisted tail, sum (1 + R) v_i = R v_k (1 + R)/(1 - R)
    for all i > k.  Cut-off: the dropped impact stops the mass dead, R v_k.
    """
    r = acting.restitution
    arriving = -motion.velocity_m_per_s
    rest = Motion(motion.period, tau_s, motion.phase, 0.0, 0.0, STUCK, 0.0, 0.0, 0.0)
    if acting.exact == 1.0:
        impulse = arriving * (1.0 + r) / (1.0 - r)
        return Happening(CHATTER_END, motion.period, tau_s, 0.0, 0.0, impulse), rest
    return Happening(CHATTER_END, motion.period, tau_s, arriving, 0.0, arriving), rest


@kernel
def after_phase(motion: Motion, acting: Drive) -> tuple[Happening, Motion]:
    """Return the change of the force and the motion into the next phase."""
    end = phase_end(motion, acting)
    gap, velocity = gap_after(motion, acting, end - motion.tau_s)
    period, tau, phase, a = motion.period, end, 1.0, acting.acceleration2
    if motion.phase == 1.0:
        period, tau, phase, a = motion.period + 1.0, 0.0, 0.0, acting.acceleration1
    event = Happening(PHASE, period, tau, velocity, velocity, 0.0)
    if motion.mode == STUCK:
        return event, Motion(period, tau, phase, 0.0, 0.0, STUCK, 0.0, 0.0, 0.0)
    return event, placed(period, tau, phase, gap, velocity, a)


@kernel
def next_event(motion: Motion, acting: Drive) -> tuple[Happening, Motion]:
    """Return the next event and the motion right after it."""
    a = acceleration(motion, acting)
    end = phase_end(motion, acting)
    if motion.mode == SERIES:
        first, r = motion.series_speed_m_per_s, acting.restitution
        number = motion.series_number + 1.0
        tau = motion.series_tau_s + series_delay(number, first, a, r)
        limit = tau
        if acting.exact == 1.0:
            limit = motion.series_tau_s + series_length(first, a, r)
            tau = min(tau, limit)  # rounding may put a late impact behind the end of its series
        if number > acting.listed and limit <= end:
            return after_series(motion, acting, limit)
        if tau <= end:
            return after_impact(motion, acting, tau, first * math.pow(r, number - 1.0))
    elif motion.mode == STUCK:
        if a < 0.0:
            event = Happening(RELEASE, motion.period, motion.tau_s, 0.0, 0.0, 0.0)
            return event, placed(motion.period, motion.tau_s, motion.phase, 0.0, 0.0, a)
    else:
        flight = arrival(motion.gap_m, motion.velocity_m_per_s, a)
        if flight.reaches and motion.tau_s + flight.duration_s <= end:
            return after_impact(motion, acting, motion.tau_s + flight.duration_s, flight.speed_m_per_s)
    return after_phase(motion, acting)


@kernel
def elapsed(motion: Motion, acting: Drive, steps: float, step_s: float) -> float:
    """Return the time since the last event at a coupling step counted from the origin, s.

    steps * h - period * T - tau with error-free products: a sample long after the start is as exact as the first.
    """
    now, now_low = exact_product(steps, step_s)
    begun, begun_low = exact_product(motion.period, acting.period_s)
    return max(((now - begun) - motion.tau_s) + (now_low - begun_low), 0.0)


@kernel
def rests_for_good(motion: Motion, acting: Drive) -> bool:
    """Return whether the mass rests at the stop and no phase will ever release it: A1 >= 0 and A2 >= 0."""
    return motion.mode == STUCK and acting.acceleration1 >= 0.0 and acting.acceleration2 >= 0.0

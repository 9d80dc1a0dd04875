# SPDX-License-Identifier: Apache-2.0
"""One coupling step of the impact mass: its events, the sample at its end, and its balance.

The state is always stored at the last event, so the motion does not depend on the coupling step: a shorter step only
samples it more often.

The balances are summed piece by piece between events, per unit of mass.  Momentum: impulse of the force less the
impulses of the stop.  Energy: work of the force less the losses at the stop. Both are compared with the change between
the velocities of the samples at both ends of the step.
"""

from typing import NamedTuple

from mech_twin.engine.compiled_steps import fill_event
from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.impact_mass.dynamics import (
    CHATTER_END,
    CHATTER_REGIME,
    FREE_REGIME,
    IMPACT,
    IMPACT_REGIME,
    IMPACTS_SUMMED,
    KIND_CONTACTS,
    LISTED_MOST,
    PHASE_CHANGE,
    SERIES,
    STUCK,
    STUCK_REGIME,
    ImpactSystem,
    MassMotion,
    MotionEvent,
    acceleration,
    anchored,
    elapsed,
    gap_after,
    next_event_until,
    phase_end,
    tau_at,
)

LEAST_MOMENTUM, LEAST_ENERGY = 1e-280, 1e-280  # m/s, m2/s2: below, doubles hold no digits to compare
CONTACTS = tuple(dict.fromkeys(KIND_CONTACTS))
CONTACT_OF_KIND = tuple(CONTACTS.index(contact) for contact in KIND_CONTACTS)


class StepBalance(NamedTuple):
    """Sums of a step per unit of mass: impulses in m/s, work and loss in m2/s2, and the sums of magnitudes."""

    drive_impulse_m_per_s: float
    drive_work_m2_per_s2: float
    stop_impulse_m_per_s: float
    stop_loss_m2_per_s2: float
    momentum_size_m_per_s: float
    energy_size_m2_per_s2: float


class BalanceResiduals(NamedTuple):
    """Errors of the balances of a step, relative to the sums of magnitudes."""

    momentum_balance: float
    energy_balance: float


@kernel
def empty_balance() -> StepBalance:
    """Return the balance at the start of a step."""
    return StepBalance(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def balance_after_piece(
    balance: StepBalance, a_m_per_s2: float, duration_s: float, begin_gap_m: float, end_gap_m: float
) -> StepBalance:
    """Return the balance after a piece of flight or rest under one acceleration."""
    impulse, work = a_m_per_s2 * duration_s, a_m_per_s2 * (begin_gap_m - end_gap_m)
    return StepBalance(
        balance.drive_impulse_m_per_s + impulse,
        balance.drive_work_m2_per_s2 + work,
        balance.stop_impulse_m_per_s,
        balance.stop_loss_m2_per_s2,
        balance.momentum_size_m_per_s + abs(impulse),
        balance.energy_size_m2_per_s2 + abs(a_m_per_s2) * (begin_gap_m + end_gap_m),
    )


@kernel
def balance_after_stop(balance: StepBalance, impulse_m_per_s: float, loss_m2_per_s2: float) -> StepBalance:
    """Return the balance after an impact at the stop or a rest against it."""
    return StepBalance(
        balance.drive_impulse_m_per_s,
        balance.drive_work_m2_per_s2,
        balance.stop_impulse_m_per_s + impulse_m_per_s,
        balance.stop_loss_m2_per_s2 + loss_m2_per_s2,
        balance.momentum_size_m_per_s + impulse_m_per_s,
        balance.energy_size_m2_per_s2 + loss_m2_per_s2,
    )


@kernel
def residuals(balance: StepBalance, begin_m_per_s: float, end_m_per_s: float) -> BalanceResiduals:
    """Return the relative errors of v_E - v_S = impulse - stop and of (v_E^2 - v_S^2)/2 = work - loss."""
    momentum = (end_m_per_s - begin_m_per_s) - (balance.drive_impulse_m_per_s - balance.stop_impulse_m_per_s)
    energy = 0.5 * (end_m_per_s - begin_m_per_s) * (end_m_per_s + begin_m_per_s) - (
        balance.drive_work_m2_per_s2 - balance.stop_loss_m2_per_s2
    )
    momentum_size = balance.momentum_size_m_per_s + abs(begin_m_per_s) + abs(end_m_per_s)
    moved = begin_m_per_s * begin_m_per_s + end_m_per_s * end_m_per_s
    energy_size = balance.energy_size_m2_per_s2 + 0.5 * moved
    return BalanceResiduals(
        momentum / momentum_size if momentum_size > LEAST_MOMENTUM else 0.0,
        energy / energy_size if energy_size > LEAST_ENERGY else 0.0,
    )


class RunningCounts(NamedTuple):
    """Running counts since the start; impulses of the stop per unit of mass (m/s)."""

    impacts: float
    chatter_ends: float
    period_impacts: float
    last_period_impacts: float
    period_impulse_m_per_s: float
    last_period_impulse_m_per_s: float
    step_impulse_m_per_s: float


@kernel
def rescaled(counts: RunningCounts, ratio: float) -> RunningCounts:
    """Return the counts with impulses per mass rescaled by old over new mass, so that impulses in N s are unchanged."""
    if ratio == 1.0:
        return counts
    return RunningCounts(
        counts.impacts,
        counts.chatter_ends,
        counts.period_impacts,
        counts.last_period_impacts,
        counts.period_impulse_m_per_s * ratio,
        counts.last_period_impulse_m_per_s * ratio,
        counts.step_impulse_m_per_s,
    )


class MassStep(NamedTuple):
    """The mass one coupling step later.

    Motion, counts, balance and its errors; gap (m) and velocity (m/s) at the end; regime; number of events.
    """

    motion: MassMotion
    counts: RunningCounts
    balance: StepBalance
    residuals: BalanceResiduals
    gap_m: float
    velocity_m_per_s: float
    regime: int
    found: int


class Span(NamedTuple):
    """A coupling step: origin of time (s), number of steps from there to its end, length (s); the mass (kg)."""

    origin_s: float
    steps: float
    step_s: float
    latest_s: float  # the end of the step, as samples tell it
    mass_kg: float


@kernel
def counts_after_event(counts: RunningCounts, event: MotionEvent, rest_impulse: float) -> RunningCounts:
    """Return the counts after an event; ``rest_impulse`` (m/s) is the stop's impulse on the mass resting before it."""
    impulse = counts.period_impulse_m_per_s + event.impulse_per_mass + rest_impulse
    hits = counts.period_impacts + event.impacts
    last_impulse, last_hits = counts.last_period_impulse_m_per_s, counts.last_period_impacts
    if event.kind == PHASE_CHANGE and event.tau_s == 0.0:
        last_impulse, last_hits, impulse, hits = impulse, hits, 0.0, 0.0
    ends = counts.chatter_ends + (1.0 if event.kind == CHATTER_END else 0.0)
    return RunningCounts(counts.impacts + event.impacts, ends, hits, last_hits, impulse, last_impulse, 0.0)


@kernel
def counts_after_step(counts: RunningCounts, rest_impulse: float, step_impulse: float) -> RunningCounts:
    """Return the counts at the end of a step, with the impulses of an ongoing rest and of the whole step (m/s)."""
    return RunningCounts(
        counts.impacts,
        counts.chatter_ends,
        counts.period_impacts,
        counts.last_period_impacts,
        counts.period_impulse_m_per_s + rest_impulse,
        counts.last_period_impulse_m_per_s,
        step_impulse,
    )


@kernel
def log_event(log: Array, count: int, event: MotionEvent, system: ImpactSystem, span: Span) -> None:
    """Write an event into row ``count``, its time not after the step's end."""
    time_s = min(span.origin_s + (event.period * system.period_s + event.tau_s), span.latest_s)
    kind, impulse_ns = int(event.kind), event.impulse_per_mass * span.mass_kg
    contact = CONTACT_OF_KIND[kind]
    fill_event(log, count, time_s, kind, contact, event.pre_m_per_s, event.post_m_per_s, impulse_ns, event.period)


@kernel
def regime_at(motion: MassMotion, coming: MotionEvent, struck: bool) -> int:
    """Return the regime of a sample: stuck, chatter (the series goes on in this phase), impact (in the step), free."""
    if motion.mode == STUCK:
        return STUCK_REGIME
    if motion.mode == SERIES and coming.kind != PHASE_CHANGE:
        return CHATTER_REGIME
    return IMPACT_REGIME if struck else FREE_REGIME


@kernel
def balance_after_event(
    balance: StepBalance,
    motion: MassMotion,
    system: ImpactSystem,
    event: MotionEvent,
    begin_gap: float,
    passed_s: float,
) -> tuple[StepBalance, float]:
    """Return the balance after the piece that ends with this event and its impact, and the impulse of a rest (m/s)."""
    a = acceleration(motion, system)
    until = phase_end(motion, system) if event.kind == PHASE_CHANGE else event.tau_s
    duration = max(until - motion.tau_s - passed_s, 0.0)
    end_gap = gap_after(motion, system, until - motion.tau_s)[0] if event.kind == PHASE_CHANGE else 0.0
    balance = balance_after_piece(balance, a, duration, begin_gap, end_gap)
    loss = 0.5 * (event.pre_m_per_s * event.pre_m_per_s - event.post_m_per_s * event.post_m_per_s)
    if event.kind == CHATTER_END:
        left = motion.velocity_m_per_s  # by the last listed impact, booked with the end
        loss = 0.5 * (left * left)
    rest = a * duration if motion.mode == STUCK else 0.0
    return balance_after_stop(balance, event.impulse_per_mass + rest, loss), rest


@kernel
def lies_in_step(
    coming: MotionEvent, motion: MassMotion, system: ImpactSystem, end_s: float, listed_most: float
) -> bool:
    """Return whether an event belongs to the step that ends at ``end_s``, s since the origin.

    Summed impacts end at the end of the step, so they do; the impact after them is known to be later.
    """
    if coming.kind == IMPACTS_SUMMED:
        return True
    if coming.kind == IMPACT and motion.mode == SERIES and motion.series_number >= listed_most:
        return False
    return coming.period * system.period_s + coming.tau_s <= end_s


@kernel
def mass_step(motion: MassMotion, system: ImpactSystem, counts: RunningCounts, span: Span, log: Array) -> MassStep:
    """Return the mass one coupling step later.

    Parameters
    ----------
    motion : MassMotion
        State at the last event (or the last change of a parameter).
    system : ImpactSystem
        Forces per unit of mass and restitution during the step.
    counts : RunningCounts
        Running counts.
    span : Span
        The step.
    log : ndarray
        Table of events; those beyond its end are counted.
    """
    steps, step_s, found, struck = span.steps, span.step_s, 0, False
    balance = empty_balance()
    passed = elapsed(motion, system, steps - 1.0, step_s)
    gap, first = gap_after(motion, system, passed)
    most = LISTED_MOST
    coming, after = next_event_until(motion, system, tau_at(motion.period, system, steps, step_s), most)
    while lies_in_step(coming, motion, system, steps * step_s, most):
        balance, rest = balance_after_event(balance, motion, system, coming, gap, passed)
        counts = counts_after_event(counts, coming, rest)
        struck = struck or coming.impacts > 0.0
        log_event(log, found, coming, system, span)
        found += 1
        motion, passed, gap = after, 0.0, after.gap_m
        most = LISTED_MOST if found < LISTED_MOST else 1.0  # a step full of events sums each series from its second on
        coming, after = next_event_until(motion, system, tau_at(motion.period, system, steps, step_s), most)
    now = elapsed(motion, system, steps, step_s)
    end_gap, end_velocity = gap_after(motion, system, now)
    a, duration = acceleration(motion, system), max(now - passed, 0.0)
    balance = balance_after_piece(balance, a, duration, gap, end_gap)
    rest = 0.0
    if motion.mode == STUCK:
        rest = a * duration
        balance = balance_after_stop(balance, rest, 0.0)
    counts = counts_after_step(counts, rest, balance.stop_impulse_m_per_s)
    regime = regime_at(motion, coming, struck)
    left = residuals(balance, first, end_velocity)
    return MassStep(motion, counts, balance, left, end_gap, end_velocity, regime, found)


@kernel
def reanchored(
    motion: MassMotion, before: ImpactSystem, after: ImpactSystem, steps: float, step_s: float
) -> MassMotion:
    """Return the motion restarted at a coupling step at which the constants of the motion change.

    A present series ends: under the new forces a flight follows, and its impacts form a new series.
    """
    tau = min(motion.tau_s + elapsed(motion, before, steps, step_s), phase_end(motion, before))
    gap, velocity = gap_after(motion, before, tau - motion.tau_s)
    if motion.mode == STUCK:
        return MassMotion(motion.period, tau, motion.phase, 0.0, 0.0, STUCK, 0.0, 0.0, 0.0)
    return anchored(motion.period, tau, motion.phase, gap, velocity, acceleration(motion, after))

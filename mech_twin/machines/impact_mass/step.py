# SPDX-License-Identifier: Apache-2.0
"""One coupling step of the impact mass: its events, the sample at its end, and its balance.

The state is always stored at the last event, so the motion does not depend on the coupling step: a shorter step only
samples it more often.

The balances are summed piece by piece between events, per unit of mass.  Momentum: impulse of the force less the
impulses of the stop.  Energy: work of the force less the losses at the stop. Both are compared with the change between
the velocities of the samples at both ends of the step.
"""

from typing import Any, NamedTuple

from mech_twin.engine.addresses import record_at, record_of
from mech_twin.engine.compiled_steps import LOG_FULL, Work, copy_numbers, fill_event, linkage_step, step_of, work_room
from mech_twin.engine.sample_vectors import COMMAND, LINKAGE_JOINTS, MOTOR_COMMAND, MOTOR_JOINTS, REGIME, Array
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.impact_mass.dynamics import (
    CHATTER_END,
    CHATTER_REGIME,
    FREE_REGIME,
    IMPACT,
    IMPACT_REGIME,
    IMPACTS_SUMMED,
    KIND_CONTACTS,
    LISTED_MOST,
    PHASE_1,
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


class MassMemory(NamedTuple):
    """State of the mass besides its joint: last event, running counts, constants of the motion, energies of the step.

    The first nine fields are `MassMotion`; phase and mode are named in `dynamics`, impulses are per unit of mass.
    """

    anchor_period_1: float
    anchor_tau_s: float
    phase_1: float
    anchor_gap_m: float
    anchor_velocity_m_per_s: float
    mode_1: float
    series_number_1: float
    series_speed_m_per_s: float
    series_tau_s: float
    impacts_1: float = 0.0
    chatter_ends_1: float = 0.0
    period_impacts_1: float = 0.0
    last_period_impacts_1: float = 0.0
    period_impulse_m_per_s: float = 0.0
    last_period_impulse_m_per_s: float = 0.0
    step_impulse_m_per_s: float = 0.0
    phase1_acceleration_m_per_s2: float = 0.0
    phase2_acceleration_m_per_s2: float = 0.0
    restitution_1: float = 0.0
    origin_step_1: float = 0.0
    mass_kg: float = 0.0
    step_drive_work_j: float = 0.0
    step_stop_loss_j: float = 0.0
    step_change_work_j: float = 0.0
    step_change_momentum_ns: float = 0.0


MEMORY = record_of(MassMemory._fields)
MEMORY_AT = LINKAGE_JOINTS + 3
RESIDUALS_AT = MEMORY_AT + len(MassMemory._fields)


@borrowing_kernel
def memory_of(row: Array) -> Any:
    """Return the memory of a linkage row as a record that shares its numbers."""
    return record_at(row, MEMORY_AT, MEMORY)


@kernel
def motion_of(row: Array) -> MassMotion:
    """Return the motion from its last event on: the first numbers of the memory."""
    m = row[MEMORY_AT:]
    return MassMotion(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8])


class StoppedMass(NamedTuple):
    """Constants of the linkage role; ``system`` under no force."""

    system: ImpactSystem
    mass_kg: float
    stop_m: float
    step_s: float


class StepBalance(NamedTuple):
    """Sums of a step per unit of mass: impulses in m/s, work and loss in m2/s2, and the sums of magnitudes."""

    drive_impulse_m_per_s: float
    drive_work_m2_per_s2: float
    stop_impulse_m_per_s: float
    stop_loss_m2_per_s2: float
    momentum_size_m_per_s: float
    energy_size_m2_per_s2: float


BALANCE, SUMS = record_of(StepBalance._fields), len(StepBalance._fields)


class BalanceResiduals(NamedTuple):
    """Errors of the balances of a step, relative to the sums of magnitudes."""

    momentum_balance: float
    energy_balance: float


@borrowing_kernel
def add_piece(balance: Any, a_m_per_s2: float, duration_s: float, begin_gap_m: float, end_gap_m: float) -> None:
    """Add a piece of flight or rest under one acceleration to the balance."""
    impulse = a_m_per_s2 * duration_s
    balance.drive_impulse_m_per_s += impulse
    balance.drive_work_m2_per_s2 += a_m_per_s2 * (begin_gap_m - end_gap_m)
    balance.momentum_size_m_per_s += abs(impulse)
    balance.energy_size_m2_per_s2 += abs(a_m_per_s2) * (begin_gap_m + end_gap_m)


@borrowing_kernel
def add_stop(balance: Any, impulse_m_per_s: float, loss_m2_per_s2: float) -> None:
    """Add an impact at the stop or a rest against it to the balance."""
    balance.stop_impulse_m_per_s += impulse_m_per_s
    balance.stop_loss_m2_per_s2 += loss_m2_per_s2
    balance.momentum_size_m_per_s += impulse_m_per_s
    balance.energy_size_m2_per_s2 += loss_m2_per_s2


@borrowing_kernel
def residuals(balance: Any, begin_m_per_s: float, end_m_per_s: float) -> BalanceResiduals:
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


@borrowing_kernel
def count_event(memory: Any, event: MotionEvent, rest_impulse: float) -> None:
    """Count an event; ``rest_impulse`` (m/s) is the stop's impulse on the mass resting before it."""
    memory.impacts_1 += event.impacts
    memory.period_impacts_1 += event.impacts
    memory.period_impulse_m_per_s = memory.period_impulse_m_per_s + event.impulse_per_mass + rest_impulse
    if event.kind == PHASE_CHANGE and event.tau_s == 0.0:
        memory.last_period_impulse_m_per_s, memory.period_impulse_m_per_s = memory.period_impulse_m_per_s, 0.0
        memory.last_period_impacts_1, memory.period_impacts_1 = memory.period_impacts_1, 0.0
    if event.kind == CHATTER_END:
        memory.chatter_ends_1 += 1.0


@kernel
def regime_at(motion: MassMotion, coming: MotionEvent, struck: bool) -> int:
    """Return the regime of a sample: stuck, chatter (the series goes on in this phase), impact (in the step), free."""
    if motion.mode == STUCK:
        return STUCK_REGIME
    if motion.mode == SERIES and coming.kind != PHASE_CHANGE:
        return CHATTER_REGIME
    return IMPACT_REGIME if struck else FREE_REGIME


@borrowing_kernel
def balance_event(
    balance: Any, motion: MassMotion, system: ImpactSystem, event: MotionEvent, begin_gap: float, passed_s: float
) -> float:
    """Add the piece that ends with this event, and its impact, to the balance; return the impulse of a rest (m/s)."""
    a = acceleration(motion, system)
    until = phase_end(motion, system) if event.kind == PHASE_CHANGE else event.tau_s
    duration = max(until - motion.tau_s - passed_s, 0.0)
    end_gap = gap_after(motion, system, until - motion.tau_s)[0] if event.kind == PHASE_CHANGE else 0.0
    add_piece(balance, a, duration, begin_gap, end_gap)
    loss = 0.5 * (event.pre_m_per_s * event.pre_m_per_s - event.post_m_per_s * event.post_m_per_s)
    if event.kind == CHATTER_END:
        left = motion.velocity_m_per_s  # by the last listed impact, booked with the end
        loss = 0.5 * (left * left)
    rest = a * duration if motion.mode == STUCK else 0.0
    add_stop(balance, event.impulse_per_mass + rest, loss)
    return rest


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


@kernel
def acting(model: StoppedMass, first_m_per_s2: float, second_m_per_s2: float, restitution: float) -> ImpactSystem:
    """Return the constants of the motion under these accelerations of both phases."""
    s = model.system
    return ImpactSystem(s.period_s, s.phase1_s, first_m_per_s2, second_m_per_s2, restitution, s.listed, s.exact)


@borrowing_kernel
def acted_before(model: StoppedMass, memory: Any) -> ImpactSystem:
    """Return the constants of the motion in the step before."""
    return acting(model, memory.phase1_acceleration_m_per_s2, memory.phase2_acceleration_m_per_s2, memory.restitution_1)


@borrowing_kernel
def anchor_at(model: StoppedMass, linkage: Array, step: int) -> None:
    """Rewrite the motion in a linkage row as starting at this step instead of at its last event; it stays the same."""
    memory = memory_of(linkage)
    before, steps = acted_before(model, memory), step - memory.origin_step_1
    copy_numbers(reanchored(motion_of(linkage), before, before, steps, model.step_s), linkage[MEMORY_AT:])


@step_of(work_room, StoppedMass, borrowing_kernel)
def room_of_step(model: StoppedMass) -> tuple[int, int]:
    """Return the lengths of the work arrays of `mass_on_stop`."""
    return SUMS, 0


@step_of(linkage_step, StoppedMass, borrowing_kernel)
def mass_on_stop(
    model: StoppedMass, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the mass one coupling step later, and log every event in between at its own time.

    Impulses per mass are scaled by old over new mass, so that a live change of the mass leaves them in N s.
    """
    copy_numbers(linkage, out)
    memory, balance, step_s, mass_kg = memory_of(out), record_at(work.numbers, 0, BALANCE), model.step_s, model.mass_kg
    levels = motor[MOTOR_JOINTS + 5], motor[MOTOR_JOINTS + 8]
    system = acting(model, levels[0] / mass_kg, levels[1] / mass_kg, model.system.restitution)
    steps, before, motion = step - memory.origin_step_1, acted_before(model, memory), motion_of(linkage)
    if before != system:
        motion = reanchored(motion, before, system, steps, step_s)
    memory.period_impulse_m_per_s *= memory.mass_kg / mass_kg
    memory.last_period_impulse_m_per_s *= memory.mass_kg / mass_kg
    end, most, found, struck = steps + 1.0, LISTED_MOST, 0, False
    passed = elapsed(motion, system, steps, step_s)
    gap, begin_m_per_s = gap_after(motion, system, passed)
    coming, after = next_event_until(motion, system, tau_at(motion.period, system, end, step_s), most)
    while lies_in_step(coming, motion, system, end * step_s, most):
        count_event(memory, coming, balance_event(balance, motion, system, coming, gap, passed))
        struck = struck or coming.impacts > 0.0
        kind, time_s = int(coming.kind), coming.period * system.period_s + coming.tau_s
        fill_event(
            log,
            found,
            min(memory.origin_step_1 * step_s + time_s, (step + 1) * step_s),
            kind,
            CONTACT_OF_KIND[kind],
            coming.pre_m_per_s,
            coming.post_m_per_s,
            coming.impulse_per_mass * mass_kg,
            coming.period,
        )
        found += 1
        motion, passed, gap = after, 0.0, after.gap_m
        most = LISTED_MOST if found < LISTED_MOST else 1.0  # a step full of events sums each series from its second on
        coming, after = next_event_until(motion, system, tau_at(motion.period, system, end, step_s), most)
    now = elapsed(motion, system, end, step_s)
    end_gap, end_m_per_s = gap_after(motion, system, now)
    a, duration = acceleration(motion, system), max(now - passed, 0.0)
    add_piece(balance, a, duration, gap, end_gap)
    if motion.mode == STUCK:
        add_stop(balance, a * duration, 0.0)
        memory.period_impulse_m_per_s += a * duration
    memory.step_impulse_m_per_s = balance.stop_impulse_m_per_s
    copy_numbers(motion, out[MEMORY_AT:])
    memory.phase1_acceleration_m_per_s2, memory.phase2_acceleration_m_per_s2 = (
        system.acceleration1,
        system.acceleration2,
    )
    velocity, added_kg = linkage[LINKAGE_JOINTS + 1], mass_kg - memory.mass_kg
    memory.restitution_1, memory.mass_kg = system.restitution, mass_kg
    memory.step_drive_work_j = balance.drive_work_m2_per_s2 * mass_kg
    memory.step_stop_loss_j = balance.stop_loss_m2_per_s2 * mass_kg
    memory.step_change_work_j = 0.5 * added_kg * (velocity * velocity)
    memory.step_change_momentum_ns = added_kg * velocity if added_kg != 0.0 else 0.0
    out[REGIME], out[COMMAND] = regime_at(motion, coming, struck), motor[MOTOR_COMMAND]
    out[LINKAGE_JOINTS], out[LINKAGE_JOINTS + 1] = model.stop_m - end_gap, end_m_per_s
    out[LINKAGE_JOINTS + 2] = levels[0] if motion.phase == PHASE_1 else levels[1]
    left = residuals(balance, begin_m_per_s, end_m_per_s)
    out[RESIDUALS_AT], out[RESIDUALS_AT + 1] = left.momentum_balance, left.energy_balance
    return found if found <= len(log) else LOG_FULL

# SPDX-License-Identifier: Apache-2.0
"""The roller former as rows of numbers: a coupling step of its linkage, as a kernel.

Its numbers have names: joints of the shaft, and the memory with modes, works, and their energy balance.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.addresses import record_at, record_of
from mech_twin.engine.compiled_steps import LOG_FULL, Work, linkage_step, step_of, work_room
from mech_twin.engine.hybrid.loop import MOST_STEPS, UNSTEADY
from mech_twin.engine.sample_vectors import MOTOR_COMMAND, MOTOR_JOINTS, Array
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.roller_former.cart_statics import cart_load, cart_motion, load_moment, rod_weight_moment
from mech_twin.machines.roller_former.dynamics import (
    STATE_SIZE,
    Former,
    FormerState,
    Modes,
    coupling_moment,
    fill_state,
    geared,
    holds_at_rest,
    modes_of,
    shaft_torque,
    state_of,
    stored_energy,
)
from mech_twin.machines.roller_former.motion import NO_STEP, TIGHT, advance_in, former_room
from mech_twin.parts.induction_motor import motor_in_step

TURN = 2.0 * np.pi
RUNNING, HELD, STALLED = 0, 1, 2
RUNAWAY = 1e4  # times synchronous speed: far beyond what a motor's curve tells of, and its energy leaves no digits
FAILURES = (
    f"roller_former: {NO_STEP}: {TIGHT}",
    f"roller_former: more than {MOST_STEPS} integration steps: drive or carts are too stiff for coupling.step_s",
    f"roller_former: the carts drive crank or motor to more than {RUNAWAY:g} times motor.synchronous_speed_rpm: "
    "load reversing and resist hold a shaft, rectified drives one that turns backward",
)


class ShaftMotion(NamedTuple):
    """First numbers of the row: regime, command of the motor; angle, rate, effort of drive, crank and twist.

    Position, velocity and effort of cart and rod of each crank follow.
    """

    regime: float
    command: float
    drive_rad: float
    drive_rad_per_s: float
    drive_nm: float
    crank_rad: float
    crank_rad_per_s: float
    crank_nm: float
    twist_rad: float
    twist_rad_per_s: float
    twist_nm: float


class FormerMemory(NamedTuple):
    """State besides the joints; the first are `Modes`.

    Works are those since the start; ``stored_energy_j`` is the energy at the sample; ``change_work_j`` is the energy
    added by live changes of parameters.  The balance error and the turnover (sum of the magnitudes of all works) are
    reset with every turn of the crank, so that a long run or a large sum hides no error.
    """

    direction_1: float
    drive_direction_1: float
    load_on_1: float
    load_share_1: float
    slow_s: float
    stalled_1: float
    motor_work_j: float
    damping_work_j: float
    load_work_j: float
    friction_work_j: float
    change_work_j: float
    stored_energy_j: float
    turn_balance_error_j: float
    turn_turnover_j: float


class FormerResiduals(NamedTuple):
    """Residuals, zero but for rounding: energy balance, and length of the rods."""

    energy_balance: float
    rod_length: float


SHAFT = record_of(ShaftMotion)
MEMORY = np.dtype((np.record, [(name, np.float64) for name in (*FormerMemory._fields, *FormerResiduals._fields)]))
CARTS_AT, MODES_SIZE = len(ShaftMotion._fields), len(Modes._fields)


@borrowing_kernel
def shaft_of(row: Array) -> Any:
    """Return the first numbers of a linkage row as a record that shares them."""
    return record_at(row, 0, SHAFT)


@borrowing_kernel
def memory_of(row: Array, carts: int) -> Any:
    """Return memory and residuals in a linkage row of so many carts as a record that shares their numbers."""
    return record_at(row, CARTS_AT + 6 * carts, MEMORY)


class CoupledFormer(NamedTuple):
    """Constants of the linkage role."""

    former: Former
    step_s: float


@borrowing_kernel
def load_in_force(former: Former, now: FormerState, modes: Any) -> tuple[float, float]:
    """Return direction and share of the load that acts; at rest the share that balances the other moments."""
    if modes.direction_1 != 0.0:
        return modes.direction_1, modes.load_share_1
    rest = coupling_moment(former, now) - rod_weight_moment(former.bank, now.crank_rad)
    rest -= min(max(rest, -former.coulomb_nm), former.coulomb_nm)  # friction of the shaft carries first
    direction = 1.0 if rest >= 0.0 else -1.0
    if not holds_at_rest(former.bank):
        return direction, modes.load_share_1
    limit = load_moment(former.bank, now.crank_rad, direction)
    return direction, min(rest / limit, modes.load_share_1) if limit != 0.0 else 0.0


@borrowing_kernel
def fill_carts(former: Former, y: Array, modes: Any, out: Array) -> float:
    """Fill position, velocity and effort of carts and rods; return the largest relative error of a rod's length.

    The effort of a cart is the force of process and guide friction along x (N).
    """
    bank, now, at = former.bank, state_of(y), CARTS_AT
    direction, share = load_in_force(former, now, modes)
    worst = 0.0
    for cart in range(bank.offset_rad.size):
        psi = now.crank_rad + bank.offset_rad[cart]
        sine, cosine = math.sin(psi), math.cos(psi)
        motion = cart_motion(bank, sine, cosine)
        load = cart_load(bank, cart, now.crank_rad, direction)
        arm = bank.crank_m * sine * (motion.rod_cosine + bank.ratio * cosine)
        pull = load.rod_force_n if load.moment_nm * arm * load.rod_force_n >= 0.0 else -load.rod_force_n
        out[at], out[at + 1] = motion.x, motion.x1 * now.crank_speed_rad_per_s
        out[at + 2] = pull * motion.rod_cosine * share
        out[at + 3], out[at + 5] = math.asin(motion.rod_sine), 0.0
        out[at + 4] = bank.ratio * cosine / motion.rod_cosine * now.crank_speed_rad_per_s
        length = math.hypot(motion.x - bank.crank_m * cosine, bank.crank_m * sine)
        worst = max(worst, abs(length / bank.rod_m - 1.0))
        at += 6
    return worst


@borrowing_kernel
def book_step(past: Any, y: Array, begun_j: float, stored_j: float, after: Any) -> None:
    """Fill the memory after a step, but for its modes: works, and the energy balance of the step.

    Parameters
    ----------
    past, after : record
        Memory before and after, of two rows.
    begun_j, stored_j : float
        Energy (J) at start and end with the parameters of the step.  The difference of the start from the end of the
        step before is the work of a change of parameters.
    """
    works = state_of(y)
    put_in, loss = works.motor_work_j, works.damping_work_j + works.load_work_j + works.friction_work_j
    changed = begun_j - past.stored_energy_j
    error = stored_j - past.stored_energy_j - put_in + loss - changed
    losses = abs(works.damping_work_j) + abs(works.load_work_j) + abs(works.friction_work_j)
    turnover = abs(put_in) + losses + abs(changed)
    after.motor_work_j = past.motor_work_j + put_in
    after.damping_work_j = past.damping_work_j + works.damping_work_j
    after.load_work_j = past.load_work_j + works.load_work_j
    after.friction_work_j = past.friction_work_j + works.friction_work_j
    after.change_work_j, after.stored_energy_j = past.change_work_j + changed, stored_j
    after.turn_balance_error_j, after.turn_turnover_j = error, turnover


@borrowing_kernel
def fill_row(former: Former, y: Array, shaft_nm: float, command: float, out: Array) -> None:
    """Fill a linkage row whose memory is in place; ``shaft_nm`` is the motor's torque at its step (N m)."""
    now, shaft, memory = state_of(y), shaft_of(out), memory_of(out, former.bank.offset_rad.size)
    transmitted, drive = coupling_moment(former, now), memory.drive_direction_1
    shaft.drive_nm = transmitted if drive == 0.0 else geared(former, shaft_nm, drive)
    shaft.regime = STALLED if memory.stalled_1 > 0.0 else HELD if memory.direction_1 == 0.0 else RUNNING
    shaft.command = command
    shaft.drive_rad = now.crank_rad + now.twist_rad
    shaft.drive_rad_per_s = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    shaft.crank_rad, shaft.crank_rad_per_s, shaft.crank_nm = now.crank_rad, now.crank_speed_rad_per_s, transmitted
    shaft.twist_rad, shaft.twist_rad_per_s = now.twist_rad, now.twist_rate_rad_per_s
    shaft.twist_nm = former.stiffness_nm_per_rad * now.twist_rad
    memory.energy_balance = memory.turn_balance_error_j / (former.scales.motor_work_j + memory.turn_turnover_j)
    memory.rod_length = fill_carts(former, y, memory, out)


@kernel
def start_row(former: Former, y: Array, modes: Array, command: float, out: Array) -> None:
    """Fill the row of the machine in its initial state."""
    at = CARTS_AT + 6 * former.bank.offset_rad.size
    out[:], out[at : at + len(modes)] = 0.0, modes
    memory = memory_of(out, former.bank.offset_rad.size)
    memory.stored_energy_j = stored_energy(former, state_of(y), np.ones(former.bank.offset_rad.size))
    fill_row(former, y, 0.0, command, out)


@step_of(work_room, CoupledFormer, borrowing_kernel)
def room_of_step(model: CoupledFormer) -> tuple[int, int]:
    """Return the lengths of the work arrays of `former_step`."""
    carts = model.former.bank.offset_rad.size
    size, places = former_room(carts)
    return STATE_SIZE + carts + size, places


@step_of(linkage_step, CoupledFormer, borrowing_kernel)
def former_step(
    model: CoupledFormer, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the linkage one coupling step later."""
    former, carts, begin_s = model.former, model.former.bank.offset_rad.size, step * model.step_s
    past, before, y = memory_of(linkage, carts), shaft_of(linkage), work.numbers[:STATE_SIZE]
    sides = work.numbers[STATE_SIZE : STATE_SIZE + carts]
    if max(abs(before.drive_rad_per_s), abs(before.crank_rad_per_s)) > RUNAWAY * former.scales.crank_speed_rad_per_s:
        return -3
    crank_rad = before.crank_rad
    fill_state(
        y,
        FormerState(crank_rad, before.twist_rad, before.crank_rad_per_s, before.twist_rad_per_s, 0.0, 0.0, 0.0, 0.0),
    )
    command = motor[MOTOR_COMMAND]
    rotor = before.drive_rad_per_s * former.ratio
    torque = motor_in_step(former.motor, before.command, rotor, motor[MOTOR_JOINTS + 2], command, model.step_s)
    for cart in range(carts):
        sides[cart] = 1.0
    begun = stored_energy(former, state_of(y), sides)
    times, at = (begin_s, (step + 1) * model.step_s), CARTS_AT + 6 * carts
    numbers = work.numbers[STATE_SIZE + carts :]
    for i in range(MODES_SIZE):
        out[at + i] = linkage[at + i]
    done = advance_in(former, torque, times, np.inf, y, modes_of(out, at), log, numbers, work.marks)
    if done.status < 0:
        return done.status if done.status == LOG_FULL else -1 if done.status == UNSTEADY else -2
    stored = stored_energy(former, state_of(y), sides)
    after = memory_of(out, carts)
    book_step(past, y, begun, stored, after)
    if math.floor(state_of(y).crank_rad / TURN) == math.floor(crank_rad / TURN):
        after.turn_balance_error_j = after.turn_balance_error_j + past.turn_balance_error_j
        after.turn_turnover_j = after.turn_turnover_j + past.turn_turnover_j
    now = state_of(y)
    shaft_nm = shaft_torque(former, torque, model.step_s, now.crank_speed_rad_per_s + now.twist_rate_rad_per_s)
    fill_row(former, y, shaft_nm, command, out)
    return done.status

# SPDX-License-Identifier: Apache-2.0
"""The roller former as rows of numbers: a coupling step of its linkage and its force analysis, as kernels and as roles.

The linkage has inertias, elastic drive and all carts.  The forces of rods, guides, coupling and frame follow from
angles, rates and efforts of the joints.

The mass of a rod is halved to its ends (the page's model), so pin forces are those on crank and cart with their
half of the rod.  Guide friction in the drive's equation is that of the static load; what the inertia of a cart adds to
the guide reactions is shown in them and its friction neglected, as in (40).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.addresses import record_at, record_of
from mech_twin.engine.compiled_roles import CompiledLinkage
from mech_twin.engine.compiled_steps import LOG_FULL, Work, copy_numbers, force_step, linkage_step, step_of, work_room
from mech_twin.engine.hybrid.loop import MOST_STEPS, UNSTEADY
from mech_twin.engine.sample_vectors import (
    BODY_MOMENT,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    PINS,
    Array,
    EventLayout,
    ForceLayout,
    LinkageLayout,
)
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.roller_former.cart_parameters import REVERSING, CartBank
from mech_twin.machines.roller_former.cart_statics import (
    cart_load,
    cart_motion,
    guide_reactions,
    load_moment,
    rod_force,
    rod_weight_moment,
)
from mech_twin.machines.roller_former.dynamics import (
    STATE_SIZE,
    Former,
    FormerState,
    at_motor,
    coupling_moment,
    geared,
    holds_at_rest,
    modes_of,
    shaft_torque,
    start_modes,
    state_array,
    state_of,
    stored_energy,
)
from mech_twin.machines.roller_former.motion import EVENT_KINDS, NO_STEP, TIGHT, advance_in, former_room
from mech_twin.parts.induction_motor import motor_in_step
from mech_twin.samples import LinkageSample

TURN = 2.0 * np.pi
REGIMES = ("running", "held", "stalled")
RUNNING, HELD, STALLED = range(len(REGIMES))
MOST_MISSED = 0.2  # by the expansion's transfer function, of r (r/l)^3
RUNAWAY = 1e4  # times synchronous speed: far beyond what a motor's curve tells of, and its energy leaves no digits
FAILURES = (
    f"roller_former: {NO_STEP}: {TIGHT}",
    f"roller_former: more than {MOST_STEPS} integration steps: drive or carts are too stiff for coupling.step_s",
    f"roller_former: the carts drive crank or motor to more than {RUNAWAY:g} times motor.synchronous_speed_rpm: "
    "load reversing and resist hold a shaft, rectified drives one that turns backward",
)


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


# first numbers of the row; position, velocity and effort of cart and rod of each crank follow
MOTION = (
    "regime", "command", "drive_rad", "drive_rad_per_s", "drive_nm", "crank_rad", "crank_rad_per_s", "crank_nm",
    "twist_rad", "twist_rad_per_s", "twist_nm",
)  # fmt: skip
RESIDUALS = ("energy_balance", "rod_length")  # zero but for rounding
SHAFT = record_of(MOTION)
MEMORY = record_of((*FormerMemory._fields, *RESIDUALS))
CARTS_AT = len(MOTION)
PULLS_AT = CARTS_AT + 2  # along x, of one cart after the other


@borrowing_kernel
def shaft_of(row: Array) -> Any:
    """Return the first numbers of a linkage row as a record that shares them."""
    return record_at(row, 0, SHAFT)


@borrowing_kernel
def memory_of(row: Array, carts: int) -> Any:
    """Return memory and residuals in a linkage row of so many carts as a record that shares their numbers."""
    return record_at(row, CARTS_AT + 6 * carts, MEMORY)


class CoupledFormer(NamedTuple):
    """Constants of linkage and force analysis."""

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
def book_step(memory: Any, y: Array, begun_j: float, stored_j: float, same_turn: bool) -> None:
    """Add a step to the memory: its works, and its part in the energy balance of the turn.

    ``begun_j`` and ``stored_j`` are the energies (J) at start and end with the parameters of the step.  The difference
    of the start from the end of the step before is the work of a change of parameters.
    """
    works = state_of(y)
    put_in, loss = works.motor_work_j, works.damping_work_j + works.load_work_j + works.friction_work_j
    changed = begun_j - memory.stored_energy_j
    error = stored_j - memory.stored_energy_j - put_in + loss - changed
    losses = abs(works.damping_work_j) + abs(works.load_work_j) + abs(works.friction_work_j)
    turnover = abs(put_in) + losses + abs(changed)
    memory.motor_work_j = memory.motor_work_j + put_in
    memory.damping_work_j = memory.damping_work_j + works.damping_work_j
    memory.load_work_j = memory.load_work_j + works.load_work_j
    memory.friction_work_j = memory.friction_work_j + works.friction_work_j
    memory.change_work_j, memory.stored_energy_j = memory.change_work_j + changed, stored_j
    memory.turn_balance_error_j = error + memory.turn_balance_error_j if same_turn else error
    memory.turn_turnover_j = turnover + memory.turn_turnover_j if same_turn else turnover


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
    former, carts, h = model.former, model.former.bank.offset_rad.size, model.step_s
    copy_numbers(linkage, out)
    memory, now, y = memory_of(out, carts), shaft_of(out), work.numbers[:STATE_SIZE]
    sides, numbers = work.numbers[STATE_SIZE : STATE_SIZE + carts], work.numbers[STATE_SIZE + carts :]
    if max(abs(now.drive_rad_per_s), abs(now.crank_rad_per_s)) > RUNAWAY * former.scales.crank_speed_rad_per_s:
        return -3
    y[:], sides[:] = 0.0, 1.0
    y[0], y[1], y[2], y[3] = now.crank_rad, now.twist_rad, now.crank_rad_per_s, now.twist_rad_per_s
    command, rotor = motor[MOTOR_COMMAND], now.drive_rad_per_s * former.ratio
    torque = motor_in_step(former.motor, now.command, rotor, motor[MOTOR_JOINTS + 2], command, h)
    begun, modes = stored_energy(former, state_of(y), sides), modes_of(out, CARTS_AT + 6 * carts)
    done = advance_in(former, torque, (step * h, (step + 1) * h), np.inf, y, modes, log, numbers, work.marks)
    if done.status < 0:
        return done.status if done.status == LOG_FULL else -1 if done.status == UNSTEADY else -2
    at = state_of(y)
    same_turn = math.floor(at.crank_rad / TURN) == math.floor(now.crank_rad / TURN)
    book_step(memory, y, begun, stored_energy(former, at, sides), same_turn)
    shaft_nm = shaft_torque(former, torque, h, at.crank_speed_rad_per_s + at.twist_rate_rad_per_s)
    fill_row(former, y, shaft_nm, command, out)
    return done.status


class FormerQuantities(NamedTuple):
    """Moments, inertia, accelerations, shaking force and powers that follow from the joints."""

    motor_moment_nm: float
    coupling_moment_nm: float
    elastic_moment_nm: float
    coupling_moment_at_motor_nm: float
    load_moment_nm: float
    friction_moment_nm: float
    rod_weight_moment_nm: float
    inertia_moment_nm: float
    reduced_inertia_kg_m2: float
    crank_acceleration_rad_per_s2: float
    twist_acceleration_rad_per_s2: float
    shaking_force_x_n: float
    shaking_force_y_n: float
    drive_power_w: float
    load_power_w: float


QUANTITIES = len(FormerQuantities._fields)


def loaded_bodies(count: int) -> tuple[str, ...]:
    """Return on which body each pin's force acts."""
    return ("shaft", *(body for i in range(1, count + 1) for body in (f"crank_{i}", *(f"cart_{i}",) * 3)))


@borrowing_kernel
def load_sums(former: Former, crank: float, linkage: Array) -> tuple[float, float, float]:
    """Return J_p2, half its derivative, and the load moment of the forces on the carts (N, along x)."""
    bank = former.bank
    inertia, slope, load = bank.crank_inertia_kg_m2, 0.0, 0.0
    for cart in range(bank.offset_rad.size):
        sine, cosine = math.sin(crank + bank.offset_rad[cart]), math.cos(crank + bank.offset_rad[cart])
        motion = cart_motion(bank, sine, cosine)
        inertia += bank.mass_kg[cart] * motion.x1 * motion.x1
        slope += bank.mass_kg[cart] * motion.x1 * motion.x2
        pull = linkage[PULLS_AT + 6 * cart]
        load += pull / motion.rod_cosine * bank.crank_m * sine * (motion.rod_cosine + bank.ratio * cosine)
    return inertia, slope, load


@borrowing_kernel
def fill_cart_forces(
    former: Former, crank: float, speed: float, acceleration: float, linkage: Array, out: Array
) -> tuple[float, float, float, float]:
    """Fill the forces on shaft and pins, and the rod force of each cart, in the row of the forces.

    The weight of a rod's half at the crank pin is part of the force on that pin.  Returns the moment of the crank-pin
    forces about the shaft; the sum of the magnitudes of the carts' inertia forces times the crank radius, the scale of
    the errors of the series expansion (N m); and the shaking force (N).
    """
    bank, at, rods = former.bank, PINS + 3, PINS + 3 + 12 * former.bank.offset_rad.size + QUANTITIES
    moment, inertia_nm, shaft_x, shaft_y, shake_x, shake_y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for cart in range(bank.offset_rad.size):
        mass, half, pull = bank.mass_kg[cart], bank.rod_half_kg[cart], linkage[PULLS_AT + 6 * cart]
        psi = crank + bank.offset_rad[cart]
        sine, cosine = math.sin(psi), math.cos(psi)
        motion = cart_motion(bank, sine, cosine)
        inertia_x = mass * (motion.x1 * acceleration + motion.x2 * speed * speed)
        force = (pull - inertia_x) / motion.rod_cosine
        sense = -1.0 if bank.load == REVERSING and pull < 0.0 else 1.0
        static = rod_force(bank, cart, motion.rod_sine, motion.rod_cosine, sense)
        share = min(abs(pull / (static * motion.rod_cosine)), 1.0) if static != 0.0 else 0.0
        front, rear = guide_reactions(bank, cart, motion.rod_sine, force, sense, share, static)
        weight = half * bank.gravity_m_per_s2
        pin_x, pin_y = force * motion.rod_cosine, -force * motion.rod_sine - weight
        for i in range(12):
            out[at + i] = 0.0
        out[at], out[at + 1], out[at + 3], out[at + 4] = pin_x, pin_y, -pin_x, -(pin_y + weight)
        out[at + 7], out[at + 10], out[rods + cart] = -front, -rear, force
        at += 12
        moment += bank.crank_m * (cosine * pin_y - sine * pin_x)
        inertia_nm += bank.crank_m * abs(inertia_x)
        end_x = half * bank.crank_m * (-sine * acceleration - cosine * speed * speed)
        end_y = half * bank.crank_m * (cosine * acceleration - sine * speed * speed)
        shaft_x += pin_x - end_x
        shaft_y += pin_y - end_y
        shake_x -= inertia_x + end_x
        shake_y -= end_y
    out[PINS], out[PINS + 1] = -shaft_x, -shaft_y
    return moment, inertia_nm, shake_x, shake_y


@step_of(force_step, CoupledFormer, borrowing_kernel)
def fill_forces(
    model: CoupledFormer, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with every force at the linkage's step.

    The two routes to the moment in the coupling: the reduced equation of motion, and the crank-pin forces' moments.
    """
    former, now = model.former, shaft_of(linkage)
    crank, speed, motor, transmitted = now.crank_rad, now.crank_rad_per_s, now.drive_nm, now.crank_nm
    inertia, slope, load = load_sums(former, crank, linkage)
    weight = rod_weight_moment(former.bank, crank)
    driving = transmitted - load - weight - speed * speed * slope
    friction, coulomb = min(max(driving, -former.coulomb_nm), former.coulomb_nm), former.coulomb_nm  # static, at rest
    if speed != 0.0:
        friction = former.viscous_nms_per_rad * speed + (coulomb if speed > 0.0 else -coulomb)
    acceleration = (driving - friction) / inertia
    moment, inertia_nm, shake_x, shake_y = fill_cart_forces(former, crank, speed, acceleration, linkage, out)
    residual = transmitted - friction + moment - former.bank.crank_inertia_kg_m2 * acceleration
    scale = former.motor.breakdown_torque_nm * former.ratio + abs(transmitted) + abs(load) + abs(friction)
    scale += abs(weight) + speed * speed * abs(slope) + inertia * abs(acceleration)
    if former.bank.expanded:  # misses its transfer function cart by cart, also where the sum of all carts is zero
        scale += inertia_nm
    quantities = FormerQuantities(
        motor,
        transmitted,
        now.twist_nm,
        at_motor(former, transmitted, 1.0 if now.drive_rad_per_s >= 0.0 else -1.0),
        load,
        friction,
        weight,
        inertia * acceleration + speed * speed * slope,
        inertia,
        acceleration,
        (motor - transmitted) / former.motor_inertia_kg_m2 - acceleration,
        shake_x,
        shake_y,
        motor * now.drive_rad_per_s,
        load * speed,
    )
    carts = former.bank.offset_rad.size
    out[BODY_MOMENT], out[PINS + 2] = 0.0, transmitted
    copy_numbers(quantities, out[PINS + 3 + 12 * carts :])
    out[PINS + 3 + 13 * carts + QUANTITIES] = residual / scale
    return 0


def force_layout(count: int) -> ForceLayout:
    """Return the row of the force analysis of so many carts: shaft, then the pins and guide rollers of each cart."""
    kinds, carts = ("crank_pin", "cart_pin", "guide_front", "guide_rear"), range(1, count + 1)
    pins, rods = (f"{kind}_{i}" for i in carts for kind in kinds), tuple(f"rod_force_{i}_n" for i in carts)
    return ForceLayout(("shaft", *pins), (*FormerQuantities._fields, *rods), ("drive_torque_routes",))


def force_limits(bank: CartBank) -> dict[str, float]:
    """Return the limit of the two routes; the expansion's transfer function misses the linkage's by 0.19 r (r/l)^3.

    That is ``r/l sin psi cos psi (1/cos beta - 1)`` at the largest r/l with which it is allowed; 0.16 where r/l is
    small.
    """
    return {"drive_torque_routes": max(1e-10, MOST_MISSED * bank.ratio**3 if bank.expanded else 0.0)}


@dataclass(frozen=True)
class FormerLinkage(CompiledLinkage):
    """Both inertias, the elastic drive and all carts; it holds all mechanical state."""

    model: CoupledFormer
    step_s: float
    start_crank_rad: float
    start_speed_rad_per_s: float
    start_command: float
    coordinates = ("crank", "twist")
    regimes = REGIMES
    failures = FAILURES

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Joints: motor side at the crank, crank, twist between them, then cart and rod of each crank."""
        carts = range(1, self.model.former.bank.offset_rad.size + 1)
        return ("drive", "crank", "twist", *(f"{part}_{i}" for i in carts for part in ("cart", "rod")))

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the residuals; the series expansion has an error of (r/l)^4/8 of the rod's length."""
        bank = self.model.former.bank
        return {"energy_balance": 1e-8, "rod_length": max(1e-12, 0.2 * bank.ratio**4 if bank.expanded else 0.0)}

    @cached_property
    def layout(self) -> LinkageLayout:
        """Row of the samples."""
        return LinkageLayout(self.joints, FormerMemory._fields, RESIDUALS, EventLayout(EVENT_KINDS, ("crank",)))

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine in its initial state: untwisted, the load on or still off as configured."""
        y = state_array(self.start_crank_rad, self.start_speed_rad_per_s)
        former, out = self.model.former, np.empty(self.layout.size)
        start_row(former, y, np.array(start_modes(former, self.start_speed_rad_per_s)), self.start_command, out)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())

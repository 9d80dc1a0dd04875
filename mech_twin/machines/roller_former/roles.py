# SPDX-License-Identifier: Apache-2.0
"""Linkage and force analysis of the roller former; its motor is the shared induction motor behind a gear.

The linkage has inertias, elastic drive and all carts.  The forces of rods, guides, coupling and frame follow from
angles, rates and efforts of the joints.

The mass of a rod is halved to its ends (the page's model), so pin forces are those on crank and cart with their
half of the rod.  Guide friction in the drive's equation is that of the static load; what the inertia of a cart adds to
the guide reactions is shown in them and its friction neglected, as in (40).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_roles import CompiledLinkage
from mech_twin.engine.compiled_steps import Work, force_step, step_of, work_room
from mech_twin.engine.sample_vectors import BODY_MOMENT, PINS, EventLayout, ForceLayout, LinkageLayout
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel, kernel
from mech_twin.machines.roller_former.cart_parameters import REVERSING, CartBank
from mech_twin.machines.roller_former.cart_statics import cart_motion, guide_reactions, rod_force, rod_weight_moment
from mech_twin.machines.roller_former.dynamics import Array, Former, Modes, at_motor, may_stick, state_array
from mech_twin.machines.roller_former.former_row import (
    CARTS_AT,
    FAILURES,
    CoupledFormer,
    FormerMemory,
    FormerResiduals,
    shaft_of,
    start_row,
)
from mech_twin.machines.roller_former.motion import EVENT_KINDS
from mech_twin.samples import LinkageSample

MOST_MISSED = 0.2  # by the expansion's transfer function, of r (r/l)^3
REGIMES = ("running", "held", "stalled")  # by the numbers of `former_row`


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


class CartForces(NamedTuple):
    """Forces of each cart (N), shape (carts,): along the rod, on the guides, of the rod on its crank pin."""

    rod: Array
    front: Array
    rear: Array
    crank_pin_x: Array
    crank_pin_y: Array


class ShaftForces(NamedTuple):
    """Moment of the crank-pin forces about the shaft (N m), force on the shaft and shaking force (N).

    ``inertia_nm`` is the sum of the magnitudes of the carts' inertia forces times the crank radius: the scale of the
    errors of the series expansion.
    """

    moment_nm: float
    inertia_nm: float
    x_n: float
    y_n: float
    shaking_x_n: float
    shaking_y_n: float


def pin_names(count: int) -> tuple[str, ...]:
    """Return the pins: shaft, then crank pin, cart pin, front and rear guide rollers of each cart."""
    kinds = ("crank_pin", "cart_pin", "guide_front", "guide_rear")
    return ("shaft", *(f"{kind}_{i}" for i in range(1, count + 1) for kind in kinds))


def loaded_bodies(count: int) -> tuple[str, ...]:
    """Return on which body each pin's force acts."""
    return ("shaft", *(body for i in range(1, count + 1) for body in (f"crank_{i}", *(f"cart_{i}",) * 3)))


@borrowing_kernel
def load_sums(former: Former, crank: float, pulls: Array) -> tuple[float, float, float]:
    """Return J_p2, half its derivative, and the load moment of the forces on the carts (N, along x)."""
    bank = former.bank
    inertia, slope, load = bank.crank_inertia_kg_m2, 0.0, 0.0
    for cart in range(pulls.size):
        sine, cosine = math.sin(crank + bank.offset_rad[cart]), math.cos(crank + bank.offset_rad[cart])
        motion = cart_motion(bank, sine, cosine)
        inertia += bank.mass_kg[cart] * motion.x1 * motion.x1
        slope += bank.mass_kg[cart] * motion.x1 * motion.x2
        load += pulls[cart] / motion.rod_cosine * bank.crank_m * sine * (motion.rod_cosine + bank.ratio * cosine)
    return inertia, slope, load


@borrowing_kernel
def friction_moment(former: Former, speed: float, driving: float) -> float:
    """Return the friction of the shaft (N m): kinetic, or static at rest, up to Coulomb's limit."""
    if speed == 0.0:
        return min(max(driving, -former.coulomb_nm), former.coulomb_nm)
    return former.viscous_nms_per_rad * speed + (former.coulomb_nm if speed > 0.0 else -former.coulomb_nm)


@borrowing_kernel
def fill_cart_forces(
    former: Former, crank: float, speed: float, acceleration: float, pulls: Array, forces: CartForces
) -> ShaftForces:
    """Fill the forces of each cart; return the resulting forces on shaft and frame.

    The weight of a rod's half at the crank pin is part of the force on that pin.
    """
    bank = former.bank
    moment, inertia_nm, shaft_x, shaft_y, shake_x, shake_y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for cart in range(pulls.size):
        mass, half = bank.mass_kg[cart], bank.rod_half_kg[cart]
        psi = crank + bank.offset_rad[cart]
        sine, cosine = math.sin(psi), math.cos(psi)
        motion = cart_motion(bank, sine, cosine)
        inertia_x = mass * (motion.x1 * acceleration + motion.x2 * speed * speed)
        force = (pulls[cart] - inertia_x) / motion.rod_cosine
        sense = -1.0 if bank.load == REVERSING and pulls[cart] < 0.0 else 1.0
        static = rod_force(bank, cart, motion.rod_sine, motion.rod_cosine, sense)
        share = min(abs(pulls[cart] / (static * motion.rod_cosine)), 1.0) if static != 0.0 else 0.0
        forces.rod[cart] = force
        forces.front[cart], forces.rear[cart] = guide_reactions(
            bank, cart, motion.rod_sine, force, sense, share, static
        )
        pin_x, pin_y = force * motion.rod_cosine, -force * motion.rod_sine - half * bank.gravity_m_per_s2
        forces.crank_pin_x[cart], forces.crank_pin_y[cart] = pin_x, pin_y
        moment += bank.crank_m * (cosine * pin_y - sine * pin_x)
        inertia_nm += bank.crank_m * abs(inertia_x)
        end_x = half * bank.crank_m * (-sine * acceleration - cosine * speed * speed)
        end_y = half * bank.crank_m * (cosine * acceleration - sine * speed * speed)
        shaft_x += pin_x - end_x
        shaft_y += pin_y - end_y
        shake_x -= inertia_x + end_x
        shake_y -= end_y
    return ShaftForces(moment, inertia_nm, shaft_x, shaft_y, shake_x, shake_y)


@kernel
def former_forces(
    former: Former, crank: float, speed: float, drive_speed: float, efforts: tuple[float, float, float], pulls: Array,
    forces: CartForces,
) -> tuple[ShaftForces, FormerQuantities, float]:  # fmt: skip
    """Fill the forces of the carts; return those of the shaft, the quantities, and the difference of two routes.

    The routes lead to the coupling moment.

    ``efforts`` are the motor's moment at the crank, the moment in the coupling and its elastic part (N m).
    """
    motor, transmitted, elastic = efforts
    inertia, slope, load = load_sums(former, crank, pulls)
    weight = rod_weight_moment(former.bank, crank)
    driving = transmitted - load - weight - speed * speed * slope
    friction = friction_moment(former, speed, driving)
    acceleration = (driving - friction) / inertia
    shaft = fill_cart_forces(former, crank, speed, acceleration, pulls, forces)
    residual = transmitted - friction + shaft.moment_nm - former.bank.crank_inertia_kg_m2 * acceleration
    scale = former.motor.breakdown_torque_nm * former.ratio + abs(transmitted) + abs(load) + abs(friction)
    scale += abs(weight) + speed * speed * abs(slope) + inertia * abs(acceleration)
    if former.bank.expanded:  # misses its transfer function cart by cart, also where the sum of all carts is zero
        scale += shaft.inertia_nm
    drive_acceleration = (motor - transmitted) / former.motor_inertia_kg_m2
    quantities = FormerQuantities(
        motor,
        transmitted,
        elastic,
        at_motor(former, transmitted, 1.0 if drive_speed >= 0.0 else -1.0),
        load,
        friction,
        weight,
        inertia * acceleration + speed * speed * slope,
        inertia,
        acceleration,
        drive_acceleration - acceleration,
        shaft.shaking_x_n,
        shaft.shaking_y_n,
        motor * drive_speed,
        load * speed,
    )
    return shaft, quantities, residual / scale


class LoadedFormer(NamedTuple):
    """Constants of the force analysis."""

    former: Former


@inline_kernel
def cart_forces_in(numbers: Array, carts: int) -> CartForces:
    """Return the forces of the carts as views of an array of five times their number."""
    return CartForces(
        numbers[:carts], numbers[carts : 2 * carts], numbers[2 * carts : 3 * carts], numbers[3 * carts : 4 * carts],
        numbers[4 * carts : 5 * carts],
    )  # fmt: skip


@step_of(work_room, LoadedFormer, borrowing_kernel)
def room_of_forces(model: LoadedFormer) -> tuple[int, int]:
    """Return the lengths of the work arrays of `fill_forces`."""
    return 6 * model.former.bank.offset_rad.size, 0


@step_of(force_step, LoadedFormer, borrowing_kernel)
def fill_forces(
    model: LoadedFormer, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with every force at the linkage's step.

    The two routes to the moment in the coupling: the reduced equation of motion, and the crank-pin forces' moments.
    """
    former, carts = model.former, model.former.bank.offset_rad.size
    pulls, forces = work.numbers[:carts], cart_forces_in(work.numbers[carts:], carts)
    for cart in range(carts):
        pulls[cart] = linkage[CARTS_AT + 6 * cart + 2]
    now = shaft_of(linkage)
    efforts = (now.drive_nm, now.crank_nm, now.twist_nm)
    shaft, quantities, residual = former_forces(
        former, now.crank_rad, now.crank_rad_per_s, now.drive_rad_per_s, efforts, pulls, forces
    )
    out[BODY_MOMENT] = 0.0
    out[PINS], out[PINS + 1], out[PINS + 2] = -shaft.x_n, -shaft.y_n, quantities.coupling_moment_nm
    at = PINS + 3
    for cart in range(carts):
        weight = former.bank.rod_half_kg[cart] * former.bank.gravity_m_per_s2
        pin_x, pin_y = forces.crank_pin_x[cart], forces.crank_pin_y[cart]
        for i in range(12):
            out[at + i] = 0.0
        out[at], out[at + 1] = pin_x, pin_y
        out[at + 3], out[at + 4] = -pin_x, -(pin_y + weight)
        out[at + 7], out[at + 10] = -forces.front[cart], -forces.rear[cart]
        at += 12
    for i in range(len(quantities)):
        out[at + i] = quantities[i]
    at += len(quantities)
    for cart in range(carts):
        out[at + cart] = forces.rod[cart]
    out[at + carts] = residual
    return 0


def force_layout(count: int) -> ForceLayout:
    """Return the row of the force analysis of so many carts."""
    rods = tuple(f"rod_force_{i}_n" for i in range(1, count + 1))
    return ForceLayout(pin_names(count), (*FormerQuantities._fields, *rods), ("drive_torque_routes",))


def force_limits(bank: CartBank) -> dict[str, float]:
    """Return the limit of the two routes; the expansion's transfer function misses the linkage's by 0.19 r (r/l)^3.

    That is ``r/l sin psi cos psi (1/cos beta - 1)`` at the largest r/l with which it is allowed; 0.16 where r/l is
    small.
    """
    return {"drive_torque_routes": max(1e-10, MOST_MISSED * bank.ratio**3 if bank.expanded else 0.0)}


class FormerJoints(NamedTuple):
    """Positions, velocities or efforts of the joints by name: motor side at the crank, crank, twist, carts, rods."""

    drive: float
    crank: float
    twist: float
    carts: tuple[float, ...]
    rods: tuple[float, ...]


def joint_names(count: int) -> tuple[str, ...]:
    """Return the joints: motor side at the crank, crank, twist between them, then cart and rod of each crank."""
    carts = tuple(name for i in range(1, count + 1) for name in (f"cart_{i}", f"rod_{i}"))
    return ("drive", "crank", "twist", *carts)


def joints_of(values: tuple[float, ...]) -> FormerJoints:
    """Return the values of a sample's joints by name."""
    drive, crank, twist, *carts_and_rods = values
    return FormerJoints(drive, crank, twist, tuple(carts_and_rods[::2]), tuple(carts_and_rods[1::2]))


@dataclass(frozen=True)
class FormerLinkage(CompiledLinkage):
    """Both inertias, the elastic drive and all carts; it holds all mechanical state."""

    model: CoupledFormer
    step_s: float
    start_crank_rad: float
    start_speed_rad_per_s: float
    start_command: float
    joints: tuple[str, ...]
    coordinates = ("crank", "twist")
    regimes = REGIMES
    failures = FAILURES

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the residuals; the series expansion has an error of (r/l)^4/8 of the rod's length."""
        bank = self.model.former.bank
        return {"energy_balance": 1e-8, "rod_length": max(1e-12, 0.2 * bank.ratio**4 if bank.expanded else 0.0)}

    @cached_property
    def layout(self) -> LinkageLayout:
        """Row of the samples."""
        return LinkageLayout(
            self.joints, FormerMemory._fields, FormerResiduals._fields, EventLayout(EVENT_KINDS, ("crank",))
        )

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine in its initial state: untwisted, the load on or still off as configured."""
        y = state_array(self.start_crank_rad, self.start_speed_rad_per_s)
        former, out = self.model.former, np.empty(self.layout.size)
        start_row(former, y, start_modes(former, self.start_speed_rad_per_s), self.start_command, out)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())


def start_modes(former: Former, speed_rad_per_s: float) -> Modes:
    """Return the initial modes: load on or off; a crank at rest under load or friction sticks."""
    loaded = former.engage_speed_rad_per_s <= speed_rad_per_s
    modes = Modes(1.0, 1.0, loaded, float(loaded), -1.0, False)
    held = speed_rad_per_s == 0.0 and may_stick(former, loaded)
    return modes._replace(direction=0.0) if held else modes

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
from mech_twin.engine.compiled_steps import Work, force_step, step_of
from mech_twin.engine.sample_vectors import BODY_MOMENT, PINS, EventLayout, ForceLayout, LinkageLayout
from mech_twin.kernels.kernel import borrowing_kernel
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

PULLS_AT = CARTS_AT + 2  # along x, of one cart after the other
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


QUANTITIES = len(FormerQuantities._fields)


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
def friction_moment(former: Former, speed: float, driving: float) -> float:
    """Return the friction of the shaft (N m): kinetic, or static at rest, up to Coulomb's limit."""
    if speed == 0.0:
        return min(max(driving, -former.coulomb_nm), former.coulomb_nm)
    return former.viscous_nms_per_rad * speed + (former.coulomb_nm if speed > 0.0 else -former.coulomb_nm)


@borrowing_kernel
def fill_cart_forces(
    former: Former, crank: float, speed: float, acceleration: float, linkage: Array, out: Array
) -> ShaftForces:
    """Fill pins and rod force of each cart in the row of the forces; return the forces on shaft and frame.

    The weight of a rod's half at the crank pin is part of the force on that pin.
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
    return ShaftForces(moment, inertia_nm, shaft_x, shaft_y, shake_x, shake_y)


class LoadedFormer(NamedTuple):
    """Constants of the force analysis."""

    former: Former


@step_of(force_step, LoadedFormer, borrowing_kernel)
def fill_forces(
    model: LoadedFormer, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with every force at the linkage's step.

    The two routes to the moment in the coupling: the reduced equation of motion, and the crank-pin forces' moments.
    """
    former, now = model.former, shaft_of(linkage)
    crank, speed, motor, transmitted = now.crank_rad, now.crank_rad_per_s, now.drive_nm, now.crank_nm
    inertia, slope, load = load_sums(former, crank, linkage)
    weight = rod_weight_moment(former.bank, crank)
    driving = transmitted - load - weight - speed * speed * slope
    friction = friction_moment(former, speed, driving)
    acceleration = (driving - friction) / inertia
    shaft = fill_cart_forces(former, crank, speed, acceleration, linkage, out)
    residual = transmitted - friction + shaft.moment_nm - former.bank.crank_inertia_kg_m2 * acceleration
    scale = former.motor.breakdown_torque_nm * former.ratio + abs(transmitted) + abs(load) + abs(friction)
    scale += abs(weight) + speed * speed * abs(slope) + inertia * abs(acceleration)
    if former.bank.expanded:  # misses its transfer function cart by cart, also where the sum of all carts is zero
        scale += shaft.inertia_nm
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
        shaft.shaking_x_n,
        shaft.shaking_y_n,
        motor * now.drive_rad_per_s,
        load * speed,
    )
    carts = former.bank.offset_rad.size
    out[BODY_MOMENT], out[PINS], out[PINS + 1], out[PINS + 2] = 0.0, -shaft.x_n, -shaft.y_n, transmitted
    for i in range(QUANTITIES):
        out[PINS + 3 + 12 * carts + i] = quantities[i]
    out[PINS + 3 + 13 * carts + QUANTITIES] = residual / scale
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
        start_row(former, y, np.array(start_modes(former, self.start_speed_rad_per_s)), self.start_command, out)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())


def start_modes(former: Former, speed_rad_per_s: float) -> Modes:
    """Return the initial modes: load on or off; a crank at rest under load or friction sticks."""
    loaded = former.engage_speed_rad_per_s <= speed_rad_per_s
    held = speed_rad_per_s == 0.0 and may_stick(former, loaded)
    return Modes(0.0 if held else 1.0, load_on_1=float(loaded), load_share_1=float(loaded))

# SPDX-License-Identifier: Apache-2.0
r"""State of the roller former, its constants, and the moments and energies that follow from both.

::

    M_p1 --> (J_p1, phi1) ==[ c, k ]== (J_p2(phi2), phi2) <-- M_p2(phi2), friction of the shaft, weight of the rods

    J_p1 phi1'' = M_p1 - T,   T = c (phi1 - phi2) + k (phi1' - phi2')
    J_p2 phi2'' + phi2'^2 sum m_B x' x'' = T - M_p2 - M_friction - M_weight

The state has the twist instead of phi1, so that a twist of 1e-4 rad keeps its digits after many turns.  M_p1 is the
motor's torque behind the gear: u eta M while it drives, u M/eta while driven (by the sign of power), or u eta M always,
as printed.

Source: LoveikinRoller2018 eq. (40); the friction of the shaft and the rule of the gear are ours.
"""

from math import cos, sin
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.addresses import record_at, record_of
from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel
from mech_twin.machines.roller_former.cart_parameters import RESIST, REVERSING, CartBank
from mech_twin.machines.roller_former.cart_statics import shaft_terms
from mech_twin.parts.friction_and_gear import gear_torque
from mech_twin.parts.induction_motor import MotorConstants, MotorInStep, torque_in_step


class FormerState(NamedTuple):
    """State of the motion: angles and rates, and the works since the start of the integration."""

    crank_rad: float
    twist_rad: float
    crank_speed_rad_per_s: float
    twist_rate_rad_per_s: float
    motor_work_j: float
    damping_work_j: float
    load_work_j: float
    friction_work_j: float


STATE_SIZE = len(FormerState._fields)
CRANK, SPEED, TWIST_RATE = (
    FormerState._fields.index(name) for name in ("crank_rad", "crank_speed_rad_per_s", "twist_rate_rad_per_s")
)


class Former(NamedTuple):
    """Kernel constants: carts, motor, drive, friction, start and stall thresholds, scales and tolerances."""

    bank: CartBank
    motor: MotorConstants
    motor_inertia_kg_m2: float
    stiffness_nm_per_rad: float
    damping_nms_per_rad: float
    ratio: float
    efficiency: float
    loss_by_power: bool
    coulomb_nm: float
    viscous_nms_per_rad: float
    engage_speed_rad_per_s: float
    load_rise_s: float
    slow_speed_rad_per_s: float
    stall_time_s: float
    scales: FormerState
    tolerances: Array


class Modes(NamedTuple):
    """Discrete state: directions of rotation of crank and drive (0: sticking), load, time below stall speed (s).

    The share of the load rises from 0 to 1 after it is applied; ``slow_s`` is -1 above the stall threshold.
    """

    direction_1: float = 1.0
    drive_direction_1: float = 1.0
    load_on_1: float = 0.0
    load_share_1: float = 0.0
    slow_s: float = -1.0
    stalled_1: float = 0.0


MODES = record_of(Modes._fields)
LOADED = Modes(load_on_1=1.0, load_share_1=1.0)


@borrowing_kernel
def modes_of(row: Array, place: int) -> Any:
    """Return the modes at a place of an array as a record that shares its numbers."""
    return record_at(row, place, MODES)


@embedded_kernel
def state_of(y: Array) -> FormerState:
    """Return the state by its names."""
    return FormerState(y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])


def state_array(crank_rad: float, crank_speed_rad_per_s: float) -> Array:
    """Return the state of an untwisted machine, all works zero."""
    return np.array(FormerState(crank_rad, 0.0, crank_speed_rad_per_s, 0.0, 0.0, 0.0, 0.0, 0.0))


@borrowing_kernel
def holds_at_rest(bank: CartBank) -> bool:
    """Return whether the load always opposes the motion, and so can hold the shaft at rest."""
    return bank.load in (REVERSING, RESIST)


@borrowing_kernel
def may_stick(former: Former, load_on: bool) -> bool:
    """Return whether the crank may be held at rest: by the load, or by friction of the shaft."""
    return former.coulomb_nm > 0.0 or (load_on and holds_at_rest(former.bank))


def start_modes(former: Former, speed_rad_per_s: float) -> Modes:
    """Return the initial modes: load on or off; a crank at rest under load or friction sticks."""
    loaded = former.engage_speed_rad_per_s <= speed_rad_per_s
    held = speed_rad_per_s == 0.0 and may_stick(former, loaded)
    return Modes(0.0 if held else 1.0, load_on_1=float(loaded), load_share_1=float(loaded))


@embedded_kernel
def shaft_torque(former: Former, torque: MotorInStep, t: float, speed: float) -> float:
    """Return the torque on the motor's shaft (N m) at a time and a speed of the first mass (rad/s, at the crank)."""
    return torque_in_step(torque, t, speed * former.ratio)


@borrowing_kernel
def geared(former: Former, shaft_nm: float, direction: float) -> float:
    """Return the moment at the crank (N m) of a torque on the motor's shaft, the drive turning in ``direction``."""
    if former.loss_by_power:
        return gear_torque(former.ratio, former.efficiency, shaft_nm, direction)
    return shaft_nm * former.ratio * former.efficiency


@borrowing_kernel
def at_motor(former: Former, moment_nm: float, direction: float) -> float:
    """Return the coupling torque on the motor's side (N m) for a moment behind the gear: the inverse of `geared`.

    ``T/(u eta)`` while the motor drives, ``T eta/u`` while it is driven.
    """
    if former.loss_by_power and moment_nm * direction < 0.0:
        return moment_nm * former.efficiency / former.ratio
    return moment_nm / (former.ratio * former.efficiency)


@embedded_kernel
def coupling_moment(former: Former, now: FormerState) -> float:
    """Return ``T = c (phi1 - phi2) + k (phi1' - phi2')`` (N m)."""
    return former.stiffness_nm_per_rad * now.twist_rad + former.damping_nms_per_rad * now.twist_rate_rad_per_s


@borrowing_kernel
def stored_energy(former: Former, now: FormerState, sides: Array) -> float:
    """Return the kinetic, elastic and potential energy of the state (J)."""
    bank, (inertia, _, _) = former.bank, shaft_terms(former.bank, now.crank_rad, sides, 1.0)
    first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    return (
        0.5 * former.motor_inertia_kg_m2 * first * first
        + 0.5 * inertia * now.crank_speed_rad_per_s * now.crank_speed_rad_per_s
        + 0.5 * former.stiffness_nm_per_rad * now.twist_rad * now.twist_rad
        + (bank.rod_weight_cosine_nm * sin(now.crank_rad) + bank.rod_weight_sine_nm * cos(now.crank_rad))
    )

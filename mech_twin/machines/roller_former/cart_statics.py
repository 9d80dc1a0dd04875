# SPDX-License-Identifier: Apache-2.0
r"""Roller forming cart on a crank: its position, rod force, guide reactions and moment on the shaft.

::

     y                A
     |             .-'`-._   l, rod                    cart
     |     r    .-'       `-._               +-------------------------+
     |       .-' psi   beta   `-._           |  N1        G       N2   |
     O----.-'-----------------------`-------B|  (o)               (o)  |   guide rollers, b either side of the middle
     shaft                           x       +-------------------------+   the middle is p beyond B
                                                  ( )         ( )          forming rollers, a either side, contact e
                                                  F01,R01     F02,R02      below B

``psi`` is counter-clockwise from full extension (x = r + l); lambda = r/l, sin beta = lambda sin psi.  The rod pulls
the cart towards the shaft with F > 0; ``N`` > 0 is the downward force of the upper rail, N < 0 means that the
roller runs on the lower one.

Sources: LoveikinRoller2018 eqs. (10), (12)-(20), (30)-(39).  The term with e follows from (10); the print drops it.
"""

from math import copysign, cos, floor, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, kernel
from mech_twin.machines.roller_former.cart_parameters import NONE, PRINTED, RECTIFIED, RESIST, REVERSING, CartBank

LOOK_AHEAD_RAD = 1e-9


class CartMotion(NamedTuple):
    """Cart position (m) and its first two derivatives by the crank angle; sine and cosine of the rod's angle."""

    x: float
    x1: float
    x2: float
    rod_sine: float
    rod_cosine: float


class CartLoad(NamedTuple):
    """Rod force and guide reactions (N), reduced moment on the shaft (N m)."""

    rod_force_n: float
    front_n: float
    rear_n: float
    moment_nm: float


@borrowing_kernel
def cart_motion(bank: CartBank, sine: float, cosine: float) -> CartMotion:
    """Return a cart's position and transfer functions at ``sin psi``, ``cos psi``."""
    r, ratio = bank.crank_m, bank.ratio
    rod_sine = ratio * sine
    rod_cosine = sqrt(1.0 - rod_sine * rod_sine)
    if bank.expanded:
        x = r * cosine + bank.rod_m * (1.0 - 0.5 * rod_sine * rod_sine)
        x1 = -r * (sine + ratio * sine * cosine)
        x2 = -r * (cosine + ratio * (cosine * cosine - sine * sine))
        return CartMotion(x, x1, x2, rod_sine, rod_cosine)
    turn = sine * cosine / rod_cosine
    x = r * cosine + bank.rod_m * rod_cosine
    x1 = -r * (sine + ratio * turn)
    x2 = -r * (
        cosine + ratio * ((cosine * cosine - sine * sine) / rod_cosine + ratio * ratio * turn * turn / rod_cosine)
    )
    return CartMotion(x, x1, x2, rod_sine, rod_cosine)


@borrowing_kernel
def guide_reactions(
    bank: CartBank, cart: int, rod_sine: float, rod_force_n: float, sense: float, share: float, static_force_n: float
) -> tuple[float, float]:
    """Return N1 and N2 (N) of a cart whose rod pulls with ``rod_force_n``.

    ``sense`` is +1 or -1 with the travel, ``share`` the fraction of process force and guide friction that acts.
    ``static_force_n`` is the rod force without inertia under the full load, whose reactions give the friction.

    From the moments about B and the vertical forces of (10), with ``sense f`` for f and ``sense F0`` for F0.
    """
    lift = bank.force_y_n[cart] - bank.weight_n[cart]
    rubbing = sense * share * bank.friction * (static_force_n * rod_sine + lift)
    lift = share * bank.force_y_n[cart] - bank.weight_n[cart]
    total = rod_force_n * rod_sine + lift
    process = sense * share * bank.force_x_n[cart] * bank.e_m
    arm = bank.b_m - bank.p_m
    rear = (total * arm - rubbing * bank.roller_radius_m + process + lift * bank.p_m) / (2.0 * bank.b_m)
    return total - rear, rear


@borrowing_kernel
def rod_force(bank: CartBank, cart: int, rod_sine: float, rod_cosine: float, sense: float) -> float:
    """Return the rod force F (N) that moves a cart against its load; ``sense`` is +1 or -1 with the travel.

    Signed friction: eq. (12), ``s [(R01 + R02 - G) f + F01 + F02]/(cos beta - s f sin beta)``.  Friction by the
    magnitude of each reaction: the consistent signs of N1 and N2 (the moment about B keeps f N d/2: on the other rail
    force and arm both change sign).
    """
    f = bank.friction
    if not bank.on_either_rail[cart]:
        return float(sense * bank.pull_n[cart] / (rod_cosine - sense * f * rod_sine))
    front_0, rear_0 = guide_reactions(bank, cart, rod_sine, 0.0, sense, 1.0, 0.0)
    # derivative by the rod force, formed directly: a difference of moments would be lost in rounding
    rear_1 = rod_sine * (bank.b_m - bank.p_m - sense * f * bank.roller_radius_m) / (2.0 * bank.b_m)
    front_1 = rod_sine - rear_1
    force = 0.0
    for signs in range(4):
        front_sign = 1.0 - 2.0 * (signs & 1)
        rear_sign = 1.0 - (signs & 2)
        pull = f * (front_sign * front_0 + rear_sign * rear_0) + bank.force_x_n[cart]
        slope = f * (front_sign * front_1 + rear_sign * rear_1)
        force = sense * pull / (rod_cosine - sense * slope)
        if front_sign * (front_0 + front_1 * force) >= 0.0 and rear_sign * (rear_0 + rear_1 * force) >= 0.0:
            return float(force)
    return float(force)


@borrowing_kernel
def cart_moment(
    bank: CartBank, force: float, motion: CartMotion, sine: float, cosine: float, side: float, direction: float
) -> float:
    """Return the reduced moment of a cart (N m) from its rod force, ``F r sin(psi + beta)`` as the load kind says."""
    moment = force * bank.crank_m * sine * (motion.rod_cosine + bank.ratio * cosine)
    if bank.load in (RECTIFIED, RESIST):
        moment = moment * side if force >= 0.0 else -moment * side
        if bank.load == RESIST:
            moment *= direction
    return moment


@borrowing_kernel
def cart_load(bank: CartBank, cart: int, crank_rad: float, direction: float) -> CartLoad:
    """Return rod force, guide reactions and moment of one cart at a crank angle, without inertia.

    ``direction`` is the sign of the shaft's speed.  Reversing: process force and friction go with the travel,
    ``s = sign(sin(psi + beta)) direction``; the other kinds keep s = +1 as (12) does.
    """
    psi = crank_rad + bank.offset_rad[cart]
    sine, cosine = sin(psi), cos(psi)
    motion = cart_motion(bank, sine, cosine)
    if bank.load == NONE:
        front, rear = guide_reactions(bank, cart, motion.rod_sine, 0.0, 1.0, 0.0, 0.0)
        return CartLoad(0.0, front, rear, 0.0)
    side = 1.0 if sin(psi + direction * LOOK_AHEAD_RAD) >= 0.0 else -1.0
    sense = side * direction if bank.load == REVERSING else 1.0
    force = rod_force(bank, cart, motion.rod_sine, motion.rod_cosine, sense)
    front, rear = guide_reactions(bank, cart, motion.rod_sine, force, sense, 1.0, force)
    if bank.load != PRINTED:
        sine = abs(sine) * side  # on a dead centre its sign is rounding, which made a load that opposes drive
    return CartLoad(force, front, rear, cart_moment(bank, force, motion, sine, cosine, side, direction))


@borrowing_kernel
def sides_of_travel(bank: CartBank, crank_rad: float, sides: NDArray[np.float64]) -> tuple[float, float]:
    """Fill ``sides`` with the half turn of each cart; return the crank angles (rad) of the dead centres either side.

    At these dead centres the moment of every load but ``printed`` has a kink.
    """
    low, high = -1e300, 1e300
    for cart in range(bank.offset_rad.size):
        offset = bank.offset_rad[cart]
        half = float(floor((crank_rad + offset) / pi))
        sides[cart] = 1.0 if half % 2.0 == 0.0 else -1.0
        low = max(low, half * pi - offset)
        high = min(high, (half + 1.0) * pi - offset)
    return low, high


@embedded_kernel
def plain_terms(
    bank: CartBank, crank_rad: float, sides: NDArray[np.float64], direction: float
) -> tuple[float, float, float]:
    """Return `shaft_terms` for exact kinematics and signed friction.

    Without a branch in the loop that the compiler could not lift out: twice as fast.
    """
    inertia, slope, moment = bank.crank_inertia_kg_m2, 0.0, 0.0
    crank_m, ratio, friction, load = bank.crank_m, bank.ratio, bank.friction, bank.load
    offset_cosine, offset_sine, mass, pull = bank.offset_cosine, bank.offset_sine, bank.mass_kg, bank.pull_n
    shaft_sine, shaft_cosine = sin(crank_rad), cos(crank_rad)
    reverses = 1.0 if load == REVERSING else 0.0
    one_way = 1.0 if load in (RECTIFIED, RESIST) else 0.0
    for cart in range(offset_cosine.size):
        sine = shaft_sine * offset_cosine[cart] + shaft_cosine * offset_sine[cart]
        cosine = shaft_cosine * offset_cosine[cart] - shaft_sine * offset_sine[cart]
        rod_cosine = sqrt(1.0 - ratio * ratio * sine * sine)
        secant = 1.0 / rod_cosine
        turn = sine * cosine * secant
        x1 = -crank_m * (sine + ratio * turn)
        x2 = -crank_m * (cosine + ratio * secant * (cosine * cosine - sine * sine + ratio * ratio * turn * turn))
        inertia += mass[cart] * x1 * x1
        slope += mass[cart] * x1 * x2
        if load != NONE:
            sense = 1.0 + reverses * (sides[cart] * direction - 1.0)
            factor = 1.0 + one_way * (copysign(sides[cart], sides[cart] * pull[cart]) - 1.0)
            arm = crank_m * sine * (rod_cosine + ratio * cosine)
            moment += factor * sense * pull[cart] * arm / (rod_cosine - sense * friction * ratio * sine)
    return inertia, slope, direction * moment if load == RESIST else moment


@borrowing_kernel
def branching_terms(
    bank: CartBank, crank_rad: float, sides: NDArray[np.float64], direction: float
) -> tuple[float, float, float]:
    """Return `shaft_terms` for any kinematics and friction."""
    inertia, slope, moment = bank.crank_inertia_kg_m2, 0.0, 0.0
    shaft_sine, shaft_cosine = sin(crank_rad), cos(crank_rad)
    for cart in range(bank.offset_rad.size):
        sine = shaft_sine * bank.offset_cosine[cart] + shaft_cosine * bank.offset_sine[cart]
        cosine = shaft_cosine * bank.offset_cosine[cart] - shaft_sine * bank.offset_sine[cart]
        motion = cart_motion(bank, sine, cosine)
        inertia += bank.mass_kg[cart] * motion.x1 * motion.x1
        slope += bank.mass_kg[cart] * motion.x1 * motion.x2
        if bank.load != NONE:
            sense = sides[cart] * direction if bank.load == REVERSING else 1.0
            force = rod_force(bank, cart, motion.rod_sine, motion.rod_cosine, sense)
            moment += cart_moment(bank, force, motion, sine, cosine, sides[cart], direction)
    return inertia, slope, moment


@borrowing_kernel
def shaft_terms(
    bank: CartBank, crank_rad: float, sides: NDArray[np.float64], direction: float
) -> tuple[float, float, float]:
    """Return J_p2 (kg m^2), half its derivative (kg m^2/rad) and the load moment M_p2 (N m) of all carts.

    ``J_p2 = J_k + sum m_B x'^2`` and ``sum m_B x' x''``; the sides are given, so that a moment with a kink can be
    continued smoothly beyond it.
    """
    if bank.plain:
        return plain_terms(bank, crank_rad, sides, direction)
    return branching_terms(bank, crank_rad, sides, direction)


@borrowing_kernel
def load_moment(bank: CartBank, crank_rad: float, direction: float) -> float:
    """Return the load moment M_p2 of all carts (N m) at a crank angle, turning in ``direction``."""
    total = 0.0
    for cart in range(bank.offset_rad.size):
        total += cart_load(bank, cart, crank_rad, direction).moment_nm
    return total


@kernel
def load_moments(bank: CartBank, crank_rad: NDArray[np.float64], direction: float) -> NDArray[np.float64]:
    """Return the load moments (N m) at many crank angles (rad)."""
    moments = np.empty(crank_rad.size)
    for index in range(crank_rad.size):
        moments[index] = load_moment(bank, crank_rad[index], direction)
    return moments


@embedded_kernel
def rod_weight_moment(bank: CartBank, crank_rad: float) -> float:
    """Return the moment (N m) against forward rotation of the weight of the rods' halves at the crank pins."""
    return bank.rod_weight_cosine_nm * cos(crank_rad) - bank.rod_weight_sine_nm * sin(crank_rad)

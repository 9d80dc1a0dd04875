r"""Roller forming cart on a crank: where it is, what the rod and the guides carry, what moment it asks.

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

from __future__ import annotations

from math import copysign, cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.cart_parameters import (
    ABSOLUTE,
    COSINE,
    FORCE_X,
    FORCE_Y,
    MASS,
    NONE,
    OFFSET,
    PRINTED,
    PULL,
    RECTIFIED,
    RESIST,
    REVERSING,
    SINE,
    WEIGHT,
    CartBank,
)

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


@kernel
def cart_motion(bank: CartBank, sine: float, cosine: float) -> CartMotion:
    """Return a cart's position and transfer functions at ``sin psi``, ``cos psi``.

    in both.
    """
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


@kernel
def guide_reactions(
    bank: CartBank, cart: int, rod_sine: float, rod_force_n: float, sense: float, share: float
) -> tuple[float, float]:
    """Return N1 and N2 (N) of a cart whose rod pulls with ``rod_force_n``.

    ``sense`` is +1 or -1 with the travel, ``share`` the part of the roller forces that is on.

    From the moments about B and the vertical forces of (10), with ``sense f`` for f and ``sense F0`` for F0.
    """
    row = bank.carts[cart]
    lift = share * row[FORCE_Y] - row[WEIGHT]
    total = rod_force_n * rod_sine + lift
    arm = bank.b_m - bank.p_m - sense * bank.friction * bank.roller_radius_m
    rear = (total * arm + sense * share * row[FORCE_X] * bank.e_m + lift * bank.p_m) / (2.0 * bank.b_m)
    return total - rear, rear


@kernel
def rod_force(bank: CartBank, cart: int, rod_sine: float, rod_cosine: float, sense: float) -> float:
    """Return the rod force F (N) that moves a cart against its load; ``sense`` is +1 or -1 with the travel.

    Signed friction: eq. (12), ``s [(R01 + R02 - G) f + F01 + F02]/(cos beta - s f sin beta)``.  Friction on the size of
    each reaction: the signs of N1 and N2 for which the solution agrees with itself (the moment about B keeps f N d/2:
    on the other rail force and arm both change sign).
    """
    row = bank.carts[cart]
    f = bank.friction
    if row[ABSOLUTE] == 0.0:
        return float(sense * row[PULL] / (rod_cosine - sense * f * rod_sine))
    front_0, rear_0 = guide_reactions(bank, cart, rod_sine, 0.0, sense, 1.0)
    front_1, rear_1 = guide_reactions(bank, cart, rod_sine, 1.0, sense, 1.0)
    front_1, rear_1 = front_1 - front_0, rear_1 - rear_0
    force = 0.0
    for signs in range(4):
        front_sign = 1.0 - 2.0 * (signs & 1)
        rear_sign = 1.0 - (signs & 2)
        pull = f * (front_sign * front_0 + rear_sign * rear_0) + row[FORCE_X]
        slope = f * (front_sign * front_1 + rear_sign * rear_1)
        force = sense * pull / (rod_cosine - sense * slope)
        if front_sign * (front_0 + front_1 * force) >= 0.0 and rear_sign * (rear_0 + rear_1 * force) >= 0.0:
            return float(force)
    return float(force)


@kernel
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


@kernel
def cart_load(bank: CartBank, cart: int, crank_rad: float, direction: float) -> CartLoad:
    """Return rod force, guide reactions and moment of one cart at a crank angle, without inertia.

    ``direction`` is the sign of the shaft's speed.  Reversing: process force and friction go with the travel,
    ``s = sign(sin(psi + beta)) direction``; the other kinds keep s = +1 as (12) does.
    """
    psi = crank_rad + bank.carts[cart, OFFSET]
    sine, cosine = sin(psi), cos(psi)
    motion = cart_motion(bank, sine, cosine)
    if bank.load == NONE:
        front, rear = guide_reactions(bank, cart, motion.rod_sine, 0.0, 1.0, 0.0)
        return CartLoad(0.0, front, rear, 0.0)
    side = 1.0 if sin(psi + direction * LOOK_AHEAD_RAD) >= 0.0 else -1.0
    sense = side * direction if bank.load == REVERSING else 1.0
    force = rod_force(bank, cart, motion.rod_sine, motion.rod_cosine, sense)
    front, rear = guide_reactions(bank, cart, motion.rod_sine, force, sense, 1.0)
    return CartLoad(force, front, rear, cart_moment(bank, force, motion, sine, cosine, side, direction))


@kernel
def sides_of_travel(bank: CartBank, crank_rad: float, sides: NDArray[np.float64]) -> tuple[float, float]:
    """Fill ``sides`` with the half turn of each cart; return the crank angles (rad) of the dead centres either side.

    At these dead centres the moment of every load but ``printed`` has a kink.
    """
    low, high = -1e300, 1e300
    for cart in range(bank.carts.shape[0]):
        offset = bank.carts[cart, OFFSET]
        half = np.floor((crank_rad + offset) / pi)
        sides[cart] = 1.0 if half % 2.0 == 0.0 else -1.0
        low = max(low, half * pi - offset)
        high = min(high, (half + 1.0) * pi - offset)
    return low, high


@kernel
def plain_terms(
    carts: NDArray[np.float64],
    crank_m: float,
    ratio: float,
    friction: float,
    load: int,
    crank_rad: float,
    sides: NDArray[np.float64],
    direction: float,
) -> tuple[float, float, float]:
    """Return sum m_B x'^2, sum m_B x' x'' and M_p2 for exact kinematics and signed friction.

    The same as `shaft_terms`, without a branch in the loop that the compiler could not lift out: twice as fast.
    """
    inertia, slope, moment = 0.0, 0.0, 0.0
    shaft_sine, shaft_cosine = sin(crank_rad), cos(crank_rad)
    reverses = 1.0 if load == REVERSING else 0.0
    one_way = 1.0 if load in (RECTIFIED, RESIST) else 0.0
    for cart in range(carts.shape[0]):
        sine = shaft_sine * carts[cart, COSINE] + shaft_cosine * carts[cart, SINE]
        cosine = shaft_cosine * carts[cart, COSINE] - shaft_sine * carts[cart, SINE]
        rod_cosine = sqrt(1.0 - ratio * ratio * sine * sine)
        secant = 1.0 / rod_cosine
        turn = sine * cosine * secant
        x1 = -crank_m * (sine + ratio * turn)
        x2 = -crank_m * (cosine + ratio * secant * (cosine * cosine - sine * sine + ratio * ratio * turn * turn))
        inertia += carts[cart, MASS] * x1 * x1
        slope += carts[cart, MASS] * x1 * x2
        if load != NONE:
            sense = 1.0 + reverses * (sides[cart] * direction - 1.0)
            factor = 1.0 + one_way * (copysign(sides[cart], sides[cart] * carts[cart, PULL]) - 1.0)
            arm = crank_m * sine * (rod_cosine + ratio * cosine)
            moment += factor * sense * carts[cart, PULL] * arm / (rod_cosine - sense * friction * ratio * sine)
    return inertia, slope, direction * moment if load == RESIST else moment


@kernel
def branching_terms(
    bank: CartBank, crank_rad: float, sides: NDArray[np.float64], direction: float
) -> tuple[float, float, float]:
    """Return what `shaft_terms` does, for every kinematics and friction."""
    inertia, slope, moment = bank.crank_inertia_kg_m2, 0.0, 0.0
    shaft_sine, shaft_cosine = sin(crank_rad), cos(crank_rad)
    carts, r, ratio = bank.carts, bank.crank_m, bank.ratio
    reversing, one_way = bank.load == REVERSING, bank.load in (RECTIFIED, RESIST)
    for cart in range(carts.shape[0]):
        sine = shaft_sine * carts[cart, COSINE] + shaft_cosine * carts[cart, SINE]
        cosine = shaft_cosine * carts[cart, COSINE] - shaft_sine * carts[cart, SINE]
        motion = cart_motion(bank, sine, cosine)
        inertia += carts[cart, MASS] * motion.x1 * motion.x1
        slope += carts[cart, MASS] * motion.x1 * motion.x2
        if bank.load != NONE:
            sense = sides[cart] * direction if reversing else 1.0
            if carts[cart, ABSOLUTE] == 0.0:
                force = sense * carts[cart, PULL] / (motion.rod_cosine - sense * bank.friction * motion.rod_sine)
            else:
                force = rod_force(bank, cart, motion.rod_sine, motion.rod_cosine, sense)
            part = force * r * sine * (motion.rod_cosine + ratio * cosine)
            if one_way:
                part = part * sides[cart] if force >= 0.0 else -part * sides[cart]
            moment += part
    if bank.load == RESIST:
        moment *= direction
    return inertia, slope, moment


@kernel
def shaft_terms(
    bank: CartBank, crank_rad: float, sides: NDArray[np.float64], direction: float
) -> tuple[float, float, float]:
    """Return J_p2 (kg m^2), half its derivative (kg m^2/rad) and the load moment M_p2 (N m) of all carts.

    ``J_p2 = J_k + sum m_B x'^2`` and ``sum m_B x' x''``; the sides are given, so that a moment with a kink can be
    continued smoothly beyond it.
    """
    if bank.plain:
        inertia, slope, moment = plain_terms(
            bank.carts, bank.crank_m, bank.ratio, bank.friction, bank.load, crank_rad, sides, direction
        )
        return inertia + bank.crank_inertia_kg_m2, slope, moment
    return branching_terms(bank, crank_rad, sides, direction)


@kernel
def load_moment(bank: CartBank, crank_rad: float, direction: float) -> float:
    """Return the load moment M_p2 of all carts (N m) at a crank angle, turning in ``direction``."""
    total = 0.0
    for cart in range(bank.carts.shape[0]):
        total += cart_load(bank, cart, crank_rad, direction).moment_nm
    return total


@kernel
def load_moments(bank: CartBank, crank_rad: NDArray[np.float64], direction: float) -> NDArray[np.float64]:
    """Return the load moments (N m) at many crank angles (rad)."""
    moments = np.empty(crank_rad.size)
    for index in range(crank_rad.size):
        moments[index] = load_moment(bank, crank_rad[index], direction)
    return moments


@kernel
def has_kinks(bank: CartBank) -> bool:
    """Return whether the load moment has kinks at the dead centres."""
    return bank.load not in (NONE, PRINTED)


@kernel
def holds_at_rest(bank: CartBank) -> bool:
    """Return whether the load is one that opposes the motion, and so holds the shaft at rest."""
    return bank.load in (REVERSING, RESIST)

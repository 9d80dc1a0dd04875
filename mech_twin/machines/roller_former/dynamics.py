r"""Motion of the roller former: two masses and all carts, and the rates of their state.

::

    M_p1 --> (J_p1, phi1) ==[ c, k ]== (J_p2(phi2), phi2) <-- M_p2(phi2)

    J_p1 phi1'' = M_p1 - T,   J_p2 phi2'' + phi2'^2 sum m_B x' x'' = T - M_p2,   T = c (phi1 - phi2) + k (phi1' - phi2')

State: crank angle phi2, twist phi1 - phi2, crank speed, twist rate, and three works (motor, damping, load) that make
the energy book.  Twist instead of phi1, so that a twist of 1e-4 rad keeps its digits after many turns.

Source: LoveikinRoller2018 eq. (40).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.cart_parameters import CartBank
from mech_twin.machines.roller_former.cart_statics import (
    branching_terms,
    plain_terms,
    shaft_terms,
)
from mech_twin.parts.induction_motor import MotorConstants, motor_torque

CRANK, TWIST, SPEED, TWIST_RATE, MOTOR_WORK, DAMPING_WORK, LOAD_WORK = range(7)
SIZE = 7
DIRECTION, ENGAGED, SHARE, SLOW, STALLED, TRIAL_STEP = range(6)
MODES = 6
EVENT_ROWS = 64


class Former(NamedTuple):
    """All the kernels need: carts, motor, drive, start and stall thresholds, tolerance and scales of the state."""

    bank: CartBank
    motor: MotorConstants
    motor_inertia_kg_m2: float
    stiffness_nm_per_rad: float
    damping_nms_per_rad: float
    ratio: float
    efficiency: float
    engage_speed_rad_per_s: float
    load_rise_s: float
    slow_speed_rad_per_s: float
    stall_time_s: float
    tolerance: float
    scales: tuple[float, float, float, float, float, float, float]


class Torque(NamedTuple):
    """Motor torque during a stretch: from the speed itself (``coupled``), or a straight line in time (N m, N m/s)."""

    coupled: bool
    command: float
    value_nm: float
    slope_nm_per_s: float
    origin_s: float


class Stretch(NamedTuple):
    """What stays as it is until the next event: travel direction, load share and its rate, the dead centres ahead."""

    start_s: float
    direction: float
    share: float
    share_rate: float
    low_rad: float
    high_rad: float
    forward_nm: float
    backward_nm: float


@kernel
def motor_moment(former: Former, torque: Torque, t: float, speed: float) -> float:
    """Return the motor's moment at the crank, ``M u eta`` (N m), at a time and a speed of the first mass."""
    if torque.coupled:
        shaft = motor_torque(former.motor, speed * former.ratio, torque.command)
    else:
        shaft = torque.value_nm + torque.slope_nm_per_s * (t - torque.origin_s)
    return shaft * former.ratio * former.efficiency


@kernel
def coupling_moment(former: Former, y: NDArray[np.float64]) -> float:
    """Return ``T = c (phi1 - phi2) + k (phi1' - phi2')`` (N m)."""
    return float(former.stiffness_nm_per_rad * y[TWIST] + former.damping_nms_per_rad * y[TWIST_RATE])


@kernel
def kinetic_and_elastic(former: Former, y: NDArray[np.float64], sides: NDArray[np.float64]) -> float:
    """Return the kinetic and elastic energy of the state (J)."""
    inertia, _, _ = shaft_terms(former.bank, y[CRANK], sides, 1.0)
    first = y[SPEED] + y[TWIST_RATE]
    return float(
        0.5 * former.motor_inertia_kg_m2 * first * first
        + 0.5 * inertia * y[SPEED] * y[SPEED]
        + 0.5 * former.stiffness_nm_per_rad * y[TWIST] * y[TWIST]
    )


@kernel
def rates(
    former: Former,
    torque: Torque,
    stretch: Stretch,
    sides: NDArray[np.float64],
    t: float,
    y: NDArray[np.float64],
    out: NDArray[np.float64],
    row: int,
) -> None:
    """Fill a row of ``out`` with the time derivative of the state; direction 0 is a crank held by its load."""
    speed, rate = y[SPEED], y[TWIST_RATE]
    moment = motor_moment(former, torque, t, speed + rate)
    transmitted = coupling_moment(former, y)
    load, acceleration = transmitted, 0.0
    if stretch.direction != 0.0:
        bank = former.bank
        if bank.plain:  # called here and not through shaft_terms, so that the compiler puts it in line
            inertia, slope, full = plain_terms(
                bank.carts, bank.crank_m, bank.ratio, bank.friction, bank.load, y[CRANK], sides, stretch.direction
            )
            inertia += bank.crank_inertia_kg_m2
        else:
            inertia, slope, full = branching_terms(bank, y[CRANK], sides, stretch.direction)
        load = full * (stretch.share + stretch.share_rate * (t - stretch.start_s))
        acceleration = (transmitted - load - speed * speed * slope) / inertia
    out[row, CRANK] = speed
    out[row, TWIST] = rate
    out[row, SPEED] = acceleration
    out[row, TWIST_RATE] = (moment - transmitted) / former.motor_inertia_kg_m2 - acceleration
    out[row, MOTOR_WORK] = moment * (speed + rate)
    out[row, DAMPING_WORK] = former.damping_nms_per_rad * rate * rate
    out[row, LOAD_WORK] = load * speed

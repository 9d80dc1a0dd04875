# SPDX-License-Identifier: Apache-2.0
"""Stroke of a press design: crank angles of first contact and bottom, heights, mean force; all exact."""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.compaction_press.design_problem import Duty
from mech_twin.machines.compaction_press.dynamics import Press, loaded_height
from mech_twin.parts.four_bar import FourBar, acute_angles, position

TURN = 2.0 * math.pi
POSITIONS = 72  # of the crank, between two of which an extreme is sought
ROOT_STEPS = 60


class PressStroke(NamedTuple):
    """Crank angles (rad) of the bottom and of first contact, angle between them (rad), and heights (m)."""

    bottom: float
    contact: float
    way: float
    top_y: float
    contact_y: float
    bottom_y: float


@kernel
def _miss(press: Press, f: float, height: float, rate: bool) -> float:
    y, y1 = loaded_height(press, f)
    return y1 if rate else y - height


@kernel
def path_root(press: Press, low: float, high: float, height: float, rate: bool) -> float:
    """Return the crank angle (rad) between two others at which the loaded point passes ``height`` (m).

    With ``rate`` that of its extreme height.  Illinois method; without a change of sign the middle.
    """
    at_low, at_high = _miss(press, low, height, rate), _miss(press, high, height, rate)
    if at_low * at_high > 0.0:
        return 0.5 * (low + high)
    for _ in range(ROOT_STEPS):
        if abs(high - low) < 1e-14 or at_high == at_low:
            break
        middle = high - at_high * (high - low) / (at_high - at_low)
        at_middle = _miss(press, middle, height, rate)
        if at_middle * at_high <= 0.0:
            low, at_low = high, at_high
        else:
            at_low *= 0.5
        if abs(middle - high) < 1e-15:
            break
        high, at_high = middle, at_middle
    return high


@kernel
def exact_stroke(press: Press, duty: Duty, top_way: float, bottom_way: float) -> PressStroke:
    """Return the stroke with every angle and height exact, from the angles of the highest and lowest sample (rad)."""
    direction = 1.0 if duty.speed_rad_per_s >= 0.0 else -1.0
    step = TURN / POSITIONS
    top = path_root(press, direction * top_way - step, direction * top_way + step, 0.0, True)
    bottom = path_root(press, direction * bottom_way - step, direction * bottom_way + step, 0.0, True)
    top_y, _ = loaded_height(press, top)
    bottom_y, _ = loaded_height(press, bottom)
    contact_y = top_y - duty.contact_fraction * (top_y - bottom_y)
    if math.isnan(duty.contact_fraction):
        contact_y, _ = loaded_height(press, math.pi)
    down = direction * ((direction * (bottom - top)) % TURN)
    contact = path_root(press, top, top + down, contact_y, False) if contact_y < top_y else top
    return PressStroke(bottom, contact, abs(top + down - contact), top_y, contact_y, bottom_y)


@kernel
def mean_press_force(stroke: PressStroke, constant_torque_nm: float) -> float:
    """Return the mean force (N) over the contact travel at a constant drive torque: torque times angle over travel.

    The work on the layer at that mean force equals the work of the drive from first contact to the bottom.
    """
    return constant_torque_nm * stroke.way / (stroke.contact_y - stroke.bottom_y)


@kernel
def bottom_angles(bar: FourBar, bottom: float) -> tuple[float, float]:
    """Return gamma and alpha at the bottom of the stroke (rad)."""
    alpha, _, gamma = acute_angles(position(bar, bottom))
    return gamma, alpha

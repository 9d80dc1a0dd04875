# SPDX-License-Identifier: Apache-2.0
"""Motion of the vibration crank: its state, equations of motion at a prescribed speed and behind a motor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.compiled_steps import step_of
from mech_twin.engine.crank_motion import DRIVE_POWER, ShaftDrive, crank_rates, shaft_state
from mech_twin.engine.crank_state import (
    driven_system,
    led_system,
    mechanism_load_speed,
    mechanism_load_work,
    mechanism_state,
    under_load_share,
)
from mech_twin.engine.integration import rates_of
from mech_twin.engine.tableaus import DORMAND_PRINCE_8
from mech_twin.machines.vibration_crank.slider_crank import (
    FINITE_ROD,
    SliderCrank,
    drive_moment,
    follower,
    pin_forces,
    reduced,
    rod_error,
)
from mech_twin.machines.vibration_crank.slider_crank import stored_energy as energy

Array = NDArray[np.float64]


class ShakingCrank(NamedTuple):
    """The mechanism of the linkage role."""

    slider: SliderCrank


@step_of(mechanism_state, ShakingCrank)
def crank_state(
    mechanism: ShakingCrank, f: float, w: float, e: float, regime: int
) -> tuple[tuple[float, float, float], tuple[float, float, float], float, float, float]:
    """Return positions and rates of crank, rod, follower; crank torque (N m), energy (J), miss of the rod (m)."""
    s = mechanism.slider
    at = follower(s, f)
    a_x, a_y = s.crank_m * math.cos(f), s.crank_m * math.sin(f)
    rod, rod_rate = 0.5 * math.pi, 0.0
    if s.kind >= FINITE_ROD:
        x, y = at.x - a_x, at.y - a_y
        rod = math.atan2(y, x)
        if s.kind == FINITE_ROD:
            v_x, v_y = a_y * w, (at.z1 - a_x) * w
        else:
            v_x = (-(at.y - s.pivot_y_m) * at.z1 + a_y) * w
            v_y = ((at.x - s.pivot_x_m) * at.z1 - a_x) * w
        rod_rate = (x * v_y - y * v_x) / (s.rod_m * s.rod_m)
    return (f, rod, at.z), (w, rod_rate, at.z1 * w), drive_moment(s, f, w, e), energy(s, f, w), rod_error(s, f)


@step_of(mechanism_load_work, ShakingCrank)
def crank_load_work(mechanism: ShakingCrank, before: float, after: float, regime: int) -> float:
    """Return 0: weights and working force have a potential."""
    return 0.0


@step_of(mechanism_load_speed, ShakingCrank)
def crank_load_speed(mechanism: ShakingCrank, f: float, w: float) -> float:
    """Return the speed of the follower (m/s, or rad/s of a boom)."""
    return follower(mechanism.slider, f).z1 * w


class LedCrank(NamedTuple):
    """The mechanism at a prescribed speed: angle (rad), speed (rad/s) at time 0, acceleration (rad/s2)."""

    mechanism: SliderCrank
    f: float
    w: float
    e: float
    regime: int


@rates_of(LedCrank, DORMAND_PRINCE_8)
def led_crank_power(led: LedCrank, t: float, y: Array, out: Array) -> None:
    """Fill in the power of the drive (W), from the moment that the pin forces give."""
    w = led.w + led.e * t
    out[DRIVE_POWER] = pin_forces(led.mechanism, led.f + (led.w + 0.5 * led.e * t) * t, w, led.e).moment * w


class DrivenSliderCrank(NamedTuple):
    """The mechanism behind a motor."""

    mechanism: SliderCrank
    drive: ShaftDrive
    regime: int


@rates_of(DrivenSliderCrank, DORMAND_PRINCE_8)
def driven_crank_rates(driven: DrivenSliderCrank, t: float, y: Array, out: Array) -> None:
    """Fill in the rates of crank angle, speed, drive work, gear loss and friction loss."""
    inertia, slope, load = reduced(driven.mechanism, shaft_state(y).angle_rad)
    crank_rates(driven.drive, t, y, inertia, slope, load, out)


@step_of(led_system, ShakingCrank)
def led_crank(mechanism: ShakingCrank, f: float, w: float, e: float, regime: int) -> LedCrank:
    """Return the mechanism at a prescribed speed."""
    return LedCrank(mechanism.slider, f, w, e, regime)


@step_of(driven_system, ShakingCrank)
def driven_crank(mechanism: ShakingCrank, drive: ShaftDrive, regime: int) -> DrivenSliderCrank:
    """Return the mechanism behind a motor."""
    return DrivenSliderCrank(mechanism.slider, drive, regime)


@step_of(under_load_share, ShakingCrank)
def whole_load(mechanism: ShakingCrank, share: float) -> ShakingCrank:
    """Return the mechanism: no load of it only resists, so the share is always 1."""
    return mechanism

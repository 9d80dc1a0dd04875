# SPDX-License-Identifier: Apache-2.0
"""What is integrated of a crank linkage: the drive's power at a prescribed speed, the shaft's motion behind a motor.

Both are systems of `engine.integration` over any mechanism of `crank_state`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from mech_twin.engine.crank_motion import DRIVE_POWER, ShaftDrive, crank_rates, shaft_state
from mech_twin.engine.crank_state import mechanism_drive_moment, mechanism_reduced
from mech_twin.engine.integration import rates_of
from mech_twin.engine.sample_vectors import Array
from mech_twin.engine.tableaus import DORMAND_PRINCE_8


class LedMechanism(NamedTuple):
    """A mechanism at a prescribed speed: angle (rad), speed (rad/s) at time 0, acceleration (rad/s2), regime."""

    mechanism: Any
    f: float
    w: float
    e: float
    regime: int


@rates_of(LedMechanism, DORMAND_PRINCE_8)
def drive_power(led: LedMechanism, t: float, y: Array, out: Array) -> None:
    """Fill in the power of the drive (W), from the moment that the pin forces give.

    The load's work is in closed form and the energy from the reduced inertia, so the balance compares three routes.
    """
    w, f = led.w + led.e * t, led.f + (led.w + 0.5 * led.e * t) * t
    out[DRIVE_POWER] = mechanism_drive_moment(led.mechanism, f, w, led.e, led.regime) * w


class DrivenMechanism(NamedTuple):
    """A mechanism behind a motor, and its regime."""

    mechanism: Any
    drive: ShaftDrive
    regime: int


@rates_of(DrivenMechanism, DORMAND_PRINCE_8)
def driven_rates(driven: DrivenMechanism, t: float, y: Array, out: Array) -> None:
    """Fill in the rates of crank angle, speed, drive work, gear loss and friction loss."""
    inertia, slope, moment = mechanism_reduced(driven.mechanism, shaft_state(y).angle_rad, driven.regime)
    crank_rates(driven.drive, t, y, inertia, slope, moment, out)

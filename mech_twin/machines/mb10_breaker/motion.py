"""The breaker between two events as a system of the engine: equation of motion, method, signals of its events."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.events import UNKNOWN, signals_of
from mech_twin.engine.integration import Workspace, rates_of
from mech_twin.engine.tableaus import COOPER_VERNER_8
from mech_twin.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    EXTRA,
    PHI,
    STATES,
    Breaker,
    P,
    Q,
    U,
    accelerations,
    crank_torque,
    derivatives,
    masses_at,
    striker,
)

GAP, LIFT, COLLAR, EXTREME = 0, 1, 2, 3  # signals: striker from tool, body from collar, collar's moment, dead centre
SINGLE_STEP_RAD = 0.04  # longest turn of the crank in one substep: truncation below 1e-13
LONGEST_SUBSTEP_S = 5e-4


class Motion(NamedTuple):
    """The breaker under a motor torque (N m) that is a line in the time since the start of the coupling step."""

    breaker: Breaker
    torque_nm: float
    slope_nm_per_s: float
    rests: bool
    extreme_rad: float  # crank angle of the striking extreme ahead


@rates_of(Motion, COOPER_VERNER_8)
def motion_rates(system: Motion, t: float, y: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Fill the derivatives of the state."""
    derivatives(system.breaker, y, system.torque_nm + system.slope_nm_per_s * t, system.rests, out)


@signals_of(Motion)
def motion_signals(system: Motion, index: int, t: float, y: NDArray[np.float64]) -> tuple[float, float]:
    """Return value and derivative of a signal: each falls through zero at its event."""
    b = system.breaker
    if index == GAP:
        travel, slope, _ = striker(b, y[Q])
        return b.radius * y[PHI] - travel, b.radius * y[P] - slope * y[U]
    if index == LIFT:
        return float(y[PHI]), float(y[P])
    if index == EXTREME:
        return float(system.extreme_rad - y[Q]), -float(y[U])
    return collar_moment(b, y, system.torque_nm + system.slope_nm_per_s * t), UNKNOWN


@kernel
def collar_moment(b: Breaker, y: NDArray[np.float64], torque: float) -> float:
    """Return the moment R with which the collar holds a resting body (N m)."""
    drive = crank_torque(b, torque, y[U], y[P]) + y[EXTRA]
    return accelerations(b, masses_at(b, y[Q], y[PHI]), y[U], y[PHI], y[P], drive, True)[2]


@kernel
def substep(u: float, remaining: float) -> float:
    """Return the length of the next substep (s): equal pieces of what remains, short in time and in crank angle."""
    longest = min(LONGEST_SUBSTEP_S, SINGLE_STEP_RAD / (abs(u) + 1e-9))
    return remaining / max(math.ceil(remaining / longest - 1e-9), 1)


@kernel
def workspace_of_motion() -> Workspace:
    """Return room for the steps of one coupling step."""
    return Workspace(np.empty((len(COOPER_VERNER_8.nodes), STATES)), np.empty(STATES), np.empty(STATES))

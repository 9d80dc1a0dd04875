# SPDX-License-Identifier: Apache-2.0
"""The vibration crank as a mechanism of the crank linkage: its state, and inertia and moment reduced to its crank.

Its force analysis gives every pin force and the force on the frame, from the linkage's sample.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.compiled_steps import Work, force_step, step_of
from mech_twin.engine.crank_linkage import route_miss
from mech_twin.engine.crank_state import (
    mechanism_drive_moment,
    mechanism_load_speed,
    mechanism_load_work,
    mechanism_reduced,
    mechanism_state,
    memory_of,
    under_load_share,
)
from mech_twin.engine.sample_vectors import LINKAGE_JOINTS
from mech_twin.kernels.kernel import borrowing_kernel
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

QUANTITIES = (
    "reduced_inertia_kg_m2",
    "reduced_inertia_slope_kg_m2_per_rad",
    "reduced_moment_nm",
    "crank_acceleration_rad_per_s2",
    "drive_torque_nm",
    "drive_torque_without_counterweight_nm",
    "drive_power_w",
    "shaking_force_x_n",
    "shaking_force_y_n",
    "shaking_force_n",
)
Array = NDArray[np.float64]


class LoadedCrank(NamedTuple):
    """Constants of the force analysis: mechanism, also without its counterweight; largest torque of a cycle (N m)."""

    mechanism: SliderCrank
    unbalanced: SliderCrank
    moment_scale_nm: float


@step_of(force_step, LoadedCrank, borrowing_kernel)
def crank_forces(
    model: LoadedCrank, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with the pin forces at the crank's angle, rate and acceleration, and its torque by both routes."""
    memory, s = memory_of(linkage, 3), model.mechanism
    th, w, torque = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], linkage[LINKAGE_JOINTS + 2]
    inertia, slope, load = reduced(s, th)
    e = memory.crank_acceleration_rad_per_s2
    at = pin_forces(s, th, w, e)
    size = (at.frame_x * at.frame_x + at.frame_y * at.frame_y) ** 0.5
    numbers = (
        0.0,
        at.bearing_x, at.bearing_y, 0.0,
        at.pin_x, at.pin_y, 0.0,
        at.pin_x, at.pin_y, 0.0,
        at.ground_x, at.ground_y, at.ground_moment,
        inertia,
        slope,
        load,
        e,
        torque,
        drive_moment(model.unbalanced, th, w, e),
        torque * w,
        at.frame_x,
        at.frame_y,
        size,
    )  # fmt: skip
    for i in range(len(numbers)):
        out[i] = numbers[i]
    out[len(numbers)] = route_miss(at.moment, torque, inertia, memory, model.moment_scale_nm)
    return 0


class ShakingCrank(NamedTuple):
    """The mechanism of the linkage role."""

    slider: SliderCrank


@step_of(mechanism_state, ShakingCrank)
def crank_state(
    mechanism: ShakingCrank, f: float, w: float, e: float, regime: int
) -> tuple[tuple[float, float, float], tuple[float, float, float], float, float, float]:
    """Return positions and rates of crank, rod, follower; crank torque (N m), energy (J), rod length error (m)."""
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


@step_of(mechanism_drive_moment, ShakingCrank)
def crank_drive_moment(mechanism: ShakingCrank, f: float, w: float, e: float, regime: int) -> float:
    """Return the moment (N m) at the crank that the pin forces give."""
    return pin_forces(mechanism.slider, f, w, e).moment


@step_of(mechanism_reduced, ShakingCrank)
def crank_reduced(mechanism: ShakingCrank, f: float, regime: int) -> tuple[float, float, float]:
    """Return inertia (kg m2), its slope (kg m2/rad) and moment (N m) reduced to the crank."""
    return reduced(mechanism.slider, f)


@step_of(under_load_share, ShakingCrank)
def whole_load(mechanism: ShakingCrank, share: float) -> ShakingCrank:
    """Return the mechanism unchanged: it has no purely resisting load, so the share is always 1."""
    return mechanism

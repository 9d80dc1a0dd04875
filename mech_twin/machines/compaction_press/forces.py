# SPDX-License-Identifier: Apache-2.0
"""Force analysis of the press: every pin force, gains and reduced quantities, from the linkage's sample alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

from mech_twin.engine.compiled_steps import force_step, step_of
from mech_twin.engine.crank_forces import CrankForces, route_miss
from mech_twin.engine.crank_state import memory_of
from mech_twin.engine.sample_vectors import LINKAGE_JOINTS, REGIME, Array
from mech_twin.machines.compaction_press.cycle import gains
from mech_twin.machines.compaction_press.dynamics import Press, press_pins, press_reduced, with_load_share
from mech_twin.parts.four_bar import acute_angles, coefficients, motion, position

QUANTITIES = (
    "alpha_rad",
    "beta_rad",
    "gamma_rad",
    "plate_acceleration_rad_per_s2",
    "pendulum_acceleration_rad_per_s2",
    "crank_acceleration_rad_per_s2",
    "reduced_inertia_kg_m2",
    "reduced_inertia_slope_kg_m2_per_rad",
    "reduced_moment_nm",
    "drive_torque_nm",
    "drive_power_w",
    "working_force_n",
    "loaded_point_height_m",
    "loaded_point_speed_m_per_s",
    "gain_k1",
    "gain_k2",
    "gain_paper",
    "gain_normal",
    "gain_vertical",
    "shaking_force_x_n",
    "shaking_force_y_n",
)

LARGEST_GAIN = 1e300  # of the paper's gain, which has no limit where the pendulum's end is at rest


class LoadedPress(NamedTuple):
    """Constants of the force analysis: the press, and the largest drive torque of a cycle (N m)."""

    press: Press
    moment_scale_nm: float


@step_of(force_step, LoadedPress)
def press_forces(
    model: LoadedPress, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array
) -> tuple[Array, int]:
    """Fill ``out`` with the pin forces at the crank's angle, rate and acceleration, and its torque by both routes."""
    memory = memory_of(linkage, 3)
    press = with_load_share(model.press, memory.load_share)
    f, w, torque = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], linkage[LINKAGE_JOINTS + 2]
    now = press_reduced(press, f, int(linkage[REGIME]))
    e = memory.crank_acceleration_rad_per_s2
    at = position(press.bar, f)
    by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, e)
    pins = press_pins(press, f, w, e, now.force)
    k1, k2, normal, vertical = gains(press, f)
    alpha, beta, gamma = acute_angles(at)
    numbers = (
        0.0,
        pins.o_x, pins.o_y, 0.0,
        pins.a_x, pins.a_y, 0.0,
        pins.b_x, pins.b_y, 0.0,
        pins.c_x, pins.c_y, 0.0,
        alpha,
        beta,
        gamma,
        by.e2,
        by.e3,
        e,
        now.inertia,
        now.slope,
        now.moment,
        torque,
        torque * w,
        now.force,
        now.y,
        now.y1 * w,
        k1,
        k2,
        min(k1 * k2, LARGEST_GAIN),
        normal,
        vertical,
        -pins.o_x - pins.c_x,
        -pins.o_y - pins.c_y,
    )  # fmt: skip
    for i in range(len(numbers)):
        out[i] = numbers[i]
    out[len(numbers)] = route_miss(pins.moment, torque, now.inertia, memory, model.moment_scale_nm)
    return loads, 0


@dataclass(frozen=True)
class PressForces(CrankForces):
    """Every pin force from one equilibrium of the dyad, then the crank; pins named as in every four-bar."""

    QUANTITIES: ClassVar = QUANTITIES
    press: Press
    moment_scale: float
    pins: tuple[str, ...] = ("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing")
    acts_on: tuple[str, ...] = ("crank", "plate", "plate", "pendulum")

    @cached_property
    def model(self) -> LoadedPress:
        """Constants of the kernel."""
        return LoadedPress(self.press, float(self.moment_scale))

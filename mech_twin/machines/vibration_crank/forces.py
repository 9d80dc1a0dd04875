# SPDX-License-Identifier: Apache-2.0
"""Force analysis of the vibration crank: every pin force and the force on the frame, from the linkage's sample."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

from mech_twin.engine.compiled_steps import force_step, step_of
from mech_twin.engine.crank_forces import CrankForces, route_miss
from mech_twin.engine.crank_state import memory_of
from mech_twin.engine.sample_vectors import LINKAGE_JOINTS, Array
from mech_twin.machines.vibration_crank.slider_crank import SliderCrank, drive_moment, pin_forces, reduced

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


class LoadedCrank(NamedTuple):
    """Constants of the force analysis: mechanism, also without its counterweight; largest torque of a cycle (N m)."""

    mechanism: SliderCrank
    unbalanced: SliderCrank
    moment_scale_nm: float


@step_of(force_step, LoadedCrank)
def crank_forces(
    model: LoadedCrank, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array
) -> tuple[Array, int]:
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
    return loads, 0


@dataclass(frozen=True)
class SliderCrankForces(CrankForces):
    """Every pin force from equilibrium of follower, rod and crank."""

    QUANTITIES: ClassVar = QUANTITIES
    mechanism: SliderCrank
    moment_scale: float
    pins: tuple[str, ...]
    acts_on: tuple[str, ...]

    @cached_property
    def model(self) -> LoadedCrank:
        """Constants of the kernel."""
        return LoadedCrank(self.mechanism, self.mechanism._replace(counter_mass=0.0), float(self.moment_scale))

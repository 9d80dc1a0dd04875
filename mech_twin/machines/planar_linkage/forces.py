# SPDX-License-Identifier: Apache-2.0
"""Force analysis of the planar linkage: every pin force and the force on the frame, from the linkage's sample."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import force_step, step_of
from mech_twin.engine.crank_forces import CrankForces, route_miss
from mech_twin.engine.crank_state import memory_of
from mech_twin.engine.sample_vectors import LINKAGE_JOINTS, REGIME, Array
from mech_twin.machines.planar_linkage.chain import CRANK
from mech_twin.machines.planar_linkage.dynamics import TurnedLinkage, with_load_share
from mech_twin.machines.planar_linkage.linkage import PlanarLinkage, is_working, reduced
from mech_twin.machines.planar_linkage.pins import pin_forces

QUANTITIES = (
    "reduced_inertia_kg_m2",
    "reduced_inertia_slope_kg_m2_per_rad",
    "reduced_moment_nm",
    "crank_acceleration_rad_per_s2",
    "drive_torque_nm",
    "drive_power_w",
    "working_force_n",
    "shaking_force_x_n",
    "shaking_force_y_n",
    "shaking_force_n",
)
ROUNDING = 1e-5  # of moments that cancel, of the crank's centrifugal force or of pins: less of a torque is lost in them


class LoadedLinkage(NamedTuple):
    """Constants of the force analysis: the linkage, and the largest torque of a cycle (N m)."""

    mechanism: TurnedLinkage
    moment_scale_nm: float


@step_of(force_step, LoadedLinkage)
def linkage_forces(
    model: LoadedLinkage, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array
) -> tuple[Array, int]:
    """Fill in the pin forces at the angle, rate and acceleration of the crank, and its torque by both routes."""
    memory = memory_of(linkage, len(model.mechanism.chain.masses.mass_kg) - 1)
    f, w, torque = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], linkage[LINKAGE_JOINTS + 2]
    regime, e = int(linkage[REGIME]), memory.crank_acceleration_rad_per_s2
    p = with_load_share(model.mechanism, memory.load_share).chain
    by = reduced(p, f, regime)
    at = pin_forces(p, f, w, e, regime)
    out[0] = 0.0
    place = 1
    for pin in range(len(at.x)):
        out[place], out[place + 1], out[place + 2] = at.x[pin], at.y[pin], at.moment[pin]
        place += 3
    numbers = (
        by.inertia,
        by.slope,
        by.moment,
        e,
        torque,
        torque * w,
        p.stroke.force_n if is_working(regime) else 0.0,
        at.shaking_x,
        at.shaking_y,
        np.hypot(at.shaking_x, at.shaking_y),
    )
    for i in range(len(numbers)):
        out[place + i] = numbers[i]
    arm = np.hypot(p.masses.along_m[CRANK], p.masses.across_m[CRANK])
    cancelling = max(p.masses.mass_kg[CRANK] * (w * arm) ** 2, at.balanced_nm)
    scale = max(model.moment_scale_nm, ROUNDING * cancelling)
    out[place + len(numbers)] = route_miss(at.drive_nm, torque, by.inertia, memory, scale)
    return loads, 0


@dataclass(frozen=True)
class LinkageForces(CrankForces):
    """Every pin force, from equilibrium of the links."""

    QUANTITIES: ClassVar = QUANTITIES
    mechanism: PlanarLinkage
    moment_scale: float
    pins: tuple[str, ...]
    acts_on: tuple[str, ...]

    @cached_property
    def model(self) -> LoadedLinkage:
        """Constants of the kernel."""
        return LoadedLinkage(TurnedLinkage(self.mechanism), float(self.moment_scale))

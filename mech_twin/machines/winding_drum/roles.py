# SPDX-License-Identifier: Apache-2.0
"""Roles of the winding drum: the linkage that owns the package, and its force analysis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_roles import CompiledForces, CompiledLinkage
from mech_twin.engine.sample_vectors import EventLayout, ForceLayout, LinkageLayout
from mech_twin.machines.winding_drum.drum_row import FAILURES, Drum, DrumMemory, DrumResiduals, LoadedDrum, start_row
from mech_twin.machines.winding_drum.dynamics import Package
from mech_twin.samples import LinkageSample

REGIMES = ("running", "ended", "stuck")
JOINTS = ("drum", "yarn", "package_radius")
QUANTITIES = (
    "acceleration_torque_nm",
    "radius_torque_nm",
    "eccentric_torque_nm",
    "mass_torque_nm",
    "dynamic_torque_nm",
    "gravity_moment_nm",
    "friction_torque_nm",
    "package_radius_m",
    "package_inertia_kg_m2",
    "package_mass_kg",
    "tangent_arm_m",
    "angular_acceleration_rad_per_s2",
    "yarn_acceleration_m_per_s2",
    "drive_power_w",
)


class Place(NamedTuple):
    """Joints of the drum: angle, yarn that has run, radius of the package; and their rates."""

    drum_rad: float
    yarn_m: float
    package_radius_m: float
    drum_rad_per_s: float
    yarn_m_per_s: float


def place_of(sample: LinkageSample) -> Place:
    """Return the joints of a sample by name."""
    drum_rad, yarn_m, radius_m = sample.position
    drum_rad_per_s, yarn_m_per_s, _ = sample.velocity
    return Place(drum_rad, yarn_m, radius_m, drum_rad_per_s, yarn_m_per_s)


@dataclass(frozen=True)
class DrumLinkage(CompiledLinkage):
    """Drum, package and yarn; the package radius is part of its state.

    When the package is empty (or full) yarn and drive let go: the drum coasts under its weight and friction.
    """

    package: Package
    step_s: float
    start_radius_m: float
    end_radius_m: float
    start_speed_m_per_s: float
    start_command: float
    end_kind: str
    joints: tuple[str, ...] = JOINTS
    coordinates: tuple[str, ...] = ("drum",)
    regimes: tuple[str, ...] = REGIMES
    failures: tuple[str, ...] = FAILURES

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the residuals."""
        return dict.fromkeys(DrumResiduals._fields, 1e-9)

    @cached_property
    def model(self) -> Drum:
        """Constants of the kernel."""
        lengths = float(self.start_radius_m), float(self.end_radius_m)
        return Drum(self.package, *lengths, float(self.step_s))

    @cached_property
    def layout(self) -> LinkageLayout:
        """Row of the samples."""
        events = EventLayout((self.end_kind, "stick", "release"), ("package", "drum"), len(self.coordinates))
        return LinkageLayout(self.joints, DrumMemory._fields, DrumResiduals._fields, events)

    def start(self, step: int = 0) -> LinkageSample:
        """Return the package at its initial radius, the yarn at the configured share of its speed."""
        out = np.empty(self.layout.size)
        start_row(self.model, float(self.start_speed_m_per_s), float(self.start_command), out)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())


@dataclass(frozen=True)
class DrumForces(CompiledForces):
    """Torque of the package term by term, and the reaction of the shaft on drum and package.

    The weight of the bare drum and the tension of the yarn are not known and left out.
    """

    package: Package
    start_radius_m: float
    pins: tuple[str, ...] = ("shaft",)
    acts_on: tuple[str, ...] = ("package",)

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the residuals."""
        return {"drive_torque_routes": 1e-10}

    @cached_property
    def model(self) -> LoadedDrum:
        """Constants of the kernel."""
        return LoadedDrum(self.package, float(self.start_radius_m))

    @cached_property
    def layout(self) -> ForceLayout:
        """Row of the samples."""
        return ForceLayout(self.pins, QUANTITIES, ("drive_torque_routes",))

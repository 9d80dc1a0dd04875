# SPDX-License-Identifier: Apache-2.0
"""Roles of the winding drum: the linkage that owns the package, and its force analysis."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_roles import CompiledLinkage
from mech_twin.engine.sample_vectors import EventLayout, ForceLayout, LinkageLayout
from mech_twin.machines.winding_drum.drum_row import FAILURES, Drum, DrumMemory, DrumResiduals, start_row
from mech_twin.samples import LinkageSample

REGIMES = ("running", "ended", "stuck")
JOINTS, COORDINATES = ("drum", "yarn", "package_radius"), ("drum",)
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


RESIDUAL_LIMITS = dict.fromkeys(DrumResiduals._fields, 1e-9)
# the weight of the bare drum and the tension of the yarn are not known and left out
FORCES = ForceLayout(("shaft",), QUANTITIES, ("drive_torque_routes",))


@dataclass(frozen=True)
class DrumLinkage(CompiledLinkage):
    """Drum, package and yarn; the package radius is part of its state.

    When the package is empty (or full) yarn and drive let go: the drum coasts under its weight and friction.
    """

    model: Drum
    step_s: float
    start_speed_m_per_s: float
    start_command: float
    layout: LinkageLayout
    joints = JOINTS
    coordinates = COORDINATES
    regimes = REGIMES
    failures = FAILURES
    residual_limits = RESIDUAL_LIMITS

    def start(self, step: int = 0) -> LinkageSample:
        """Return the package at its initial radius, the yarn at the configured share of its speed."""
        out = np.empty(self.layout.size)
        start_row(self.model, self.start_speed_m_per_s, self.start_command, out)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())


def drum_layout(end_kind: str) -> LinkageLayout:
    """Return the row of the linkage, whose package ends full or empty."""
    events = EventLayout((end_kind, "stick", "release"), ("package", "drum"), len(COORDINATES))
    return LinkageLayout(JOINTS, DrumMemory._fields, DrumResiduals._fields, events)

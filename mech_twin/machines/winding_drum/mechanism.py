# SPDX-License-Identifier: Apache-2.0
"""Frames of the winding drum: the drum, the middle of its package, and the point the yarn leaves at."""

from __future__ import annotations

from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, fixed, sliding, turning
from mech_twin.machines.winding_drum.wound_package import Package


def mechanism(package: Package, largest_radius_m: float) -> FrameTree:
    """Return the frames; ``package`` is turned back to the machine's axes, `yarn_exit` lies a radius above it."""
    middle = (0.0, package.eccentricity_m)
    return FrameTree(
        (
            fixed(ROOT, "shaft"),
            turning("drum", "shaft", "drum"),
            turning("drum", "drum", "package", middle, ratio=-1.0),
            sliding("package_radius", "package", "yarn_exit", (0.0, 1.0), largest_radius_m),
        ),
        (),
        (
            Bar("drum", (0.0, -package.core_m), (0.0, package.core_m), 0.004, (90, 90, 90)),
            Bar("yarn_exit", (-4.0 * package.core_m, 0.0), (0.0, 0.0), 0.002, (60, 90, 180)),
        ),
        ("yarn", "motor"),
        untold=("drum: its mass is not known; that of the yarn on it changes while it winds",),
    )

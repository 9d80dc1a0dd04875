# SPDX-License-Identifier: Apache-2.0
"""Frames of the impact mass: its face, and the stop."""

from __future__ import annotations

from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, Inertia, fixed, sliding
from mech_twin.machines.impact_mass.drawing import MASS_M

TRAVEL_M = 100.0  # a viewer's slider needs an end; the mass has none but the stop


def mechanism(stop_m: float, mass_kg: float) -> FrameTree:
    """Return the face of the mass, which slides along x, and the stop."""
    return FrameTree(
        (sliding("mass", ROOT, "mass", (1.0, 0.0), TRAVEL_M), fixed(ROOT, "stop", (stop_m, 0.0))),
        (),
        (
            Bar("mass", (-MASS_M, 0.0), (0.0, 0.0), MASS_M, (60, 90, 180)),
            Bar("stop", (0.0, -0.15), (0.0, 0.15), 0.012, (90, 90, 90)),
        ),
        ("generator", "phase_1_level", "phase_2_level"),
        (Inertia("mass", mass_kg, (-0.5 * MASS_M, 0.0)),),
    )

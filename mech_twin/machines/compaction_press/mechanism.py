# SPDX-License-Identifier: Apache-2.0
"""Frames of the press, and what its links look like."""

from __future__ import annotations

from mech_twin.capabilities.mechanism import Bar, FrameTree, Inertia, fixed, four_bar_chain, inertia_about_origin
from mech_twin.machines.compaction_press.dynamics import Press


def mechanism(press: Press) -> FrameTree:
    """Return crank, plate and pendulum; ``loaded_point`` is where the layer's force acts on the plate."""
    bar = press.bar
    lengths = (bar.crank_m, bar.coupler_m, bar.rocker_m)
    joints, loop = four_bar_chain(("crank", "plate", "pendulum"), lengths, (bar.pivot_x_m, bar.pivot_y_m))
    return FrameTree(
        (*joints, fixed("plate", "loaded_point", (press.along_m, press.across_m))),
        (loop,),
        (
            Bar("crank", (0.0, 0.0), (bar.crank_m, 0.0), 0.02, (200, 60, 40)),
            Bar("plate", (0.0, 0.0), (bar.coupler_m, 0.0), 0.025, (60, 90, 180)),
            Bar("pendulum", (0.0, 0.0), (bar.rocker_m, 0.0), 0.015, (90, 140, 60)),
        ),
        inertias=(
            inertia_about_origin(
                "crank", press.crank.mass_kg, (press.crank.along_m, press.crank.across_m), press.crank.inertia_kg_m2
            ),
            Inertia(
                "plate", press.plate.mass_kg, (press.plate.along_m, press.plate.across_m), press.plate.inertia_kg_m2
            ),
            Inertia(
                "pendulum",
                press.pendulum.mass_kg,
                (press.pendulum.along_m, press.pendulum.across_m),
                press.pendulum.inertia_kg_m2,
            ),
        ),
    )

# SPDX-License-Identifier: Apache-2.0
"""Flywheel on the crank shaft of a planar linkage, for an asked non-uniformity of its speed."""

from __future__ import annotations

from collections.abc import Mapping

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.machines.planar_linkage.assembly import mechanism_constants
from mech_twin.machines.planar_linkage.metrics import cycle, turn_work
from mech_twin.machines.planar_linkage.parameters import PlanarLinkageParameters
from mech_twin.parts.flywheel import exact_inertia, non_uniformity

LIMITS: dict[str, float] = {"non_uniformity": 0.05}
OBJECTIVES = ("flywheel_inertia_kg_m2",)
TRADE = (0.01, 0.02, 0.03, 0.05, 0.08, 0.1, 0.15, 0.2)
KEY = "crank.flywheel_kg_m2"


def sizing(
    parameters: PlanarLinkageParameters,
    limits: Mapping[str, float],
    objective: str,
    table: Table,
    tolerance: float = 0.0,
) -> Sizing:
    """Return the least flywheel with which a constant torque turns the crank within the asked non-uniformity.

    Raises
    ------
    StudyError
        For a non-uniformity that is not between 0 and 2.
    """
    delta = limits["non_uniformity"]
    if not 0.0 < delta < 2.0:
        raise StudyError(f"limit non_uniformity={delta:g}: expected a number above 0 and below 2")
    bare = varied(parameters, {KEY: 0.0})
    work, inertia = turn_work(cycle(bare, mechanism_constants(bare)), bare.direction)
    speed = abs(bare.drive.speed_rad_per_s)
    flywheel = max(0.0, exact_inertia(work, inertia, delta, speed))
    constraints = (Constraint("non_uniformity", non_uniformity(work, inertia, speed, flywheel), delta),)
    otherwise = "none: the linkage keeps the asked non-uniformity without a flywheel"
    return Sizing(
        "planar_linkage",
        objective,
        {KEY: flywheel},
        varied(parameters, {KEY: flywheel}),
        {"non_uniformity_without_flywheel": non_uniformity(work, inertia, speed)},
        constraints,
        binding_of(constraints, otherwise),
        tuple(
            {"non_uniformity": d, "flywheel_inertia_kg_m2": max(0.0, exact_inertia(work, inertia, d, speed))}
            for d in TRADE
        ),
        tolerance,
    )

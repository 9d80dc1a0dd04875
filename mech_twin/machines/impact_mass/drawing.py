# SPDX-License-Identifier: Apache-2.0
"""Drawing of the impact mass: mass on its guide, stop, force, and the phase portrait below."""

import math

from mech_twin.capabilities.figure import (
    CRANK,
    GROUND,
    MEASURE,
    ROD,
    STEEL,
    TOOL,
    box,
    hatched,
    label,
    measure,
    millimetres,
)
from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, Inertia, fixed, sliding
from mech_twin.machines.impact_mass.dynamics import PHASE_1
from mech_twin.machines.impact_mass.step import MassMemory
from mech_twin.samples import LinkageSample, Shape

PUSH_COLOUR, PULL_COLOUR = CRANK, TOOL
MASS_M = 0.08  # side of the drawn mass
TRACK_M = 0.46  # drawn length of the guide
STOP_HALF_M = 0.10
ARROW_M = 0.12
SCALE_S = 0.004  # drawn height of 1 m/s in the phase portrait
PORTRAIT_M = -0.26  # height of the portrait's axis
ARC_POINTS = 13


def mass_drawing(stop_m: float, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return mass, stop, an arrow for the phase of the force, and the phase portrait with its present point."""
    memory = MassMemory(*sample.memory.values)
    (x,), (force,) = sample.position, sample.effort
    tail, middle = x - MASS_M, x - 0.5 * MASS_M
    reach = math.copysign(ARROW_M, force) if force else 0.0
    arrow = ((tail - reach, 0.0), (tail, 0.0)) if reach >= 0.0 else ((tail, 0.0), (tail + reach, 0.0))
    colour = PUSH_COLOUR if memory.phase_1 == PHASE_1 else PULL_COLOUR
    floor = -0.5 * MASS_M - 0.006
    ground = hatched((stop_m + 0.01, -STOP_HALF_M), (stop_m + 0.01, STOP_HALF_M), 0.02)
    gap = stop_m - x
    gap_line = (measure("gap", (x, 0.11), (stop_m, 0.11), f"gap {millimetres(gap)}", 0.03),) if gap > 0.002 else ()
    return (
        Shape("guide", "line", hatched((stop_m - TRACK_M, floor), (stop_m + 0.06, floor), 0.02), GROUND, 0.004),
        Shape("stop", "line", ((stop_m, -STOP_HALF_M), (stop_m, STOP_HALF_M)), STEEL, 0.012, "stop"),
        Shape("stop_ground", "line", ground, GROUND, 0.004),
        Shape("mass", "line", box(tail, -MASS_M / 2.0, x, MASS_M / 2.0), ROD, 0.008),
        label("mass_name", (middle - 0.01, 0.034), "mass", ROD),
        Shape("force", "arrow", arrow, colour, 0.008, f"force {force:.0f} N" if reach else ""),
        *gap_line,
        *_portrait(stop_m, sample, memory),
    )


def _portrait(stop_m: float, sample: LinkageSample, memory: MassMemory) -> tuple[Shape, ...]:
    """Return axes, the arc since the last event and the present point of the phase portrait, below the mass."""
    a = memory.phase1_acceleration_m_per_s2 if memory.phase_1 == PHASE_1 else memory.phase2_acceleration_m_per_s2
    (x1,), (v1,) = sample.position, sample.velocity
    v0, x0 = memory.anchor_velocity_m_per_s, stop_m - memory.anchor_gap_m
    arc = []
    for i in range(ARC_POINTS):
        share = i / (ARC_POINTS - 1.0)
        v = v0 + (v1 - v0) * share
        x = x0 + (v - v0) * (v + v0) / (2.0 * a) if a else x0 + (x1 - x0) * share
        arc.append((min(x, stop_m), PORTRAIT_M + SCALE_S * v))
    axis = ((stop_m - TRACK_M, PORTRAIT_M), (stop_m + 0.05, PORTRAIT_M))
    upright = ((stop_m, PORTRAIT_M - 20.0 * SCALE_S), (stop_m, PORTRAIT_M + 20.0 * SCALE_S))
    return (
        Shape("portrait_axis", "line", axis, MEASURE, 0.002),
        Shape("portrait_stop", "line", upright, MEASURE, 0.002),
        label("portrait_name", (stop_m - 0.8 * TRACK_M, PORTRAIT_M - 0.05), "velocity over position", MEASURE),
        Shape("portrait_arc", "line", tuple(arc), ROD, 0.004),
        Shape("portrait_point", "points", ((x1, PORTRAIT_M + SCALE_S * v1),), CRANK, 0.02, f"{v1:+.1f} m/s"),
    )


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

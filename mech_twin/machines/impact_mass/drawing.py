"""Drawing of the impact mass: mass, stop, force, and the phase portrait below."""

from __future__ import annotations

import math

from mech_twin.machines.impact_mass.memory import MassMemory
from mech_twin.machines.impact_mass.states import PHASE_1
from mech_twin.samples import LinkageSample, Shape

MASS_COLOUR, STOP_COLOUR, PUSH_COLOUR, PULL_COLOUR = (60, 90, 180), (90, 90, 90), (200, 60, 40), (240, 160, 40)
MASS_M = 0.08  # side of the drawn mass
ARROW_M = 0.15
SCALE_S = 0.02  # drawn height of 1 m/s in the phase portrait
PORTRAIT_M = -0.9  # height of the portrait's axis
ARC_POINTS = 13


def mass_drawing(stop_m: float, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return mass, stop, an arrow for the phase of the force, and the phase portrait with its present point."""
    memory = MassMemory.unpacked(sample.memory.values)
    (x,), (force,) = sample.position, sample.effort
    tail = x - MASS_M
    reach = math.copysign(ARROW_M, force) if force else 0.0
    arrow = ((tail - reach, 0.0), (tail, 0.0)) if reach >= 0.0 else ((tail, 0.0), (tail + reach, 0.0))
    colour = PUSH_COLOUR if memory.phase_1 == PHASE_1 else PULL_COLOUR
    return (
        Shape("stop", "line", ((stop_m, -0.15), (stop_m, 0.15)), STOP_COLOUR, 0.012),
        Shape("mass", "line", _square(tail, x), MASS_COLOUR, 0.008),
        Shape("force", "arrow", arrow, colour, 0.008),
        *_portrait(stop_m, sample, memory),
    )


def _square(x0: float, x1: float) -> tuple[tuple[float, float], ...]:
    y0, y1 = -MASS_M / 2.0, MASS_M / 2.0
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))


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
    axis = ((stop_m - 1.0, PORTRAIT_M), (stop_m + 0.05, PORTRAIT_M))
    return (
        Shape("portrait_axis", "line", axis, STOP_COLOUR, 0.002),
        Shape("portrait_arc", "line", tuple(arc), MASS_COLOUR, 0.004),
        Shape("portrait_point", "points", ((x1, PORTRAIT_M + SCALE_S * v1),), PUSH_COLOUR, 0.02),
    )

"""Flywheel of the press."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees

from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.machines.compaction_press.cycle import WORK_POSITIONS, press_cycle
from mech_twin.machines.compaction_press.flywheel_run import flywheel_run
from mech_twin.machines.compaction_press.metrics import conditions
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.parts.flywheel import non_uniformity, wittenbauer

LIMITS: dict[str, float] = {"non_uniformity": 0.0}  # 0: the configured one
OBJECTIVES = ("flywheel_inertia_kg_m2",)
TRADE = (0.01, 0.02, 0.03, 0.05, 0.08, 0.1, 0.15, 0.2)


def sizing(
    parameters: CompactionPress, limits: Mapping[str, float], objective: str, table: Table, tolerance: float = 0.0
) -> Sizing:
    """Return the least flywheel that keeps the asked non-uniformity, shown by a time run."""
    if limits["non_uniformity"] > 0.0:
        parameters = varied(parameters, {"flywheel.non_uniformity": limits["non_uniformity"]})
    delta, speed = parameters.flywheel.non_uniformity, parameters.drive.speed_rad_per_s
    press, stroke = press_constants(parameters, fitted=False)
    cycle = press_cycle(press, stroke, speed, WORK_POSITIONS)
    work, inertia = cycle.work_j, cycle.inertia_kg_m2
    cuts = wittenbauer(work, inertia, delta, abs(speed))
    flywheel = max(0.0, cuts.inertia_kg_m2)
    chosen = varied(parameters, {"flywheel.inertia_kg_m2": flywheel})
    kept = non_uniformity(work, inertia, abs(speed), flywheel)
    gamma, alpha, _ = conditions(chosen)
    constraints = (
        Constraint("non_uniformity", kept, delta),
        Constraint("gamma_max_deg", gamma.value, gamma.limit),
        Constraint("alpha_at_bottom_deg", alpha.value, alpha.limit, "above"),
    )
    high, low = (degrees(float(cycle.angle_rad[place])) for place in (cuts.upper_position, cuts.lower_position))
    where = f": fastest at {high:.2f} degrees, slowest at {low:.2f}" if flywheel > 0.0 else ""
    otherwise = "none: the press keeps the asked non-uniformity without a flywheel"
    trade: tuple[dict[str, float | str], ...] = tuple(
        {
            "non_uniformity": d,
            "flywheel_inertia_kg_m2": max(0.0, wittenbauer(work, inertia, d, abs(speed)).inertia_kg_m2),
        }
        for d in TRADE
    )
    figures = {
        "non_uniformity_without_flywheel": non_uniformity(work, inertia, abs(speed)),
        "non_uniformity_of_time_run": flywheel_run(parameters, flywheel, step_s=5e-4).non_uniformity,
        "fastest_at_deg": high,
        "slowest_at_deg": low,
    }
    return Sizing(
        "compaction_press",
        objective,
        {"flywheel.inertia_kg_m2": flywheel},
        chosen,
        figures,
        constraints,
        binding_of(constraints, otherwise) + where,
        trade,
    )

# SPDX-License-Identifier: Apache-2.0
"""Flywheel of the press, for the worst machine within the tolerance of what is assumed."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, isnan, nan

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.machines.compaction_press.cycle import WORK_POSITIONS, press_cycle
from mech_twin.machines.compaction_press.flywheel_run import flywheel_run
from mech_twin.machines.compaction_press.metrics import conditions
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.machines.compaction_press.tolerance_box import WorstCase, asked_of, worst_case
from mech_twin.parts.flywheel import non_uniformity, wittenbauer

LIMITS: dict[str, float] = {"non_uniformity": nan}  # nan: the configured one
OBJECTIVES = ("flywheel_inertia_kg_m2",)
USUAL_TOLERANCE = 0.05
TRADE = (0.01, 0.02, 0.03, 0.05, 0.08, 0.1, 0.15, 0.2)
RUN_STEP_S = 5e-4


def sizing(
    parameters: CompactionPress, limits: Mapping[str, float], objective: str, table: Table, tolerance: float = 0.0
) -> Sizing:
    """Return the least flywheel that keeps the asked non-uniformity on every machine of the box, shown by a time run.

    Raises
    ------
    StudyError
        For a non-uniformity that is not between 0 and 2.
    """
    asked = limits["non_uniformity"]
    if not isnan(asked):
        if not 0.0 < asked < 2.0:
            raise StudyError(f"limit non_uniformity={asked:g}: expected a number above 0 and below 2")
        parameters = varied(parameters, {"flywheel.non_uniformity": asked})
    delta = parameters.flywheel.non_uniformity
    nominal = max(0.0, asked_of(parameters, delta))
    worst = worst_case(parameters, delta, tolerance)
    flywheel = max(0.0, worst.inertia_kg_m2)
    kept, metrics = _shown(worst, flywheel, delta)
    chosen = varied(parameters, {"flywheel.inertia_kg_m2": flywheel})
    gamma, alpha, _ = conditions(varied(worst.parameters, {"flywheel.inertia_kg_m2": flywheel}))
    constraints = (
        Constraint("non_uniformity", kept, delta),
        Constraint("gamma_max_deg", gamma.value, gamma.limit),
        Constraint("alpha_at_bottom_deg", alpha.value, alpha.limit, "above"),
    )
    where = f": fastest at {metrics['fastest_at_deg']:.2f} degrees, slowest at {metrics['slowest_at_deg']:.2f}"
    otherwise = "none: the press keeps the asked non-uniformity without a flywheel"
    worst_names = {f"worst_factor_of_{key}": factor for key, factor in worst.factors.items()}
    return Sizing(
        "compaction_press",
        objective,
        {"flywheel.inertia_kg_m2": flywheel},
        chosen,
        {"nominal_flywheel_inertia_kg_m2": nominal, "machines_tried": float(worst.tried), **metrics, **worst_names},
        constraints,
        binding_of(constraints, otherwise) + (where if flywheel > 0.0 else ""),
        _trade_off(parameters, worst.parameters),
        tolerance,
    )


def _shown(worst: WorstCase, flywheel: float, delta: float) -> tuple[float, dict[str, float]]:
    """Return the non-uniformity that the worst machine keeps, and how it was shown."""
    press, stroke = press_constants(worst.parameters, fitted=False)
    speed = worst.parameters.drive.speed_rad_per_s
    cycle = press_cycle(press, stroke, speed, WORK_POSITIONS)
    cuts = wittenbauer(cycle.work_j, cycle.inertia_kg_m2, delta, abs(speed))
    return non_uniformity(cycle.work_j, cycle.inertia_kg_m2, abs(speed), flywheel), {
        "non_uniformity_without_flywheel": non_uniformity(cycle.work_j, cycle.inertia_kg_m2, abs(speed)),
        "non_uniformity_of_time_run": flywheel_run(worst.parameters, flywheel, step_s=RUN_STEP_S).non_uniformity,
        "fastest_at_deg": degrees(float(cycle.angle_rad[cuts.upper_position])),
        "slowest_at_deg": degrees(float(cycle.angle_rad[cuts.lower_position])),
    }


def _trade_off(nominal: CompactionPress, worst: CompactionPress) -> tuple[dict[str, float | str], ...]:
    """Return flywheels for other non-uniformities: of the machine as configured, and of the worst one found."""
    return tuple(
        {
            "non_uniformity": delta,
            "flywheel_inertia_kg_m2": max(0.0, asked_of(worst, delta)),
            "nominal_flywheel_inertia_kg_m2": max(0.0, asked_of(nominal, delta)),
        }
        for delta in TRADE
    )

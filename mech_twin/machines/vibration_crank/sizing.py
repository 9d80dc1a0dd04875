"""Counterweight and balancing fraction of the vibration crank."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import NamedTuple

from scipy.optimize import minimize_scalar

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.machines.vibration_crank.metrics import FORCE, MOMENT, balanced, extreme
from mech_twin.machines.vibration_crank.parameters import VibrationCrank

LIMITS: dict[str, float] = {"counterweight_mass_kg": inf, "drive_torque_peak_nm": inf, "shaking_force_max_n": inf}
OBJECTIVES = ("shaking_force_max_n", "drive_torque_peak_nm", "counterweight_mass_kg")
GRID = 100


class Balance(NamedTuple):
    """What a balancing fraction brings."""

    counterweight_mass_kg: float
    drive_torque_peak_nm: float
    shaking_force_max_n: float

    def violation(self, limits: Mapping[str, float]) -> float:
        """Return by how much the limits are broken, each over its own size."""
        return float(sum(max(0.0, value / limits[name] - 1.0) for name, value in self._asdict().items()))


def balance_at(parameters: VibrationCrank, fraction: float) -> Balance:
    """Return mass, peak moment and largest force on the frame with the counterweight derived for a fraction."""
    mechanism, speed = balanced(parameters, fraction), parameters.drive.speed_rad_per_s
    return Balance(
        mechanism.counter_mass, float(extreme(mechanism, speed, MOMENT)), float(extreme(mechanism, speed, FORCE))
    )


def sizing(
    parameters: VibrationCrank, limits: Mapping[str, float], objective: str, table: Table, tolerance: float = 0.0
) -> Sizing:
    """Return the fraction with the smallest objective within the limits, and its counterweight."""

    def cost(fraction: float) -> float:
        found = balance_at(parameters, fraction)
        size: float = getattr(found, objective)
        return size if found.violation(limits) == 0.0 else 1e9 * (1.0 + found.violation(limits))

    places = [i / GRID for i in range(GRID + 1)]
    best = min(places, key=cost)
    low, high = max(0.0, best - 1.0 / GRID), min(1.0, best + 1.0 / GRID)
    finer = float(minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-9}).x)
    fraction = min((best, finer), key=cost)
    found = balance_at(parameters, fraction)
    constraints = (
        Constraint("balancing_fraction", fraction, 1.0),
        Constraint("balancing_fraction", fraction, 0.0, "above"),
        *(Constraint(name, value, limits[name]) for name, value in found._asdict().items() if limits[name] < inf),
    )
    if found.violation(limits) > 0.0:
        raise StudyError("no balancing fraction meets the limits: " + binding_of(constraints, ""))
    changes = {"counterweight.mass_kg": None, "counterweight.balancing_fraction": fraction}
    chosen = varied(parameters, changes)
    without = float(
        extreme(balanced(parameters, 0.0)._replace(counter_mass=0.0), parameters.drive.speed_rad_per_s, MOMENT)
    )
    return Sizing(
        "vibration_crank",
        objective,
        {"counterweight.balancing_fraction": fraction},
        chosen,
        {**found._asdict(), "drive_torque_peak_without_counterweight_nm": without},
        constraints,
        binding_of(constraints, f"none: {objective} has its minimum inside the range"),
        tuple({"balancing_fraction": i / 10.0, **balance_at(parameters, i / 10.0)._asdict()} for i in range(11)),
    )

# SPDX-License-Identifier: Apache-2.0
"""Counterweight and balancing fraction of the vibration crank, for the worst machine within a tolerance.

The counterweight is computed from the configured masses.  The balanced masses, the working force and the speed have
tolerances.  Force on the frame and drive moment are affine in each of them (in the square of the speed), so their
largest magnitude over the box is at a corner.  They are affine in the counterweight too, so the worst case is convex
in the balancing fraction.
"""

from collections.abc import Mapping
from itertools import product
from math import inf
from operator import attrgetter
from typing import NamedTuple

from scipy.optimize import minimize_scalar

from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import scaled, varied
from mech_twin.errors import StudyError
from mech_twin.machines.vibration_crank.metrics import FORCE, MOMENT, balanced, extreme
from mech_twin.machines.vibration_crank.parameters import VibrationCrank, slider_crank_constants
from mech_twin.machines.vibration_crank.slider_crank import SliderCrank

LIMITS: dict[str, float] = {"counterweight_mass_kg": inf, "drive_torque_peak_nm": inf, "shaking_force_max_n": inf}
LOADS = ("drive_torque_peak_nm", "shaking_force_max_n")
OBJECTIVES = ("shaking_force_max_n", "drive_torque_peak_nm", "counterweight_mass_kg")
USUAL_TOLERANCE = 0.05
GRID = 100
WORST_GRID = 10  # the worst case is convex, a grid only brackets it; every place costs all corners
ROTATING_PARTS = ("masses.crank_kg", "masses.pin_kg", "masses.bearing_kg", "masses.lever_kg")
# masses that only add up move together: their sums are largest where all are
GROUPS = (
    ("masses.tree_kg", "masses.stand_kg"),
    ("masses.boom_kg", "masses.extra_kg"),
    ("masses.rod_kg",),
    (*ROTATING_PARTS, "masses.rotating_kg"),
    ("working_force_n",),
    ("drive.speed_rpm",),
)


class BalanceEffect(NamedTuple):
    """Counterweight and loads at a balancing fraction."""

    counterweight_mass_kg: float
    drive_torque_peak_nm: float
    shaking_force_max_n: float

    def violation(self, limits: Mapping[str, float]) -> float:
        """Return the sum of the limits' violations, each relative to its limit."""
        return float(sum(max(0.0, value / limits[name] - 1.0) for name, value in self._asdict().items()))


class Corner(NamedTuple):
    """A machine of the box: its mechanism without the counterweight to be chosen, speed (rad/s) and friction (N m)."""

    mechanism: SliderCrank
    speed: float
    drag: float


def balance_at(parameters: VibrationCrank, fraction: float, corners: tuple[Corner, ...] | None = None) -> BalanceEffect:
    """Return counterweight, peak moment and largest force on the frame, the worst over the corners of the box.

    The counterweight is the one derived for the fraction from the configured masses.
    """
    mass = balanced(parameters, fraction).counter_mass
    hung = [
        c._replace(mechanism=c.mechanism._replace(counter_mass=mass)) for c in corners or box_corners(parameters, 0.0)
    ]
    return BalanceEffect(
        mass,
        max(float(extreme(c.mechanism, c.speed, MOMENT, c.drag)) for c in hung),
        max(float(extreme(c.mechanism, c.speed, FORCE)) for c in hung),
    )


def _varied_groups(parameters: VibrationCrank) -> list[list[str]]:
    """Return the keys of the box that the machine depends on: a rotating mass replaces those of its parts."""
    replaced = () if parameters.masses.rotating_kg is None else ROTATING_PARTS
    there = [[key for key in group if key not in replaced and attrgetter(key)(parameters)] for group in GROUPS]
    return [group for group in there if group]


def box_corners(parameters: VibrationCrank, tolerance: float) -> tuple[Corner, ...]:
    """Return the corners of the box of assumed masses, force and speed; one if there is no tolerance."""
    groups, corners = _varied_groups(parameters), []
    for signs in product((1.0 - tolerance, 1.0 + tolerance), repeat=len(groups)) if tolerance > 0.0 else [()]:
        factors = {key: sign for group, sign in zip(groups, signs, strict=False) for key in group}
        moved = scaled(parameters, factors)
        corners.append(Corner(slider_crank_constants(moved), moved.drive.speed_rad_per_s, moved.drag_nm))
    return tuple(corners)


def _best_fraction(
    parameters: VibrationCrank, limits: Mapping[str, float], objective: str, corners: tuple[Corner, ...]
) -> tuple[float, BalanceEffect]:
    """Return the fraction with the smallest worst objective within the limits, or the one that breaks them least."""
    known: dict[float, BalanceEffect] = {}

    def cost(fraction: float) -> float:
        if fraction not in known:
            known[fraction] = balance_at(parameters, fraction, corners)
        size: float = getattr(known[fraction], objective)
        broken = known[fraction].violation(limits)
        return size if broken == 0.0 else 1e9 * (1.0 + broken)

    grid = GRID if len(corners) == 1 else WORST_GRID
    best = min((i / grid for i in range(grid + 1)), key=cost)
    low, high = max(0.0, best - 1.0 / grid), min(1.0, best + 1.0 / grid)
    options = {"xatol": 1e-9 if len(corners) == 1 else 1e-6}
    finer = float(minimize_scalar(cost, bounds=(low, high), method="bounded", options=options).x)
    fraction = min((best, finer), key=cost)
    return fraction, known[fraction]


def _loads_at(parameters: VibrationCrank, fraction: float, corners: tuple[Corner, ...]) -> dict[str, float]:
    """Return counterweight and loads of the machine as configured, and the worst loads over the box."""
    worst = balance_at(parameters, fraction, corners)
    return balance_at(parameters, fraction)._asdict() | {f"worst_{name}": getattr(worst, name) for name in LOADS}


def sizing(
    parameters: VibrationCrank, limits: Mapping[str, float], objective: str, table: Table, tolerance: float = 0.0
) -> Sizing:
    """Return the fraction with the smallest objective within the limits on the worst machine, and its counterweight.

    Raises
    ------
    StudyError
        For a limit of 0 or less, or limits that no fraction meets.
    """
    for name, limit in limits.items():
        if not limit > 0.0:
            raise StudyError(f"limit {name}={limit:g}: expected a number above 0")
    corners = box_corners(parameters, tolerance)
    fraction, worst = _best_fraction(parameters, limits, objective, corners)
    constraints = (
        Constraint("balancing_fraction", fraction, 1.0),
        Constraint("balancing_fraction", fraction, 0.0, "above"),
        *(Constraint(name, value, limits[name]) for name, value in worst._asdict().items() if limits[name] < inf),
    )
    if worst.violation(limits) > 0.0:
        raise StudyError("no balancing fraction meets the limits: " + binding_of(constraints, ""))
    single = box_corners(parameters, 0.0)
    edge = fraction if tolerance == 0.0 else _best_fraction(parameters, limits, objective, single)[0]
    bare = single[0].mechanism._replace(counter_mass=0.0)
    least = objective if len(corners) == 1 or objective not in LOADS else f"worst_{objective}"
    binding = binding_of(constraints, f"none: {least} has its minimum inside the range")
    return Sizing(
        "vibration_crank",
        objective,
        {"counterweight.balancing_fraction": fraction},
        varied(parameters, {"counterweight.mass_kg": None, "counterweight.balancing_fraction": fraction}),
        {
            **_loads_at(parameters, fraction, corners),
            "nominal_balancing_fraction": edge,
            "machines_tried": float(len(corners)),
            "drive_torque_peak_without_counterweight_nm": float(extreme(bare, single[0].speed, MOMENT, single[0].drag)),
        },
        constraints,
        "; ".join((binding, *parameters.speed_remarks({}))),
        tuple({"balancing_fraction": i / 10.0, **_loads_at(parameters, i / 10.0, corners)} for i in range(11)),
        tolerance,
        tuple(key for group in _varied_groups(parameters) for key in group),
    )

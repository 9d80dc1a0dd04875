# SPDX-License-Identifier: Apache-2.0
"""Motor, stiffness and damping of the roller former, in the worst case over a box of tolerances."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product
from math import isnan
from typing import Any

import numpy as np

from mech_twin.capabilities.progress import tell
from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.errors import StudyError
from mech_twin.machines.roller_former.drive_choice import (
    SWEEP_DAMPING,
    SWEEP_STIFFNESS,
    CouplingPoint,
    MotorVerdict,
    coupling_point,
    motor_selection,
    power_required_w,
    with_motor,
)
from mech_twin.machines.roller_former.parameters import SET_KEYS, RollerFormer, former_of
from mech_twin.machines.roller_former.steady import steady_turn

# share of the coupling's rated moment; twist peak to peak (published: 0.003 to 0.008); what more damping may gain
LIMITS: dict[str, float] = {"share_of_rated": 1.0, "twist_range_rad": 0.005, "damping_gain": 0.02}
MOTOR_TABLE = "motors_4a"
OBJECTIVES = ("coupling_max_nm",)
USUAL_TOLERANCE = 0.05


def carries(parameters: RollerFormer, tolerance: float) -> bool:
    """Return whether the motor has the power and runs steadily at every corner of the box."""
    return all(
        corner.motor.rated_power_w >= power_required_w(corner) and steady_turn(former_of(corner)) is not None
        for corner in corners(parameters, tolerance)
    )


def motor_of(parameters: RollerFormer, table: Mapping[str, Any], tolerance: float) -> tuple[RollerFormer, MotorVerdict]:
    """Return the configuration with the weakest motor of the table that carries the mean load and runs steadily."""
    verdicts = motor_selection(parameters, table)
    for found in verdicts:
        if found.rated_enough and found.runs:
            fitted = with_motor(parameters, found.name, table[found.name])
            if carries(fitted, tolerance):
                return fitted, found
    need = max(power_required_w(corner) for corner in corners(parameters, tolerance)) / 1000.0
    power = verdicts[-1].rated_power_w / 1000.0
    within = f" with {100.0 * tolerance:g} % of tolerance" if tolerance > 0.0 else ""
    raise StudyError(
        f"no motor of the table suits: {need:.1f} kW needed{within}, the strongest has {power:.1f} kW"
        + (" and does not keep the load up" if power >= need else "")
    )


def worst_point(configurations: Iterable[RollerFormer], stiffness: float, damping: float) -> CouplingPoint:
    """Return the maximum over configurations of each coupling load; nan if one has no steady turn."""
    points = [coupling_point(configuration, stiffness, damping) for configuration in configurations]
    for point in points:
        if isnan(point.coupling_max_nm):
            return point
    return CouplingPoint(*(max(values) for values in zip(*(vars(point).values() for point in points), strict=True)))


def within(point: CouplingPoint, limits: Mapping[str, float]) -> bool:
    """Return whether the coupling and its twist keep their limits (false where there is no steady turn)."""
    return point.share_of_rated <= limits["share_of_rated"] and point.twist_range_rad <= limits["twist_range_rad"]


def damped(p: RollerFormer, stiffness: float, gain: float) -> CouplingPoint:
    """Return the coupling loads at the least damping beyond which the RMS about the mean falls by at most ``gain``.

    The RMS is used because it falls monotonically with damping; the largest moment has chance minima.
    """
    low, high = coupling_point(p, stiffness, SWEEP_DAMPING[0]), coupling_point(p, stiffness, SWEEP_DAMPING[-1])
    goal = high.coupling_rms_about_mean_nm * (1.0 + gain)
    if low.coupling_rms_about_mean_nm <= goal:
        return low
    while high.damping_nms_per_rad - low.damping_nms_per_rad > 1e-3 * high.damping_nms_per_rad:
        middle = coupling_point(p, stiffness, (low.damping_nms_per_rad * high.damping_nms_per_rad) ** 0.5)
        low, high = (low, middle) if middle.coupling_rms_about_mean_nm <= goal else (middle, high)
    return high


def worst_damped(box: tuple[RollerFormer, ...], stiffness: float, gain: float) -> CouplingPoint:
    """Return the worst case of the coupling over a box, its damping chosen for the configuration itself (the first)."""
    chosen = damped(box[0], stiffness, gain)
    return chosen if len(box) == 1 else worst_point(box, stiffness, chosen.damping_nms_per_rad)


def stiffness_and_damping(
    box: tuple[RollerFormer, ...], limits: Mapping[str, float]
) -> tuple[CouplingPoint, list[CouplingPoint]]:
    """Return the coupling with the least largest moment within the limits, and the sweep it was found in.

    All values are the worst over the box.  Between the best stiffness of the sweep and a neighbour that breaks a limit,
    the stiffness at the limit is located.
    """
    gain = limits["damping_gain"]
    sweep = []
    for i, stiffness in enumerate(SWEEP_STIFFNESS[::2], start=1):
        sweep.append(worst_damped(box, stiffness, gain))
        tell(i, len(SWEEP_STIFFNESS[::2]))
    allowed = [i for i, point in enumerate(sweep) if within(point, limits)]
    if not allowed:
        least = min(sweep, key=lambda point: point.twist_range_rad)
        raise StudyError(
            f"no stiffness keeps share_of_rated <= {limits['share_of_rated']:g} and twist_range_rad <= "
            f"{limits['twist_range_rad']:g}: at {least.stiffness_nm_per_rad:.0f} N m/rad they are "
            f"{least.share_of_rated:.3g} and {least.twist_range_rad:.3g}"
        )
    place = min(allowed, key=lambda i: sweep[i].coupling_max_nm)
    best = sweep[place]
    for side in (place - 1, place + 1):
        if 0 <= side < len(sweep) and not within(sweep[side], limits):
            within_limit, beyond = sweep[place].stiffness_nm_per_rad, sweep[side].stiffness_nm_per_rad
            while abs(beyond - within_limit) > 1e-3 * within_limit:
                middle = worst_damped(box, 0.5 * (within_limit + beyond), gain)
                if within(middle, limits):
                    within_limit = middle.stiffness_nm_per_rad
                    best = min(best, middle, key=lambda point: point.coupling_max_nm)
                else:
                    beyond = middle.stiffness_nm_per_rad
    return best, sweep


def nominal_edge(
    parameters: RollerFormer, limits: Mapping[str, float], objective: str, table: Table
) -> dict[str, float]:
    """Return what the sizes would be without tolerances."""
    edge = sizing(parameters, limits, objective, table, 0.0)
    sizes = {f"nominal_{key.split('.')[1]}": value for key, value in edge.sizes.items() if not isinstance(value, str)}
    motor = edge.parameters.motor  # type: ignore[attr-defined]
    return {"nominal_motor_rated_power_w": motor.rated_power_w, **sizes}


def sizing(
    parameters: RollerFormer,
    limits: Mapping[str, float],
    objective: str,
    table: Table,
    tolerance: float = USUAL_TOLERANCE,
) -> Sizing:
    """Return motor (the weakest of the table that carries the load), stiffness and damping of the coupling.

    With a tolerance the limits hold at the corners of the box of `variation` and at random points inside it, and
    the sizes without tolerance stand beside (``nominal_``).
    """
    p, motor = motor_of(parameters, table(MOTOR_TABLE), tolerance)
    box = corners(p, tolerance)
    best, sweep = stiffness_and_damping(box, limits)
    stiffness, damping = best.stiffness_nm_per_rad, best.damping_nms_per_rad
    here = coupling_point(p, stiffness, damping)
    reached = coupling_point(p, stiffness, SWEEP_DAMPING[-1]).coupling_rms_about_mean_nm
    tried = (*box, *inside(p, tolerance))
    worst = worst_point(tried, stiffness, damping)
    required = max(power_required_w(configuration) for configuration in tried)
    constraints = (
        Constraint("share_of_rated", worst.share_of_rated, limits["share_of_rated"]),
        Constraint("twist_range_rad", worst.twist_range_rad, limits["twist_range_rad"]),
        Constraint("damping_gain", here.coupling_rms_about_mean_nm / reached - 1.0, limits["damping_gain"]),
        Constraint("motor_power_w", motor.rated_power_w, required, "above"),
    )
    shown = ("stiffness_nm_per_rad", "damping_nms_per_rad", "coupling_max_nm", "twist_range_rad", "share_of_rated")
    binding = binding_of(constraints, "none: the least moment of the sweep; its minima over stiffness are flat")
    sizes = {"drive.stiffness_nm_per_rad": stiffness, "drive.damping_nms_per_rad": damping}
    metrics = {
        "coupling_max_nm": worst.coupling_max_nm,
        "coupling_rms_nm": worst.coupling_rms_nm,
        "twist_range_rad": worst.twist_range_rad,
        "share_of_rated": worst.share_of_rated,
        "motor_power_required_w": required,
        "configurations_tried": float(len(tried)),
    }
    if tolerance > 0.0:
        metrics.update(nominal_edge(parameters, limits, objective, table))
    return Sizing(
        "roller_former",
        objective,
        {"motor.catalogue_name": motor.name, **sizes},
        varied(p, sizes),
        metrics,
        constraints,
        f"{binding}; {motor.text}",
        tuple({name: getattr(point, name) for name in shown} for point in sweep[::2]),
        tolerance,
        ASSUMED,
    )


INSIDE = 16  # random points of the box
ASSUMED = (*(f"carts.{key}" for key in SET_KEYS), "drive.efficiency", "drive.inertia_factor")


def assumed(parameters: RollerFormer, load: float, efficiency: float, inertia: float) -> RollerFormer:
    """Return the configuration with loads, efficiency and inertia factor multiplied by these."""
    p = parameters
    changes: dict[str, Any] = {f"carts.{key}": getattr(p.carts, key) * load for key in SET_KEYS}
    if p.carts.masses_kg is not None:
        changes["carts.masses_kg"] = [mass * load for mass in p.carts.masses_kg]
    changes["drive.efficiency"] = min(1.0, p.drive.efficiency * efficiency)
    changes["drive.inertia_factor"] = max(1.0, p.drive.inertia_factor * inertia)
    return varied(p, changes)


def corners(parameters: RollerFormer, tolerance: float) -> tuple[RollerFormer, ...]:
    """Return the configuration itself and, for a tolerance above 0, at the eight corners of the box."""
    if tolerance == 0.0:
        return (parameters,)
    ends = (1.0 - tolerance, 1.0 + tolerance)
    return (parameters, *(assumed(parameters, *point) for point in product(ends, repeat=3)))


def inside(parameters: RollerFormer, tolerance: float, seed: int = 1) -> tuple[RollerFormer, ...]:
    """Return the configuration at random points inside the box; none for a tolerance of 0."""
    if tolerance == 0.0:
        return ()
    points = np.random.default_rng(seed).uniform(1.0 - tolerance, 1.0 + tolerance, (INSIDE, 3))
    return tuple(assumed(parameters, *point) for point in points.tolist())

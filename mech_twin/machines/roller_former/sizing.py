# SPDX-License-Identifier: Apache-2.0
"""Motor, stiffness and damping of the roller former, in the worst case over a box of tolerances.

A motor is chosen by running and starting under load, and by the loads in its coupling.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from math import isnan, nan
from typing import Any, NamedTuple

import numpy as np

from mech_twin.capabilities.progress import tell
from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.errors import StudyError
from mech_twin.machines.roller_former.metrics import moment_metrics, power_at_rated_speed_w, turn_metrics
from mech_twin.machines.roller_former.parameters import SET_KEYS, RollerFormer, former_of
from mech_twin.machines.roller_former.steady import start_up, steady_turn
from mech_twin.parts.induction_motor import kloss_torque


@dataclass(frozen=True)
class MotorVerdict:
    """How a motor suits the installation; torques in N m on the motor shaft.

    ``rated_enough``: the rated power covers the mean demand.  ``runs``: the motor settles to a steady turn under load.
    The starts are computed from rest at the configured crank angle, with the load applied at once or as configured.
    """

    name: str
    rated_power_w: float
    power_required_w: float
    rated_enough: bool
    kloss_standstill_nm: float
    runs: bool
    steady_speed_rad_per_s: float | None
    starts_as_configured: bool
    starts_under_load: bool
    starts_under_load_with_catalogue_torque: bool

    @property
    def text(self) -> str:
        """One sentence for the machine's owner."""
        if not self.rated_enough:
            return f"{self.name}: too weak, {self.power_required_w / 1000.0:.1f} kW are needed"
        if not self.runs:
            return f"{self.name}: does not keep the load up"
        if self.starts_under_load:
            return f"{self.name}: suits, and starts under load"
        if self.starts_under_load_with_catalogue_torque:
            return f"{self.name}: suits; starts under load only if the catalogue's starting torque is really there"
        return f"{self.name}: suits, but stalls under load: start it empty" + (
            "" if self.starts_as_configured else " (the configured start stalls as well)"
        )


def power_required_w(parameters: RollerFormer) -> float:
    """Return the required rated power (W): that of mean moment and shaft friction at the rated speed."""
    return power_at_rated_speed_w(parameters, moment_metrics(former_of(parameters))["moment_mean_nm"])


def motor_verdict(parameters: RollerFormer) -> MotorVerdict:
    """Return the verdict on the motor of a configuration."""
    p = parameters
    former = former_of(p)
    turn, required = steady_turn(former), power_required_w(p)
    return MotorVerdict(
        name=p.motor.catalogue_name or f"{p.motor.rated_power_w / 1000.0:g} kW",
        rated_power_w=p.motor.rated_power_w,
        power_required_w=required,
        rated_enough=p.motor.rated_power_w >= required,
        kloss_standstill_nm=kloss_torque(former.motor, 1.0),
        runs=turn is not None,
        steady_speed_rad_per_s=None if turn is None else turn.mean_speed_rad_per_s,
        starts_as_configured=_starts(p),
        starts_under_load=_starts(_loaded(p, p.motor.torque_curve)),
        starts_under_load_with_catalogue_torque=_starts(_loaded(p, "starting_corrected")),
    )


def _loaded(parameters: RollerFormer, curve: str) -> RollerFormer:
    return varied(
        parameters,
        {
            "start.speed_fraction": 0.0,
            "start.load_from_fraction": 0.0,
            "supply.initial_fraction": 1.0,
            "motor.torque_curve": curve,
        },
    )


def _starts(parameters: RollerFormer) -> bool:
    return start_up(parameters, former_of(parameters), parameters.rated_crank_speed_rad_per_s).steady


def with_motor(parameters: RollerFormer, name: str, row: Mapping[str, Any]) -> RollerFormer:
    """Return the configuration with another motor of a table, the torque curve kept."""
    motor = {"catalogue_name": name, "torque_curve": parameters.motor.torque_curve, **row}
    return type(parameters).model_validate({**configuration_tree(parameters), "motor": motor})


def motor_selection(parameters: RollerFormer, table: Mapping[str, Mapping[str, float]]) -> tuple[MotorVerdict, ...]:
    """Return the verdict on every motor of a table, weakest first; all else stays as it is."""
    by_power = sorted(table.items(), key=lambda item: item[1]["rated_power_w"])
    return tuple(motor_verdict(with_motor(parameters, name, row)) for name, row in by_power)


OFFSETS_DEG = {1: 0.0, 2: 90.0, 3: 120.0, 4: 90.0}
PUBLISHED_STIFFNESS = {2: 110000.0, 3: 150000.0, 4: 200000.0}
STUDIED_DAMPING = (2000.0, 8000.0)
SWEEP_DAMPING = tuple(float(k) for k in np.geomspace(200.0, 15000.0, 25))
SWEEP_STIFFNESS = tuple(float(c) for c in np.geomspace(20000.0, 800000.0, 41))


class CouplingPoint(NamedTuple):
    """Loads in the coupling over a steady turn, moments at the crank (N m); nan if the motor cannot drive the load."""

    stiffness_nm_per_rad: float
    damping_nms_per_rad: float
    elastic_max_nm: float
    coupling_max_nm: float
    coupling_rms_nm: float
    coupling_rms_about_mean_nm: float
    twist_range_rad: float
    share_of_rated: float


def installation(parameters: RollerFormer, count: int) -> RollerFormer:
    """Return the published installation with ``count`` carts: offsets, stiffness, and the motor's torques times N/2.

    The same slips and rotor inertia for each; one cart keeps the stiffness of two (the paper studies 2, 3 and 4).
    """
    factor = count / parameters.carts.count
    motor = parameters.motor
    scaled = {
        key: None if value is None else value * factor
        for key, value in (
            ("rated_power_w", motor.rated_power_w),
            ("rated_torque_nm", motor.rated_torque_nm),
            ("breakdown_torque_nm", motor.breakdown_torque_nm),
        )
    }
    changes = {
        "carts.count": count,
        "carts.offset_deg": OFFSETS_DEG[count],
        "drive.stiffness_nm_per_rad": PUBLISHED_STIFFNESS[max(count, 2)],
        "motor.catalogue_name": motor.catalogue_name if factor == 1.0 else None,
    }
    return varied(parameters, {**changes, **{f"motor.{key}": value for key, value in scaled.items()}})


def coupling_point(parameters: RollerFormer, stiffness: float, damping: float) -> CouplingPoint:
    """Return the load in the coupling at a stiffness (N m/rad) and a damping (N m s/rad)."""
    changes = {"drive.stiffness_nm_per_rad": stiffness, "drive.damping_nms_per_rad": damping}
    former = former_of(varied(parameters, changes))
    turn = steady_turn(former)
    if turn is None:
        return CouplingPoint(stiffness, damping, *(nan,) * 6)
    f = turn_metrics(turn, former)
    return CouplingPoint(
        stiffness,
        damping,
        f["elastic_moment_max_nm"],
        f["coupling_moment_max_nm"],
        f["coupling_moment_rms_nm"],
        f["coupling_moment_rms_about_mean_nm"],
        f["twist_range_rad"],
        f["coupling_moment_at_motor_max_nm"] / parameters.drive.coupling_rated_moment_nm,
    )


def damping_sweep(parameters: RollerFormer, damping: Iterable[float]) -> tuple[CouplingPoint, ...]:
    """Return the coupling's load against damping (N m s/rad)."""
    return tuple(coupling_point(parameters, parameters.drive.stiffness_nm_per_rad, value) for value in damping)


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
    lost = next((point for point in points if isnan(point.coupling_max_nm)), None)
    return lost or CouplingPoint(*(max(values) for values in zip(*points, strict=True)))


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
    """Return the sizes without tolerances."""
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


def inside(parameters: RollerFormer, tolerance: float) -> tuple[RollerFormer, ...]:
    """Return the configuration at random points inside the box; none for a tolerance of 0."""
    if tolerance == 0.0:
        return ()
    points = np.random.default_rng(1).uniform(1.0 - tolerance, 1.0 + tolerance, (INSIDE, 3))
    return tuple(assumed(parameters, *point) for point in points.tolist())

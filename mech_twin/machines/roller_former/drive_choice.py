# SPDX-License-Identifier: Apache-2.0
"""Choice of the roller former's motor by running and starting under load, and the loads in its coupling."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np

from mech_twin.capabilities.variation import varied
from mech_twin.machines.roller_former.cart_statics import load_moments
from mech_twin.machines.roller_former.metrics import moment_metrics, turn_metrics
from mech_twin.machines.roller_former.parameters import RollerFormer, former_of
from mech_twin.machines.roller_former.steady import SteadyTurn, start_up, steady_turn
from mech_twin.parts.induction_motor import (
    InductionMotorParameters,
    breakdown_slip,
    kloss_torque,
    motor_constants,
    motor_torque,
    slip_at_torque,
)


@dataclass(frozen=True)
class CatalogueValue:
    """A printed value of the catalogue or paper, and the value derived from the other printed data."""

    quantity: str
    printed: float
    derived: float

    @property
    def error(self) -> float:
        """Relative error of the derived value."""
        return self.derived / self.printed - 1.0


PUBLISHED_MOTOR = {
    "rated slip": 0.025,
    "breakdown slip": 0.0933,
    "breakdown speed, rad/s": 94.95,
    "starting torque, N m": 129.24,
    "rated torque, N m": 107.7,
}


@dataclass(frozen=True)
class MotorVerdict:
    """How a motor suits the installation; torques in N m on the motor shaft.

    ``rated_enough``: the rated power covers the mean demand.  ``load_peak_nm`` is the largest static load, which the
    inertia smooths.  ``runs``: the motor settles to a steady turn under load.  The starts are computed from rest at
    the configured crank angle, with the load applied at once or as configured.
    """

    name: str
    rated_power_w: float
    power_required_w: float
    rated_enough: bool
    kloss_standstill_nm: float
    catalogue_start_nm: float
    load_mean_nm: float
    load_peak_nm: float
    breakdown_nm: float
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


def catalogue_check(motor: InductionMotorParameters) -> tuple[CatalogueValue, ...]:
    """Return printed values of the published motor with those derived from its other data by Kloss's formula."""
    rated_slip = 1.0 - motor.rated_speed_rpm / motor.synchronous_speed_rpm
    constants = motor_constants(motor)
    slip = breakdown_slip(rated_slip, motor.breakdown_torque_ratio)
    derived = {
        "rated slip": rated_slip,
        "breakdown slip": slip,
        "breakdown speed, rad/s": constants.synchronous_speed_rad_per_s * (1.0 - slip),
        "starting torque, N m": motor.starting_torque_ratio * motor.rated_power_w / constants.rated_speed_rad_per_s,
        "rated torque, N m": motor.rated_power_w / constants.rated_speed_rad_per_s,
    }
    return tuple(CatalogueValue(name, printed, derived[name]) for name, printed in PUBLISHED_MOTOR.items())


def power_required_w(parameters: RollerFormer) -> float:
    """Return the required rated power (W): mean moment times rated crank speed over efficiency."""
    mean = moment_metrics(former_of(parameters))["moment_mean_nm"]
    return mean * parameters.rated_crank_speed_rad_per_s / parameters.drive.efficiency


def motor_verdict(parameters: RollerFormer, name: str | None = None) -> MotorVerdict:
    """Return the verdict on the motor of a configuration; ``name`` is what to call it."""
    p = parameters
    former = former_of(p)
    constants, moments = former.motor, moment_metrics(former)
    to_shaft = 1.0 / (former.ratio * former.efficiency)
    turn, required = steady_turn(former), power_required_w(p)
    return MotorVerdict(
        name=name or p.motor.catalogue_name or f"{p.motor.rated_power_w / 1000.0:g} kW",
        rated_power_w=p.motor.rated_power_w,
        power_required_w=required,
        rated_enough=p.motor.rated_power_w >= required,
        kloss_standstill_nm=kloss_torque(constants, 1.0),
        catalogue_start_nm=constants.starting_torque_nm,
        load_mean_nm=moments["moment_mean_nm"] * to_shaft,
        load_peak_nm=moments["moment_max_nm"] * to_shaft,
        breakdown_nm=constants.breakdown_torque_nm,
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


def motor_selection(parameters: RollerFormer, table: Mapping[str, Mapping[str, float]]) -> tuple[MotorVerdict, ...]:
    """Return the verdict on every motor of a table, weakest first; all else stays as it is."""
    verdicts = []
    tree: dict[str, Any] = parameters.model_dump(mode="json", exclude_none=True)
    for name, row in sorted(table.items(), key=lambda item: item[1]["rated_power_w"]):
        motor = {"catalogue_name": name, "torque_curve": parameters.motor.torque_curve, **row}
        verdicts.append(motor_verdict(RollerFormer.model_validate({**tree, "motor": motor})))
    return tuple(verdicts)


def speed_under_mean_load(parameters: RollerFormer) -> float:
    """Return the motor speed (rad/s) at the mean moment by Kloss's formula; nan if that is above breakdown."""
    former = former_of(parameters)
    torque = moment_metrics(former)["moment_mean_nm"] / (former.ratio * former.efficiency)
    return former.motor.synchronous_speed_rad_per_s * (1.0 - slip_at_torque(former.motor, torque))


def standstill_margin(parameters: RollerFormer) -> float:
    """Return the motor's standstill moment over the largest load moment at a start (both at the crank)."""
    former = former_of(parameters)
    moment = motor_torque(former.motor, 0.0, 1.0) * former.ratio * former.efficiency
    return float(moment / np.max(load_moments(former.bank, np.linspace(0.0, 2.0 * np.pi, 720), 1.0)))


OFFSETS_DEG = {1: 0.0, 2: 90.0, 3: 120.0, 4: 90.0}
PUBLISHED_STIFFNESS = {2: 110000.0, 3: 150000.0, 4: 200000.0}
STUDIED_DAMPING = (2000.0, 8000.0)
SWEEP_DAMPING = tuple(float(k) for k in np.geomspace(200.0, 15000.0, 25))
SWEEP_STIFFNESS = tuple(float(c) for c in np.geomspace(20000.0, 800000.0, 41))

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class CouplingPoint:
    """Loads in the coupling over a steady turn, moments at the crank (N m); nan if the motor cannot drive the load."""

    stiffness_nm_per_rad: float
    damping_nms_per_rad: float
    elastic_min_nm: float
    elastic_max_nm: float
    coupling_max_nm: float
    coupling_rms_nm: float
    coupling_rms_about_mean_nm: float
    twist_range_rad: float
    motor_side_max_nm: float
    share_of_rated: float


@dataclass(frozen=True)
class StiffnessFinding:
    """Result of a sweep over stiffness, for comparison with the published optimum.

    ``minima`` are the stiffnesses (N m/rad) at which the largest moment has a local minimum inside the sweep;
    ``unique`` is whether there is exactly one, within a step of the published value, and lowest of the whole sweep.
    """

    published_nm_per_rad: float
    at_published_nm: float
    minima: tuple[float, ...]
    lowest_nm_per_rad: float
    lowest_nm: float
    unique: bool


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
    turn: SteadyTurn | None = steady_turn(former)
    if turn is None:
        return CouplingPoint(stiffness, damping, nan, nan, nan, nan, nan, nan, nan, nan)
    f = turn_metrics(turn, former)
    at_motor = f["coupling_moment_at_motor_max_nm"]
    return CouplingPoint(
        stiffness,
        damping,
        f["elastic_moment_min_nm"],
        f["elastic_moment_max_nm"],
        f["coupling_moment_max_nm"],
        f["coupling_moment_rms_nm"],
        f["coupling_moment_rms_about_mean_nm"],
        f["twist_range_rad"],
        at_motor,
        at_motor / parameters.drive.coupling_rated_moment_nm,
    )


def _swept(
    parameters: RollerFormer, pairs: Iterable[tuple[float, float]], progress: Progress | None
) -> tuple[CouplingPoint, ...]:
    todo, points = list(pairs), []
    for done, (stiffness, damping) in enumerate(todo, start=1):
        points.append(coupling_point(parameters, stiffness, damping))
        if progress is not None:
            progress(done, len(todo))
    return tuple(points)


def damping_sweep(
    parameters: RollerFormer, damping: Iterable[float] = SWEEP_DAMPING, progress: Progress | None = None
) -> tuple[CouplingPoint, ...]:
    """Return the coupling's load against damping; ``progress(done, of)`` is called after each point."""
    return _swept(parameters, ((parameters.drive.stiffness_nm_per_rad, k) for k in damping), progress)


def stiffness_sweep(
    parameters: RollerFormer, stiffness: Iterable[float] = SWEEP_STIFFNESS, progress: Progress | None = None
) -> tuple[CouplingPoint, ...]:
    """Return the coupling's load against stiffness; ``progress(done, of)`` is called after each point."""
    return _swept(parameters, ((c, parameters.drive.damping_nms_per_rad) for c in stiffness), progress)


def stiffness_finding(parameters: RollerFormer, points: tuple[CouplingPoint, ...]) -> StiffnessFinding:
    """Return whether the stiffness of the configuration is a unique minimum of the largest moment in the coupling."""
    published = parameters.drive.stiffness_nm_per_rad
    here = coupling_point(parameters, published, parameters.drive.damping_nms_per_rad).coupling_max_nm
    stiffness = np.array([point.stiffness_nm_per_rad for point in points])
    most = np.array([point.coupling_max_nm for point in points])
    inside = np.flatnonzero((most[1:-1] < most[:-2]) & (most[1:-1] < most[2:])) + 1
    lowest = int(np.nanargmin(most))
    near = [i for i in inside if stiffness[i - 1] <= published <= stiffness[i + 1]]
    return StiffnessFinding(
        published,
        here,
        tuple(float(stiffness[i]) for i in inside),
        float(stiffness[lowest]),
        float(most[lowest]),
        len(inside) == 1 and len(near) == 1 and lowest == near[0],
    )

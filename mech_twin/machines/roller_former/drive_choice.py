# SPDX-License-Identifier: Apache-2.0
"""Choice of the roller former's motor by running and starting under load, and the loads in its coupling."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np

from mech_twin.capabilities.variation import varied
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.machines.roller_former.metrics import moment_metrics, turn_metrics
from mech_twin.machines.roller_former.parameters import RollerFormer, former_of
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
    """Return the required rated power (W): mean moment times rated crank speed over efficiency."""
    mean = moment_metrics(former_of(parameters))["moment_mean_nm"]
    return mean * parameters.rated_crank_speed_rad_per_s / parameters.drive.efficiency


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


@dataclass(frozen=True)
class CouplingPoint:
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
        return CouplingPoint(stiffness, damping, nan, nan, nan, nan, nan, nan)
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

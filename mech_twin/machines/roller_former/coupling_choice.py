# SPDX-License-Identifier: Apache-2.0
"""Loads in the coupling of the roller former: the installations of 1 to 4 carts, sweeps over stiffness and damping."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import nan

import numpy as np

from mech_twin.capabilities.variation import varied
from mech_twin.machines.roller_former.metrics import turn_metrics
from mech_twin.machines.roller_former.parameters import RollerFormer, former_of
from mech_twin.machines.roller_former.steady import SteadyTurn, steady_turn

OFFSETS_DEG = {1: 0.0, 2: 90.0, 3: 120.0, 4: 90.0}
PUBLISHED_STIFFNESS = {2: 110000.0, 3: 150000.0, 4: 200000.0}
STUDIED_DAMPING = (2000.0, 8000.0)
SWEEP_DAMPING = tuple(float(k) for k in np.geomspace(200.0, 15000.0, 25))
SWEEP_STIFFNESS = tuple(float(c) for c in np.geomspace(20000.0, 800000.0, 41))

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class CouplingPoint:
    """Load in the coupling of one steady turn, moments at the crank (N m); nan where the motor cannot keep it up."""

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
    """What a sweep over stiffness says of the published optimum.

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

# SPDX-License-Identifier: Apache-2.0
"""Numbers of the planar linkage: one position, one cycle at rated speed, and its flywheel."""

from __future__ import annotations

from math import asin, degrees, pi
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.kernel import kernel
from mech_twin.machines.planar_linkage.assembly import least_transmission
from mech_twin.machines.planar_linkage.chain import CRANK, RPR, TURN, Array, chain_motion
from mech_twin.machines.planar_linkage.linkage import IDLE, PlanarLinkage, potential_at, reduced, stroke_point
from mech_twin.machines.planar_linkage.parameters import PlanarLinkageParameters
from mech_twin.machines.planar_linkage.pins import pin_forces
from mech_twin.machines.planar_linkage.roles import dead_centres, regimes_at
from mech_twin.parts.flywheel import non_uniformity

GRID = 3600
TORQUE, SHAKING = 0, 1  # columns of a table of a cycle
PINS_BEFORE = 3  # columns of a table of a cycle before those of the pins


class TurnTable(NamedTuple):
    """A turn at uniform speed: crank angle (rad), torque (N m), force on the frame (N), each pin's force (N).

    ``regime`` is that of each row.
    ``work_j`` is that of the mean torque and all loads since the start, ``inertia_kg_m2`` the reduced inertia.  Each
    dead centre of the tool is there twice, with the force of the stroke before it and with that after it.
    """

    angle_rad: Array
    regime: Array
    torque_nm: Array
    shaking_n: Array
    pins_n: Array
    work_j: Array
    inertia_kg_m2: Array
    mean_torque_nm: float
    worked_j: float


@kernel
def cycle_table(p: PlanarLinkage, angles: Array, w: float, regimes: Array) -> Array:
    """Return drive torque, force on the frame, reduced inertia and the pins' forces, rows along the angles."""
    out = np.empty((len(angles), PINS_BEFORE + 1 + 3 * len(p.dyads.kind)))
    for i in range(len(angles)):
        at = pin_forces(p, angles[i], w, 0.0, int(regimes[i]))
        out[i, 0], out[i, 1] = at.drive_nm, np.hypot(at.shaking_x, at.shaking_y)
        out[i, 2] = reduced(p, angles[i], int(regimes[i])).inertia
        out[i, PINS_BEFORE:] = np.hypot(at.x, at.y)
    return out


@kernel
def held_and_way(p: PlanarLinkage, angles: Array) -> Array:
    """Return the potential (J) and the tool's way along its stroke (m), rows along the angles."""
    out = np.empty((len(angles), 2))
    for i in range(len(angles)):
        m, _ = chain_motion(p.dyads, angles[i])
        out[i, 0], out[i, 1] = potential_at(p, m), stroke_point(p, m)[0]
    return out


def cycle(p: PlanarLinkageParameters, chain: PlanarLinkage, count: int = GRID) -> TurnTable:
    """Return one turn at rated speed, in its sense."""
    speed, sense = p.drive.speed_rad_per_s, p.direction
    centres = dead_centres(chain) if p.working_stroke is not None else None
    own = np.array([] if centres is None else [*centres.rear, *centres.front], dtype=np.float64)
    angles = np.unique(np.concatenate((np.linspace(0.0, TURN, count + 1), own)))
    regimes = np.full(len(angles), IDLE)
    between = np.zeros(len(angles) - 1, dtype=bool)
    if centres is not None:
        pieces = regimes_at(chain, 0.5 * (angles[1:] + angles[:-1]), sense)
        before, after = np.append(pieces[-1], pieces), np.append(pieces, pieces[0])
        sides = np.where(before == after, 1, 2)
        regimes = np.repeat(after, sides)
        regimes[np.cumsum(sides) - sides] = before
        angles = np.repeat(angles, sides)
        between = regimes[1:] != IDLE
    try:
        table, held = cycle_table(chain, angles, speed, regimes), held_and_way(chain, angles)
    except ZeroDivisionError as error:
        raise ConfigurationError(
            f"dyad_1 to dyad_{len(p.dyads)} on a crank of crank.length_m {p.crank.length_m:g}: at one angle of the "
            "turn the pins of a dyad meet or its links lie in line, where its pin forces have no limit; "
            "expected other lengths"
        ) from error
    worked = np.concatenate(([0.0], np.cumsum(np.where(between, chain.stroke.force_n * np.diff(held[:, 1]), 0.0))))
    # d(work)/d(angle) = mean torque + moment of the loads; the loads' work is in closed form
    mean = float(worked[-1]) / TURN
    work = mean * angles - worked - (held[:, 0] - held[0, 0])
    return TurnTable(
        angles,
        regimes,
        table[:, 0],
        table[:, 1],
        table[:, PINS_BEFORE:],
        work,
        table[:, 2],
        mean,
        abs(float(worked[-1])),
    )


def turn_work(found: TurnTable, sense: float) -> tuple[Array, Array]:
    """Return work (J) and reduced inertia (kg m2) along the turn as it is run through."""
    return (found.work_j, found.inertia_kg_m2) if sense > 0.0 else (found.work_j[::-1], found.inertia_kg_m2[::-1])


def greatest(found: TurnTable, column: int, sign: float, chain: PlanarLinkage, speed: float) -> float:
    """Return the greatest value over the turn of ``sign`` times a column of `cycle_table`, between its rows too.

    The rows on both sides of the greatest one bound it; none is looked for across a dead centre, where the force jumps.
    """
    row = int(np.argmax(sign * _column(found, column)))
    angles, last = found.angle_rad, len(found.angle_rad) - 1
    low = angles[row - 1] if row > 0 else angles[0] - (TURN - angles[last - 1])
    high = angles[row + 1] if row < last else angles[last] + angles[1]
    regime = found.regime[row : row + 1]

    def less(angle: float) -> float:
        return -sign * float(cycle_table(chain, np.array([angle]), speed, regime)[0, column])

    at_row = sign * float(_column(found, column)[row])
    if low == high:
        return at_row
    nearby = minimize_scalar(less, bounds=(float(low), float(high)), method="bounded", options={"xatol": 1e-9})
    return max(at_row, -float(nearby.fun))


def _column(found: TurnTable, column: int) -> Array:
    columns: tuple[Array, ...] = (found.torque_nm, found.shaking_n, found.inertia_kg_m2, *found.pins_n.T)
    return columns[column]


def cycle_metrics(p: PlanarLinkageParameters, chain: PlanarLinkage, pins: tuple[str, ...]) -> dict[str, float]:
    """Return the metrics of one cycle at rated speed."""
    found, speed = cycle(p, chain), p.drive.speed_rad_per_s
    torque = found.torque_nm
    square = float(np.trapezoid(torque * torque, found.angle_rad)) / TURN
    work, inertia = turn_work(found, p.direction)
    highest = greatest(found, TORQUE, 1.0, chain, speed)
    lowest = -greatest(found, TORQUE, -1.0, chain, speed)
    forces = [greatest(found, PINS_BEFORE + i, 1.0, chain, speed) for i in range(len(pins))]
    return {
        "drive_torque_peak_nm": max(highest, -lowest),
        "drive_torque_max_nm": highest,
        "drive_torque_min_nm": lowest,
        "drive_torque_mean_nm": found.mean_torque_nm,
        "drive_torque_rms_nm": float(np.sqrt(square)),
        "drive_power_mean_w": found.mean_torque_nm * speed,
        "working_stroke_energy_j": found.worked_j,
        "shaking_force_max_n": greatest(found, SHAKING, 1.0, chain, speed),
        "reduced_inertia_mean_kg_m2": float(np.trapezoid(found.inertia_kg_m2, found.angle_rad)) / TURN,
        "non_uniformity_1": non_uniformity(work, inertia, abs(speed)),
        **{f"{pin}_force_max_n": force for pin, force in zip(pins, forces, strict=True)},
        **_travels(p, chain),
        **_transmissions(p, chain),
    }


def _travels(p: PlanarLinkageParameters, chain: PlanarLinkage) -> dict[str, float]:
    table, turns = chain.turning
    spans = np.ptp(table, axis=0)
    return {
        f"{link}_swing_rad" if turns[place] else f"{link}_travel_m": float(spans[place])
        for place, link in enumerate(p.links)
        if place > CRANK
    }


def _transmissions(p: PlanarLinkageParameters, chain: PlanarLinkage) -> dict[str, float]:
    found: dict[str, float] = {}
    for k, key in enumerate(p.dyads):
        least, _ = least_transmission(chain.dyads, k)
        if chain.dyads.kind[k] == RPR:
            found[f"{key}_block_nearest_pivot_m"] = least
        else:
            found[f"{key}_transmission_least_deg"] = degrees(asin(min(least, 1.0)))
    return found


def position_metrics(
    p: PlanarLinkageParameters, chain: PlanarLinkage, pins: tuple[str, ...], crank_rad: float
) -> dict[str, Any]:
    """Return coordinates, forces and moments at a crank angle (rad) and rated speed."""
    speed = p.drive.speed_rad_per_s
    regime = IDLE
    if p.working_stroke is not None:
        regime = int(regimes_at(chain, np.array([crank_rad]), p.direction)[0])
    _, travel = chain_motion(chain.dyads, crank_rad)
    by, at = reduced(chain, crank_rad, regime), pin_forces(chain, crank_rad, speed, 0.0, regime)
    found: dict[str, Any] = {"crank_angle_rad": crank_rad}
    for place, link in enumerate(p.links):
        if place > CRANK:
            unit = "rad" if chain.turning.turns[place] else "m"
            found[f"{link}_{unit}"] = float(travel.position[place])
            found[f"{link}_speed_{unit}_per_s"] = float(travel.rate[place]) * speed
    for i, pin in enumerate(pins):
        found[f"{pin}_force_n"] = (float(at.x[i]), float(at.y[i]))
        if at.moment[i] != 0.0:
            found[f"{pin}_moment_nm"] = float(at.moment[i])
    return found | {
        "drive_torque_nm": 0.5 * speed * speed * by.slope - by.moment,
        "drive_torque_from_pins_nm": at.drive_nm,
        "shaking_force_n": (at.shaking_x, at.shaking_y),
        "reduced_inertia_kg_m2": by.inertia,
        "reduced_inertia_slope_kg_m2_per_rad": by.slope,
        "reduced_moment_nm": by.moment,
        "rated_turn_s": 2.0 * pi / abs(speed),
    }

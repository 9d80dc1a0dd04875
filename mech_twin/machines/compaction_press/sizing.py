# SPDX-License-Identifier: Apache-2.0
"""Flywheel of the press, for the worst machine within the tolerance of the assumed numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import copysign, degrees, isnan, nan, pi
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import corners, scaled, varied
from mech_twin.engine.crank_state import Transmission
from mech_twin.errors import StudyError
from mech_twin.machines.compaction_press.cycle import WORK_POSITIONS, mean_torque, press_cycle, turn_flywheel
from mech_twin.machines.compaction_press.dynamics import Press
from mech_twin.machines.compaction_press.metrics import conditions
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.machines.compaction_press.roles import press_linkage
from mech_twin.parts.flywheel import non_uniformity, start_speed, wittenbauer
from mech_twin.parts.four_bar import Link
from mech_twin.samples import MotorSample

LIMITS: dict[str, float] = {"non_uniformity": nan}  # nan: the configured one
OBJECTIVES = ("flywheel_inertia_kg_m2",)
USUAL_TOLERANCE = 0.05
TRADE = (0.01, 0.02, 0.03, 0.05, 0.08, 0.1, 0.15, 0.2)
RUN_STEP_S = 5e-4


def sizing(
    parameters: CompactionPress, limits: Mapping[str, float], objective: str, table: Table, tolerance: float = 0.0
) -> Sizing:
    """Return the least flywheel for the required non-uniformity on every machine of the box, verified by simulation.

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
    constraints = (Constraint("non_uniformity", kept, delta), gamma, alpha)
    where = f": fastest at {metrics['fastest_at_deg']:.2f} degrees, slowest at {metrics['slowest_at_deg']:.2f}"
    otherwise = "none: the press keeps the asked non-uniformity without a flywheel"
    worst_names = {f"worst_factor_of_{key}": factor for key, factor in worst.factors.items()}
    binding = binding_of(constraints, otherwise) + (where if flywheel > 0.0 else "")
    return Sizing(
        "compaction_press",
        objective,
        {"flywheel.inertia_kg_m2": flywheel},
        chosen,
        {"nominal_flywheel_inertia_kg_m2": nominal, "machines_tried": float(worst.tried), **metrics, **worst_names},
        constraints,
        "; ".join((binding, *parameters.speed_remarks({}))),
        tuple(
            {
                "non_uniformity": other,
                "flywheel_inertia_kg_m2": max(0.0, asked_of(worst.parameters, other)),
                "nominal_flywheel_inertia_kg_m2": max(0.0, asked_of(parameters, other)),
            }
            for other in TRADE
        ),
        tolerance,
        tuple(worst.factors),
    )


def _shown(worst: WorstCase, flywheel: float, delta: float) -> tuple[float, dict[str, float]]:
    """Return the non-uniformity of the worst machine, and how it was verified."""
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


STROKE_KEYS = ("working_force.contact_fraction", "working_force.application_from_a_m")
LOAD_KEYS = ("working_force.peak_n", "working_force.exponent", "drive.speed_rpm")
BETWEEN_KEYS = (*STROKE_KEYS, "working_force.exponent")
LINKS = ("crank", "plate", "pendulum")
LINK_KEYS = tuple(f"links.{link}.{size}" for link in LINKS for size in ("mass_kg", "inertia_kg_m2"))
ASSUMED = (*STROKE_KEYS, *LOAD_KEYS, *LINK_KEYS)
INSIDE = 40  # random points of the box


class WorstCase(NamedTuple):
    """The flywheel (kg m2) of the worst machine of a box, its configuration, and how many machines were tried."""

    inertia_kg_m2: float
    parameters: CompactionPress
    factors: dict[str, float]
    tried: int


def asked_of(parameters: CompactionPress, delta: float) -> float:
    """Return the flywheel (kg m2) required by a configuration's bare press; negative if none is needed."""
    press, stroke = press_constants(parameters, fitted=False)
    return turn_flywheel(press, stroke, parameters.drive.speed_rad_per_s, delta)


def _active(parameters: CompactionPress, keys: tuple[str, ...]) -> tuple[str, ...]:
    """Return the keys with an effect: not 0, and no mass of a crank whose centroid lies on its axis."""
    crank = parameters.links.crank
    balanced = crank.centroid_along_m == 0.0 and crank.centroid_across_m == 0.0
    idle = {"links.crank.mass_kg"} if balanced else set()
    if parameters.working_force.working_quarter:
        idle.add("working_force.contact_fraction")
    return tuple(key for key in keys if key not in idle and attrgetter(key)(parameters) != 0.0)


def _scaled(press: Press, factors: Mapping[str, float]) -> Press:
    def link(name: str, known: Link) -> Link:
        return known._replace(
            mass_kg=known.mass_kg * factors.get(f"links.{name}.mass_kg", 1.0),
            inertia_kg_m2=known.inertia_kg_m2 * factors.get(f"links.{name}.inertia_kg_m2", 1.0),
        )

    load = press.load._replace(
        peak_n=press.load.peak_n * factors.get("working_force.peak_n", 1.0),
        exponent=press.load.exponent * factors.get("working_force.exponent", 1.0),
    )
    crank, plate, pendulum = (link(name, getattr(press, name)) for name in LINKS)
    return press._replace(crank=crank, plate=plate, pendulum=pendulum, load=load)


def _worst_corner(parameters: CompactionPress, delta: float, tolerance: float) -> tuple[float, dict[str, float], int]:
    best, where, tried = -np.inf, dict[str, float](), 0
    rest = _active(parameters, (*LOAD_KEYS, *LINK_KEYS))
    speed = parameters.drive.speed_rad_per_s
    for outer in corners(_active(parameters, STROKE_KEYS), tolerance):
        press, stroke = press_constants(scaled(parameters, outer), fitted=False)
        for inner in corners(rest, tolerance):
            asked = turn_flywheel(_scaled(press, inner), stroke, speed * inner.get("drive.speed_rpm", 1.0), delta)
            tried += 1
            if asked >= best:
                best, where = asked, {**outer, **inner}
    return best, where, tried


def _between(
    asked: Callable[[dict[str, float]], float], where: dict[str, float], keys: tuple[str, ...], tolerance: float
) -> dict[str, float]:
    """Return a worse point of the box than ``where``, one key at a time, or ``where`` itself."""
    for key in keys:

        def loss(factor: float, key: str = key, base: dict[str, float] = where) -> float:
            return -asked({**base, key: factor})

        found = minimize_scalar(loss, bounds=(1.0 - tolerance, 1.0 + tolerance), method="bounded")
        if -found.fun > asked(where):
            where = {**where, key: float(found.x)}
    return where


def worst_case(parameters: CompactionPress, delta: float, tolerance: float) -> WorstCase:
    """Return the machine of the box with the largest required flywheel: corners, a key-wise search, random points."""
    if tolerance == 0.0:
        return WorstCase(asked_of(parameters, delta), parameters, {}, 1)
    _, where, tried = _worst_corner(parameters, delta, tolerance)
    known: dict[tuple[float, ...], float] = {}

    def asked(factors: dict[str, float]) -> float:
        place = tuple(factors.values())
        if place not in known:
            known[place] = asked_of(scaled(parameters, factors), delta)
        return known[place]

    where = _between(asked, where, _active(parameters, BETWEEN_KEYS), tolerance)
    random = np.random.default_rng(1)
    for _ in range(INSIDE):
        factors = {key: float(random.uniform(1.0 - tolerance, 1.0 + tolerance)) for key in where}
        where = max((where, factors), key=asked)
    return WorstCase(asked(where), scaled(parameters, where), where, tried + len(known))


class FlywheelRun(NamedTuple):
    """Simulation result: non-uniformity (1), smallest and largest speed (rad/s), drift of speed over a turn (1)."""

    non_uniformity: float
    speed_min_rad_per_s: float
    speed_max_rad_per_s: float
    drift: float


def flywheel_run(parameters: CompactionPress, inertia_kg_m2: float, step_s: float = 1e-4) -> FlywheelRun:
    """Return the speed's range over one turn under the constant mean torque with this flywheel (kg m2).

    The run is integrated in time by the twin's kernels, and starts on the energy curve that just touches
    w_m (1 + delta/2); that initial speed is all it takes from the sizing's closed form.
    """
    press, stroke = press_constants(parameters, fitted=False)
    speed, delta = parameters.drive.speed_rad_per_s, parameters.flywheel.non_uniformity
    cycle = press_cycle(press, stroke, speed, WORK_POSITIONS)
    first = start_speed(cycle.work_j, cycle.inertia_kg_m2, delta, abs(speed), inertia_kg_m2)
    flywheel = Transmission(1.0, 1.0, inertia_kg_m2)
    linkage = press_linkage(press, stroke, step_s, copysign(first, speed), 1.0, speed, "contact", flywheel)
    torque = mean_torque(press, stroke, speed)
    sample = linkage.start()
    crank = sample.joint("crank")
    speeds = [abs(crank.velocity)]
    while abs(crank.position) < 2.0 * pi:
        before = crank
        motor = MotorSample(sample.step, sample.time_s, ("motor",), (0.0,), (0.0,), (torque,), 1.0)
        sample = linkage.advance(sample, motor, None)
        crank = sample.joint("crank")
        speeds.append(abs(crank.velocity))
        speeds += [abs(at_event.velocity) for event in sample.events for at_event in event.pre]
    share = (2.0 * pi - abs(before.position)) / (abs(crank.position) - abs(before.position))
    end = abs(before.velocity) + share * (abs(crank.velocity) - abs(before.velocity))
    low, high = min(speeds), max(speeds)
    return FlywheelRun(2.0 * (high - low) / (high + low), low, high, end / first - 1.0)

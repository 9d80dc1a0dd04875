# SPDX-License-Identifier: Apache-2.0
"""Flywheel of the press, for the worst machine within the tolerance of the assumed numbers."""

from __future__ import annotations

from collections.abc import Mapping
from math import copysign, degrees, isnan, nan, pi
from operator import attrgetter
from typing import NamedTuple

from scipy.optimize import minimize_scalar

from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import Factors, inner_points, scaled, varied
from mech_twin.engine.crank_linkage import CrankLinkage
from mech_twin.engine.crank_state import Transmission
from mech_twin.errors import StudyError
from mech_twin.machines.compaction_press.cycle import WORK_POSITIONS, mean_torque, press_cycle, turn_flywheel
from mech_twin.machines.compaction_press.dynamics import JOINTS, layer_regimes
from mech_twin.machines.compaction_press.metrics import conditions
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.parts.flywheel import non_uniformity, start_speed, wittenbauer
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
    nominal = max(0.0, required_flywheel(parameters, delta))
    worst = worst_case(parameters, delta, tolerance)
    flywheel = max(0.0, worst.inertia_kg_m2)
    kept, metrics = _shown(worst, flywheel)
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
                "flywheel_inertia_kg_m2": max(0.0, required_flywheel(worst.parameters, other)),
                "nominal_flywheel_inertia_kg_m2": max(0.0, required_flywheel(parameters, other)),
            }
            for other in TRADE
        ),
        tolerance,
        tuple(worst.factors),
    )


def _shown(worst: WorstCase, flywheel: float) -> tuple[float, dict[str, float]]:
    """Return the non-uniformity of the worst machine, and how it was verified."""
    press, stroke = press_constants(worst.parameters, fitted=False)
    speed = worst.parameters.drive.speed_rad_per_s
    cycle = press_cycle(press, stroke, speed, WORK_POSITIONS)
    kept = non_uniformity(cycle.work_j, cycle.inertia_kg_m2, abs(speed), flywheel)
    cuts = wittenbauer(cycle.work_j, cycle.inertia_kg_m2, kept, abs(speed))
    return kept, {
        "non_uniformity_without_flywheel": non_uniformity(cycle.work_j, cycle.inertia_kg_m2, abs(speed)),
        "non_uniformity_of_time_run": flywheel_run(worst.parameters, flywheel, step_s=RUN_STEP_S).non_uniformity,
        "fastest_at_deg": degrees(float(cycle.angle_rad[cuts.upper_position])),
        "slowest_at_deg": degrees(float(cycle.angle_rad[cuts.lower_position])),
    }


STROKE_KEYS = ("working_force.contact_fraction", "working_force.application_from_a_m")
LOAD_KEYS = ("working_force.peak_n", "working_force.exponent", "drive.speed_rpm")
BETWEEN_KEYS = (*STROKE_KEYS, "working_force.exponent")
ASSUMED = (
    *STROKE_KEYS,
    *LOAD_KEYS,
    *(f"links.{link}.{size}" for link in ("crank", "plate", "pendulum") for size in ("mass_kg", "inertia_kg_m2")),
)
INSIDE = 40  # random points of the box


class WorstCase(NamedTuple):
    """The flywheel (kg m2) of the worst machine of a box, its configuration, and how many machines were tried."""

    inertia_kg_m2: float
    parameters: CompactionPress
    factors: dict[str, float]
    tried: int


def required_flywheel(parameters: CompactionPress, delta: float) -> float:
    """Return the flywheel (kg m2) required by a configuration's bare press; negative if none is needed."""
    press, stroke = press_constants(parameters, fitted=False)
    return turn_flywheel(press, stroke, parameters.drive.speed_rad_per_s, delta)


def _active(parameters: CompactionPress) -> tuple[str, ...]:
    """Return the keys with an effect: not 0, and no mass of a crank whose centroid lies on its axis."""
    crank = parameters.links.crank
    balanced = crank.centroid_along_m == 0.0 and crank.centroid_across_m == 0.0
    idle = {"links.crank.mass_kg"} if balanced else set()
    if parameters.working_force.working_quarter:
        idle.add("working_force.contact_fraction")
    return tuple(key for key in ASSUMED if key not in idle and attrgetter(key)(parameters) != 0.0)


def worst_case(parameters: CompactionPress, delta: float, tolerance: float) -> WorstCase:
    """Return the machine of the box with the largest required flywheel, searched key by key, and at random points."""
    if tolerance == 0.0:
        return WorstCase(required_flywheel(parameters, delta), parameters, {}, 1)
    keys, ends, known = _active(parameters), (1.0 - tolerance, 1.0 + tolerance), dict[tuple[float, ...], float]()

    def asked(factors: Factors) -> float:
        place = tuple(factors.values())
        if place not in known:
            known[place] = required_flywheel(scaled(parameters, factors), delta)
        return known[place]

    where, before = dict.fromkeys(keys, 1.0), Factors()
    while where != before:
        before = where
        for key in keys:
            tried = [{**where, key: end} for end in ends]
            if key in BETWEEN_KEYS:
                found = minimize_scalar(lambda x, k=key, at=where: -asked({**at, k: x}), bounds=ends, method="bounded")
                tried.append({**where, key: float(found.x)})
            where = max(where, *tried, key=asked)
    where = max(where, *inner_points(keys, tolerance, INSIDE), key=asked)
    return WorstCase(asked(where), scaled(parameters, where), where, len(known))


class FlywheelRun(NamedTuple):
    """Simulation result: non-uniformity (1), smallest and largest speed (rad/s), drift of speed over a turn (1)."""

    non_uniformity: float
    speed_min_rad_per_s: float
    speed_max_rad_per_s: float
    drift: float


def flywheel_run(parameters: CompactionPress, inertia_kg_m2: float, step_s: float = 1e-4) -> FlywheelRun:
    """Return the speed's range over one turn under the constant mean torque with this flywheel (kg m2).

    The run is integrated in time by the twin's kernels, and starts on the energy curve that just touches
    w_m (1 + delta/2), delta being what this flywheel keeps; that initial speed is all it takes from the closed form.
    """
    press, stroke = press_constants(parameters, fitted=False)
    speed = parameters.drive.speed_rad_per_s
    cycle = press_cycle(press, stroke, speed, WORK_POSITIONS)
    kept = non_uniformity(cycle.work_j, cycle.inertia_kg_m2, abs(speed), inertia_kg_m2)
    first = start_speed(cycle.work_j, cycle.inertia_kg_m2, kept, abs(speed), inertia_kg_m2)
    flywheel = Transmission(1.0, 1.0, inertia_kg_m2)
    start, layer = copysign(first, speed), layer_regimes(stroke, speed)
    linkage = CrankLinkage(press, step_s, 0.0, start, 1.0, JOINTS, "plate", transmission=flywheel, **layer)
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

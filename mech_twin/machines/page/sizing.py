# SPDX-License-Identifier: Apache-2.0
"""Flywheel of a page driven by one drive of constant speed, for a required non-uniformity of that speed."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.engine.coupling import LONGEST_STEP_S, SHORTEST_STEP_S
from mech_twin.engine.run import frames
from mech_twin.errors import StudyError
from mech_twin.machines.page import build
from mech_twin.machines.page.elements import RPM
from mech_twin.machines.page.parameters import GROUND, Page
from mech_twin.machines.page.roles import PageModel
from mech_twin.parts.flywheel import exact_inertia, non_uniformity
from mech_twin.samples import LinkageSample

LIMITS: dict[str, float] = {"non_uniformity": 0.05}
OBJECTIVES = ("flywheel_inertia_kg_m2",)
TRADE = (0.01, 0.02, 0.03, 0.05, 0.08, 0.1, 0.15, 0.2)
POSITIONS = 3600  # of a turn: what lies between them is of 1e-6 of a flywheel
LEAST_POSITIONS = 360  # where a faster turn leaves no more steps of the shortest: 1e-4 of a flywheel
MOST_TURNS = 100  # of the led joint until the mechanism is as at its start
RETURNED = 1e-3  # off from its start, an angle (rad), a way in parts of the machine's size, a part of a gas
ALIKE = 1e-8  # between two turns, likewise: so a shaft moves that a gear turns, and nothing that a linkage moves
Array = NDArray[np.float64]


def sizing(
    parameters: Page, limits: Mapping[str, float], objective: str, table: Table, tolerance: float = 0.0
) -> Sizing:
    """Return the least flywheel with which a constant torque turns the led joint within the asked non-uniformity.

    Raises
    ------
    StudyError
        Not one drive of constant speed leads the page, its motion does not repeat, or the non-uniformity is not
        between 0 and 2.
    """
    delta = limits["non_uniformity"]
    if not 0.0 < delta < 2.0:
        raise StudyError(f"limit non_uniformity={delta:g}: expected a number above 0 and below 2")
    body, speed = _turned(parameters)
    work, inertia = _turns(parameters, speed)
    flywheel = max(0.0, exact_inertia(work, inertia, delta, speed))
    key = f"bodies.{body}.inertia_kg_m2"
    sizes = {key: parameters.bodies[body].inertia_kg_m2 + flywheel}
    constraints = (Constraint("non_uniformity", non_uniformity(work, inertia, speed, flywheel), delta),)
    otherwise = f"none: the page keeps the asked non-uniformity without a flywheel on {body}"
    without = non_uniformity(work, inertia, speed)
    return Sizing(
        "page",
        objective,
        dict(sizes),
        varied(parameters, sizes),
        {"flywheel_inertia_kg_m2": flywheel, "non_uniformity_without_flywheel": without},
        constraints,
        binding_of(constraints, otherwise),
        tuple(
            {"non_uniformity": d, "flywheel_inertia_kg_m2": max(0.0, exact_inertia(work, inertia, d, speed))}
            for d in TRADE
        ),
        tolerance,
    )


def _turned(page: Page) -> tuple[str, float]:
    """Return the body that the leading drive turns on the ground, and its speed (rad/s)."""
    places = build(page).linkage.shared.places  # type: ignore[attr-defined] # the linkage of a page
    if places.free or places.driven != 1 or places.motors:
        raise StudyError(
            f"{page.name}: a flywheel is sized where one drive of kind constant_speed leads every joint; "
            f"this page has {places.free} free and {places.driven} driven"
        )
    (name,) = places.driven_names
    drive = page.drives[name]
    ends = [page.point(point)[0] for point in page.joints[drive.joint].between]
    if drive.speed_rpm is None or GROUND not in ends or drive.speed_rpm == 0.0:
        raise StudyError(
            f"{page.name}: drives.{name}: a flywheel needs a joint that turns a body on the ground at a speed"
        )
    return next(body for body in ends if body != GROUND), abs(drive.speed_rpm) * RPM


def _turns(page: Page, speed: float) -> tuple[Array, Array]:
    """Return work of a constant torque and all loads (J), and reduced inertia (kg m2), along a cycle at full speed.

    A cycle is the turns after which the mechanism is as it was; the first turn is left out, in which a gas fills.  The
    work of the loads is the change of kinetic energy less the work of the drive.

    Raises
    ------
    StudyError
        The mechanism does not come back.
    """
    positions, step_s = _steps_of_a_turn(page, 2.0 * math.pi / speed)
    full = varied(page, {"supply.initial_fraction": 1.0, "coupling.step_s": step_s})
    shared = build(full).linkage.shared  # type: ignore[attr-defined] # the linkage of a page
    (drive,) = shared.places.driven_names
    kinetic, done, begun, ends, away = [], [], None, list[LinkageSample](), ""
    for frame in frames(build(full), (1 + MOST_TURNS) * positions * step_s):
        if frame.linkage.step < positions:
            continue
        kinetic.append(_kinetic_energy(shared, frame.linkage))
        done.append(frame.linkage.memory[f"{drive}_work_j"])
        begun = begun or frame.linkage
        if len(done) > 1 and len(done) % positions == 1:
            ends.append(frame.linkage)
            away = _away(shared, begun, frame.linkage)
            if not away:
                break
            if len(ends) == 2 and (going := _going_on(shared, begun, *ends)):
                away = going
                break
    if away:
        raise StudyError(
            f"{page.name}: {away} is not as it was after any of {MOST_TURNS} turns; "
            "a flywheel is sized for a motion that repeats"
        )
    held, given = np.array(kinetic), np.array(done) - done[0]
    share = np.linspace(0.0, 1.0, len(given))
    mean = given[-1] - (held[-1] - held[0])
    return mean * share + (held - held[0]) - given, 2.0 * held / speed**2


def _steps_of_a_turn(page: Page, turn_s: float) -> tuple[int, float]:
    """Return into how many steps a turn is divided, and how long each is (s): not beyond the coupling's bounds."""
    positions = min(POSITIONS, math.floor(turn_s / SHORTEST_STEP_S))
    if positions < LEAST_POSITIONS or turn_s / positions > LONGEST_STEP_S:
        least_rpm, most_rpm = 60.0 / (POSITIONS * LONGEST_STEP_S), 60.0 / (LEAST_POSITIONS * SHORTEST_STEP_S)
        raise StudyError(
            f"{page.name}: the drive turns at {60.0 / turn_s:.6g} rpm; a flywheel is sized from {least_rpm:.4g} "
            f"to {most_rpm:.6g} rpm, where a turn has {LEAST_POSITIONS} to {POSITIONS} steps"
        )
    return positions, turn_s / positions


def _moved(shared: PageModel, one: LinkageSample, other: LinkageSample) -> dict[str, float]:
    """Return how far each joint moved: an angle (rad), or a way in parts of the machine's size."""
    assembly = shared.assembly
    names = (str(assembly.coordinates[j]) for j in assembly.split.dependent)
    ways = {name: other.joint(name).position - one.joint(name).position for name in names}
    return {name: way / assembly.size_m if name in assembly.slides else way for name, way in ways.items()}


def _off(shared: PageModel, name: str, moved: float) -> bool:
    """Return whether a joint that moved so far is not as it was: a slide at all, an angle beside whole turns."""
    return abs(moved if name in shared.assembly.slides else math.remainder(moved, 2.0 * math.pi)) > RETURNED


def _going_on(shared: PageModel, begun: LinkageSample, first: LinkageSample, second: LinkageSample) -> str:
    """Return a joint that moves alike each turn and is back after none of `MOST_TURNS`; empty where none does."""
    then, now = _moved(shared, begun, first), _moved(shared, first, second)
    alike = (name for name in now if abs(now[name] - then[name]) <= ALIKE)
    return next((n for n in alike if all(_off(shared, n, turns * now[n]) for turns in range(1, MOST_TURNS + 1))), "")


def _away(shared: PageModel, begun: LinkageSample, now: LinkageSample) -> str:
    """Return a joint or gas that is not as it was at the beginning; empty where all are."""
    for name, moved in _moved(shared, begun, now).items():
        if _off(shared, name, moved):
            return name
    gas = ((name, now.memory[f"{name}_gas_1"], begun.memory[f"{name}_gas_1"]) for name in shared.places.gases)
    return next((name for name, one, other in gas if np.abs(np.subtract(one, other)) > RETURNED), "")


def _kinetic_energy(shared: PageModel, linkage: LinkageSample) -> float:
    """Return the kinetic energy of a sample of a page without free coordinates (J)."""
    places, split, names = shared.places, shared.assembly.split, shared.assembly.coordinates
    motion = [linkage.joint(names[j]).position for j in (*split.dependent, *split.driven)]
    motion += [linkage.joint(names[j]).velocity for j in split.driven]
    state = np.zeros(places.state)
    state[: places.motion] = motion
    report = shared.functions.report
    out = np.zeros(report.size)
    report.function(np.array(shared.functions.numbers), np.zeros(places.controls), linkage.time_s, state, out)
    return float(out[2 * len(linkage.joints)])

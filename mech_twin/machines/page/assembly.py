# SPDX-License-Identifier: Apache-2.0
"""Assembly of a page: its structure, the closed initial pose, and the choice of independent coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.page.elements import DEGREE, RPM
from mech_twin.machines.page.parameters import GROUND, Page
from mech_twin.mechanics.code_generation import Number
from mech_twin.mechanics.kinematics import Kinematics
from mech_twin.mechanics.structure import (
    COORDINATES,
    FREE,
    REVOLUTE,
    SLIDER,
    FirmGear,
    PlanarJoint,
    RigidBody,
    Split,
    Structure,
    StructureError,
    split_of,
)

Array = NDArray[np.float64]
CLOSED = 1e-11  # of the machine's size: a miss of a loop that is none
REGULAR = 1e-3  # least of the closures' singular values over the largest: the coordinates are well determined
NEAR_RAD = 0.5  # largest turn of a step of the search: longer ones leave the guess, by whole turns too
NEAR = 0.1  # of a closed pose to the start values, in rad and sizes of the machine: no nearer one is sought
NEARER = 0.9  # of the distance to the start values: a pose less far off is another
TRIALS, TURNS = 60, 200  # starts of the search for a closed pose, and its steps
MOST_COORDINATES = 12
PARTS = {REVOLUTE: ("",), SLIDER: ("",), "weld": (), FREE: ("_x", "_y", "_angle")}


def exact_turn(degrees: float) -> tuple[float, float]:
    """Return cosine and sine of an angle in degrees, exact at right angles."""
    right = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    found = right.get(degrees % 360.0)
    return found or (math.cos(degrees * DEGREE), math.sin(degrees * DEGREE))


def structure_of(page: Page, number: Callable[[float], Number], offsets: Sequence[float]) -> Structure:
    """Return the structure of a page; ``number`` converts each of its numbers, in a fixed order.

    ``offsets`` (rad or m) are those of its rigid couplings: second joint minus ratio times the first.
    """
    names = [GROUND, *page.bodies]
    bodies = [RigidBody(GROUND)]
    for name, body in page.bodies.items():
        x, y = map(number, body.centre_m)
        bodies.append(RigidBody(name, number(body.mass_kg), number(body.inertia_kg_m2), (x, y)))
    joints = []
    for name, joint in page.joints.items():
        (first, at), (second, on) = (page.point(point) for point in joint.between)
        axis, by = exact_turn(joint.direction_deg or 0.0), joint.turned_deg or 0.0
        cosine, sine = exact_turn(by)
        turned = (number(by * DEGREE), number(cosine), number(sine))
        joints.append(
            PlanarJoint(
                name, joint.kind, names.index(first), names.index(second), (number(at[0]), number(at[1])),
                (number(on[0]), number(on[1])), (number(axis[0]), number(axis[1])), turned,
            )
        )  # fmt: skip
    order = list(page.joints)
    driven = [drive.joint for drive in page.drives.values() if drive.kind == "constant_speed"]
    others = [drive.joint for drive in page.drives.values() if drive.kind != "constant_speed"]
    gears = [
        FirmGear(order.index(c.joints[0]), order.index(c.joints[1]), number(c.factor), number(offset))
        for c, offset in zip((c for c in page.couplings.values() if c.firm), offsets, strict=True)
    ]
    return Structure(bodies, joints, [order.index(joint) for joint in (*driven, *others)], gears)


@dataclass(frozen=True)
class Assembly:
    """A page's structure in numbers, and its initial pose."""

    page: Page

    @cached_property
    def structure(self) -> Structure:
        """The structure in numbers."""
        made = structure_of(self.page, float, self.offsets)
        try:
            size = made.size
        except StructureError as error:
            raise ConfigurationError(f"joints: {error}") from error
        if size > MOST_COORDINATES * 3:
            raise ConfigurationError(f"joints: {size} coordinates; expected at most {3 * MOST_COORDINATES}")
        return made

    @cached_property
    def firm(self) -> tuple[str, ...]:
        """The couplings without a stiffness: rigid ratios."""
        return tuple(name for name, coupling in self.page.couplings.items() if coupling.firm)

    @cached_property
    def _loose(self) -> Assembly:
        """The machine without its rigid couplings, which mesh in its initial pose."""
        couplings = {name: coupling for name, coupling in self.page.couplings.items() if not coupling.firm}
        return Assembly(self.page.model_copy(update={"couplings": couplings}))

    @cached_property
    def offsets(self) -> tuple[float, ...]:
        """Offset of each rigid coupling: second joint minus ratio times the first (rad or m)."""
        if not self.firm:
            return ()
        motion = Kinematics(self._loose.structure, self._loose.start.tolist())
        couplings = [self.page.couplings[name] for name in self.firm]
        places = {j: motion.joint_coordinates(self.joint_number(j))[0].value for c in couplings for j in c.joints}
        return tuple(float(places[c.joints[1]] - c.factor * places[c.joints[0]]) for c in couplings)  # type: ignore[arg-type]

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """The name of each coordinate of the tree."""
        joints = (self.structure.joints[branch.joint] for branch in self.structure.branches)
        return tuple(joint.name + part for joint in joints for part in PARTS[joint.kind])

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the coordinates of all joints, loop-closing ones included, in the order of the page."""
        return tuple(name + part for name, joint in self.page.joints.items() for part in PARTS[joint.kind])

    @cached_property
    def slides(self) -> frozenset[str]:
        """The coordinates that are lengths."""
        parts = {SLIDER: ("",), FREE: ("_x", "_y")}
        return frozenset(name + part for name, joint in self.page.joints.items() for part in parts.get(joint.kind, ()))

    @cached_property
    def driven_speeds(self) -> dict[int, float]:
        """Speed at full supply of each coordinate with a prescribed speed."""
        places = {name: j for j, name in enumerate(self.coordinates)}
        found = {}
        for name, drive in self.page.drives.items():
            if drive.kind != "constant_speed":
                continue
            if drive.joint not in places:
                raise ConfigurationError(
                    f"drives.{name}.joint: '{drive.joint}' closes a loop whose other joints are driven or welds already"
                )
            speed = drive.speed_m_per_s if drive.speed_rpm is None else drive.speed_rpm * RPM
            found[places[drive.joint]] = float(speed or 0.0)
        return found

    @cached_property
    def size_m(self) -> float:
        """Size of the machine (m): the largest coordinate of its points and of its joints at the start."""
        points = [self.page.ground.points_m, *(body.points_m for body in self.page.bodies.values())]
        reach = [math.hypot(*place) for there in points for place in there.values()]
        travels = [abs(x) for j in self.page.joints.values() for x in (j.start_m, j.start_x_m, j.start_y_m) if x]
        return max([*reach, *travels, 1e-3])

    @cached_property
    def _start_values(self) -> list[tuple[int, int, float]]:
        """Joint, component and value of each start value in the page."""
        found = []
        for number, joint in enumerate(self.page.joints.values()):
            found += [(number, part, x) for part, x in enumerate(joint.starts()) if x is not None]
        return found

    def _closures(self, s: Array) -> tuple[Array, Array]:
        """Return the loop closure errors and their Jacobian."""
        found = Kinematics(self.structure, s.tolist()).closures()
        values = np.array([float(c.value) for c in found])  # type: ignore[arg-type]
        return values, np.array([c.row for c in found], dtype=float).reshape(len(found), self.structure.size)

    def _closed_near(self, guess: Array) -> tuple[Array, float]:
        """Return the pose found from a guess by the Levenberg-Marquardt method, and its largest closure error."""
        s, damping, turning = guess.copy(), 1e-3, [name not in self.slides for name in self.coordinates]
        values, rows = self._closures(s)
        least = 1e-15 * max(1.0, self.size_m) ** 2  # of the damping: less is lost in the sum
        for _ in range(TURNS):
            if np.abs(values).max(initial=0.0) <= CLOSED * self.size_m or damping > 1e12:
                break
            pull = np.linalg.solve(rows.T @ rows + damping * np.eye(len(s)), -rows.T @ values)
            pull *= min(1.0, NEAR_RAD / np.abs(pull[turning]).max(initial=NEAR_RAD))
            trial_values, trial_rows = self._closures(s + pull)
            if np.linalg.norm(trial_values) < np.linalg.norm(values):
                s, values, rows, damping = s + pull, trial_values, trial_rows, max(0.2 * damping, least)
            else:
                damping *= 5.0
        return s, float(np.abs(values).max(initial=0.0))

    @cached_property
    def _guess(self) -> tuple[Array, NDArray[np.bool_]]:
        """Start value of each coordinate of the tree, and whether the page gives it."""
        guess, given = np.zeros(self.structure.size), np.zeros(self.structure.size, dtype=bool)
        for number, part, value in self._start_values:
            place = self.structure.first_coordinate.get(number)
            if place is not None:
                guess[place + part], given[place + part] = value, True
        return guess, given

    def _off(self, s: Array) -> float:
        """Return how far a pose is from the start values in the page, those of joints that close loops included."""
        motion, off = Kinematics(self.structure, s.tolist()), 0.0
        for number, part, value in self._start_values:
            joint, place = self.structure.joints[number], self.structure.first_coordinate.get(number)
            found = float(motion.joint_coordinates(number)[part].value) if place is None else s[place + part]  # type: ignore[arg-type]
            away = found - value
            if joint.name + PARTS[joint.kind][part] in self.slides:
                away /= self.size_m
            elif place is None:
                away = math.remainder(away, 2.0 * math.pi)
            off = math.hypot(off, away)
        return off

    @cached_property
    def near_start(self) -> Array:
        """The closed pose nearest to the start values in the page, of those that the search finds.

        Raises
        ------
        ConfigurationError
            No pose closes the loops.
        """
        if self.firm:
            return self._loose.start
        guess, given = self._guess
        slides = np.array([name in self.slides for name in self.coordinates], dtype=bool)
        rng, closed = np.random.default_rng(1), CLOSED * self.size_m
        best, miss = self._closed_near(guess)
        off = self._off(best)
        for trial in range(TRIALS):
            if miss <= closed and off <= NEAR:
                break
            spread = np.where(given, 0.02 if trial < TRIALS // 2 else 0.5, 1.0)
            scale = np.where(slides, self.size_m, math.pi)
            found, missed = self._closed_near(guess + spread * scale * rng.uniform(-1.0, 1.0, len(guess)))
            away = self._off(found)
            if (missed <= closed and away < NEARER * off) if miss <= closed else missed < miss:
                best, miss, off = found, missed, away
        if miss > closed:
            raise ConfigurationError(self._closure_error_text(best))
        turns = ~(given | slides)
        best[turns] = [math.remainder(angle, 2.0 * math.pi) for angle in best[turns]]
        return best

    def _closure_error_text(self, s: Array) -> str:
        """Return the error text for the loop with the largest closure error."""
        place, misses = 0, []
        values = self._closures(s)[0]
        for number in self.structure.loops:
            joint = self.structure.joints[number]
            count = 3 - COORDINATES[joint.kind]
            misses.append((float(np.abs(values[place : place + count]).max(initial=0.0)), joint))
            place += count
        miss, joint = max(misses, key=lambda pair: pair[0])
        first, second = self.structure.bodies[joint.first].name, self.structure.bodies[joint.second].name
        return (
            f"joints.{joint.name}: the loop through it cannot close: at best {first} and {second} miss each other by "
            f"{miss:.4g} {'m or rad' if joint.kind != REVOLUTE else 'm'}; check lengths of links and start values"
        )

    @cached_property
    def split(self) -> Split:
        """Which coordinates are free, driven and dependent.

        Raises
        ------
        ConfigurationError
            If loops or drives leave no degree of freedom, or are redundant.
        """
        structure = self.structure
        rows = self._closures(self.near_start)[1]
        freedoms, driven = structure.size - structure.closures, tuple(self.driven_speeds)
        if len(rows):
            values = np.linalg.svd(rows, compute_uv=False)
            if len(rows) > structure.size or values[len(rows) - 1] < 1e-7 * values[0]:
                raise ConfigurationError(self._redundant(rows))
        if freedoms <= 0:
            raise ConfigurationError("joints: no freedom is left: joints and couplings hold every body; take one away")
        if len(driven) > freedoms:
            raise ConfigurationError(
                f"drives: {', '.join(self.coordinates[j] for j in driven)} have a given speed, but the machine has "
                f"{freedoms} freedom{'s' if freedoms > 1 else ''}"
            )
        if freedoms - len(driven) > MOST_COORDINATES:
            raise ConfigurationError(f"joints: {freedoms} freedoms; expected at most {MOST_COORDINATES}")

        def regular(rest: tuple[int, ...]) -> bool:
            if len(rest) < len(rows) or not len(rows):
                return not len(rows)
            values = np.linalg.svd(rows[:, list(rest)], compute_uv=False)
            return bool(values[len(rows) - 1] > REGULAR * values[0])

        try:
            return split_of(structure.size, structure.closures, driven, self._order, regular)
        except StructureError as error:
            rests = [tuple(j for j in range(structure.size) if j not in driven[: k + 1]) for k in range(len(driven))]
            led = next((k for k, rest in enumerate(rests) if not regular(rest)), -1)
            one, *others = [self.coordinates[j] for j in (driven[led], *driven[:led])] if led >= 0 else [""]
            held = f"the loops hold {one}, which has a given speed; take one away; or"
            reason = f"joints: {held if one else f'{error};'}"
            if others:
                reason = f"drives: the loops lead {one} with {', '.join(others)}; give it no speed; or"
            raise ConfigurationError(f"{reason} the start is at a dead point, move it") from error

    def _redundant(self, rows: Array) -> str:
        """Return the error text for the first loop or coupling that is redundant (rank of the Jacobian)."""
        joints = [self.structure.joints[number] for number in self.structure.loops]
        parts = [(f"joints.{joint.name}", 3 - COORDINATES[joint.kind]) for joint in joints]
        place = 0
        for name, count in [*parts, *((f"couplings.{name}", 1) for name in self.firm)]:
            place += count
            values = np.linalg.svd(rows[:place], compute_uv=False)
            if place > self.structure.size or values[place - 1] < 1e-7 * values[0]:
                return (
                    f"{name}: the joints before it hold its bodies already, in the pose at the start; "
                    f"take a {name.partition('s.')[0]} away, or start away from the dead point"
                )
        return "joints: the loops hold each other"

    @property
    def _order(self) -> list[int]:
        """Coordinates in order of preference as independent: driven, free, turning with a start value, the others."""
        drives, started = [drive.joint for drive in self.page.drives.values()], self._guess[1]

        def rank(j: int) -> tuple[int, int]:
            branch = next(b for b in reversed(self.structure.branches) if b.coordinate <= j and self._count(b.joint))
            joint = self.structure.joints[branch.joint]
            if joint.name in drives:
                return 0, drives.index(joint.name)
            if joint.kind == FREE:
                return 1, j
            grounded = 0 in (joint.first, joint.second)
            turning = joint.kind == REVOLUTE and (grounded or started[j])
            return (2 if turning else 4) + (0 if grounded else 1), j

        return sorted(range(self.structure.size), key=rank)

    def _count(self, joint: int) -> int:
        return COORDINATES[self.structure.joints[joint].kind]

    @cached_property
    def start(self) -> Array:
        """The coordinates at the start: independent ones from the page, dependent ones from the loop closures.

        Raises
        ------
        ConfigurationError
            The loops do not close where the page starts.
        """
        if self.firm:
            return self._loose.start
        guess, given = self._guess
        s, split = self.near_start.copy(), self.split
        for j in split.led:
            s[j] = guess[j] if given[j] else s[j]
        return self.closed(s)

    def closed(self, s: Array) -> Array:
        """Return a pose with its dependent coordinates solved from the loop closures by Newton's method."""
        s, dependent = s.copy(), list(self.split.dependent)
        miss = 0.0
        for _ in range(TURNS):
            values, rows = self._closures(s)
            miss = float(np.abs(values).max(initial=0.0))
            if not dependent or miss <= 1e-15 * self.size_m:
                return s
            change = np.linalg.lstsq(rows[:, dependent], -values, rcond=None)[0]
            reach = np.abs(change).max()
            s[dependent] += change * min(1.0, 0.5 / reach) if reach > 0.0 else 0.0
            if reach <= 1e-15 * (1.0 + np.abs(s).max()):
                break
        if miss > 1e3 * CLOSED * self.size_m:
            raise ConfigurationError(self._closure_error_text(s))
        return s

    @cached_property
    def start_speeds(self) -> Array:
        """The speeds of the independent coordinates at the start.

        Raises
        ------
        ConfigurationError
            If the speeds in the page contradict each other.
        """
        from mech_twin.mechanics.dynamics import ReducedSystem

        split, fraction = self.split, self.page.supply.initial_fraction
        fixed = [fraction * self.driven_speeds[j] for j in split.driven]
        none: list[Number] = [0.0] * len(split.led)
        at = ReducedSystem(self.structure, split, self.start.tolist(), none, [0.0] * len(split.driven))
        rows, rights, owners = [], [], []
        for number, (name, joint) in enumerate(self.page.joints.items()):
            for part, speed in enumerate(joint.speeds()):
                if speed is not None:
                    rows.append(at.reduced(at.motion.joint_coordinates(number)[part].row))
                    rights.append(speed)
                    owners.append(name)
        n = len(split.free)
        if not rows or not n:
            return np.array([*[0.0] * n, *fixed])
        matrix, right = np.array(rows, dtype=float), np.array(rights) - np.array(rows, dtype=float)[:, n:] @ fixed
        free = np.linalg.lstsq(matrix[:, :n], right, rcond=None)[0]
        miss = np.abs(matrix[:, :n] @ free - right)
        if miss.max() > 1e-9 * (1.0 + np.abs(right).max()):
            worst = owners[int(miss.argmax())]
            raise ConfigurationError(
                f"joints.{worst}: the speed at the start contradicts other joints' by {miss.max():.4g}; leave it out"
            )
        return np.array([*free, *fixed])

    def joint_number(self, name: str) -> int:
        """Return the index of a joint."""
        return list(self.page.joints).index(name)

    def body_number(self, name: str) -> int:
        """Return the index of a body."""
        return [GROUND, *self.page.bodies].index(name)

# SPDX-License-Identifier: Apache-2.0
"""Drawing of a page: links between their points, blocks on guides, springs, walls; bodies carry their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, hypot, sin

from mech_twin.capabilities.figure import (
    CRANK,
    GROUND,
    ROD,
    SPRING,
    STEEL,
    TOOL,
    Colour,
    Point,
    bearing,
    circle,
    coil,
    hatched,
)
from mech_twin.machines.page.assembly import exact_turn
from mech_twin.machines.page.parameters import GROUND as GROUND_NAME
from mech_twin.machines.page.roles import PageModel
from mech_twin.mechanics.kinematics import Kinematics
from mech_twin.mechanics.recording import Expression, Number
from mech_twin.samples import LinkageSample, Shape

COLOURS: tuple[Colour, ...] = (CRANK, ROD, (80, 140, 60), TOOL, (150, 95, 185), (75, 115, 205))


def real(value: Number) -> float:
    """Return a number of a formulation that was run on numbers."""
    assert not isinstance(value, Expression)
    return float(value)


class PageDrawing:
    """Shapes of a page at the joint positions of a sample."""

    def __init__(self, shared: PageModel) -> None:
        self._shared, page = shared, shared.page
        self._points: dict[str, list[tuple[str, Point]]] = {name: [] for name in (GROUND_NAME, *page.bodies)}
        for joint in page.joints.values():
            for point in joint.between:
                self._keep(point)
        for between in (*(s.between for s in page.springs.values()), *(d.between for d in page.dampers.values())):
            for point in between or ():
                self._keep(point)
        for contact in page.contacts.values():
            if contact.point is not None:
                self._keep(contact.point)
        for name, body in page.bodies.items():
            for point in body.points_m:
                self._keep(f"{name}.{point}")
        far = [hypot(*at) for there in self._points.values() for _, at in there]
        self._size = max([*far, 0.2 * shared.assembly.size_m])
        self._width = 0.02 * max(self._size, shared.assembly.size_m)

    def _keep(self, point: str) -> None:
        body, place = self._shared.page.point(point)
        if all(hypot(place[0] - at[0], place[1] - at[1]) > 1e-9 for _, at in self._points[body]):
            self._points[body].append((point, place))

    def shapes(self, linkage: LinkageSample) -> tuple[Shape, ...]:
        """Return the drawing at a sample."""
        return self.shapes_at(dict(zip(linkage.joints, linkage.position, strict=True)))

    def shapes_at(self, places: Mapping[str, float]) -> tuple[Shape, ...]:
        """Return the drawing at positions of the joints."""
        page, assembly = self._shared.page, self._shared.assembly
        motion = Kinematics(assembly.structure, [places[name] for name in assembly.coordinates])
        frames = motion.frames

        def at(point: str) -> Point:
            body, place = page.point(point)
            found = motion.point(assembly.body_number(body), place)
            return real(found.x), real(found.y)

        made: list[Shape] = []
        sliding = self._guides(made, at, motion)
        for number, name in enumerate(page.bodies, 1):
            colour = COLOURS[(number - 1) % len(COLOURS)]
            frame = frames[number]
            origin, angle = (real(frame.x), real(frame.y)), real(frame.angle)
            spots = [at(point) for point, _ in self._points[name]]
            if name in sliding:
                made.append(Shape(f"{name}_block", "line", self._block(origin, angle), colour, 0.4 * self._width, name))
            if len(spots) == 1 and name not in sliding:
                made.append(Shape(name, "line", circle(origin, 2.5 * self._width), colour, 0.4 * self._width, name))
            elif len(spots) > 1:
                closed = (*spots, spots[0]) if len(spots) > 2 else tuple(spots)
                text = "" if name in sliding else name
                made.append(Shape(name, "line", closed, colour, self._width, text))
        self._elements(made, at, places)
        pins = [at(j.between[1]) for j in page.joints.values() if j.kind == "revolute"]
        if pins:
            made.append(Shape("pins", "points", tuple(pins), STEEL, self._width))
        return tuple(made)

    def _block(self, origin: Point, angle: float) -> tuple[Point, ...]:
        c, s, w = cos(angle), sin(angle), 2.0 * self._width
        corners = ((-1.5 * w, -w), (1.5 * w, -w), (1.5 * w, w), (-1.5 * w, w), (-1.5 * w, -w))
        return tuple((origin[0] + c * x - s * y, origin[1] + s * x + c * y) for x, y in corners)

    def _guides(self, made: list[Shape], at: Callable[[str], Point], motion: Kinematics) -> set[str]:
        """Draw bearings and guides on the ground; return the bodies that slide."""
        page, sliding = self._shared.page, set()
        for name, joint in page.joints.items():
            first, second = (page.point(point)[0] for point in joint.between)
            if joint.kind == "slider":
                sliding.add(second if second != GROUND_NAME else first)
                number = self._shared.assembly.body_number(first)
                x, y = motion.frames[number].turned(exact_turn(joint.direction_deg or 0.0))
                middle, reach = at(joint.between[1]), 6.0 * self._width
                foot = (middle[0] + 2.4 * self._width * real(y), middle[1] - 2.4 * self._width * real(x))
                ends = [(foot[0] + k * reach * real(x), foot[1] + k * reach * real(y)) for k in (-1.0, 1.0)]
                strip = hatched(ends[0], ends[1], self._width) if GROUND_NAME in (first, second) else tuple(ends)
                made.append(Shape(f"{name}_guide", "line", strip, GROUND, 0.2 * self._width))
            elif joint.kind == "revolute" and GROUND_NAME in (first, second):
                spot = at(joint.between[0] if first == GROUND_NAME else joint.between[1])
                made.append(Shape(f"{name}_frame", "line", bearing(spot, 1.6 * self._width), GROUND, 0.2 * self._width))
        return sliding

    def _elements(self, made: list[Shape], at: Callable[[str], Point], travel: Mapping[str, float]) -> None:
        page, w = self._shared.page, self._width
        for name, spring in page.springs.items():
            if spring.between is None:
                continue
            first, second = map(at, spring.between)
            shape = coil(first, second, w) if spring.gas is None else _chamber(first, second, 2.5 * w)
            made.append(Shape(name, "line", shape, SPRING, 0.3 * w, name))
        for name, damper in page.dampers.items():
            if damper.between is not None:
                made.append(Shape(name, "line", tuple(map(at, damper.between)), STEEL, 0.8 * w, name))
        for name, contact in page.contacts.items():
            joint = page.joints.get(contact.joint or "")
            if joint is not None and joint.kind == "slider" and page.point(joint.between[0])[0] == GROUND_NAME:
                x, y = exact_turn(joint.direction_deg or 0.0)
                limit = contact.least_m if contact.least_m is not None else contact.most_m or 0.0
                if contact.gives_way_n is not None:  # it moves with the tool
                    limit = travel[contact.joint or ""]
                side = -1.0 if contact.least_m is not None else 1.0
                spot = at(joint.between[0])
                reach = limit + side * 3.0 * w
                spot = (spot[0] + reach * x, spot[1] + reach * y)
                ends = [(spot[0] + k * 4.0 * w * y * side, spot[1] - k * 4.0 * w * x * side) for k in (1.0, -1.0)]
                made.append(Shape(name, "line", hatched(ends[0], ends[1], w), GROUND, 0.3 * w, name))
            elif contact.line is not None:
                x, y = exact_turn(contact.normal_deg or 0.0)
                body = self._shared.assembly.body_number(page.point(contact.line)[0])
                if body == 0:
                    spot = at(contact.line)
                    ends = [(spot[0] + k * 4.0 * w * y, spot[1] - k * 4.0 * w * x) for k in (-1.0, 1.0)]
                    made.append(Shape(name, "line", hatched(ends[0], ends[1], w), GROUND, 0.3 * w, name))


def _chamber(first: Point, second: Point, width: float) -> tuple[Point, ...]:
    """Return a box between two points: cylinder and piston of a gas spring."""
    length = hypot(second[0] - first[0], second[1] - first[1]) or 1.0
    x, y = -width * (second[1] - first[1]) / length, width * (second[0] - first[0]) / length
    corners = (first, second, second, first)
    signs = (1.0, 1.0, -1.0, -1.0, 1.0)
    return tuple((px + k * x, py + k * y) for (px, py), k in zip((*corners, first), signs, strict=True))

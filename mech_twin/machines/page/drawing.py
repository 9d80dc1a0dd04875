# SPDX-License-Identifier: Apache-2.0
"""Drawing of a page: links between their points, blocks on guides, springs, walls; bodies carry their names."""

from collections.abc import Callable, Mapping
from fractions import Fraction
from math import atan2, cos, hypot, pi, sin

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
    spiral,
    toothed,
)
from mech_twin.machines.page.assembly import exact_turn
from mech_twin.machines.page.parameters import GROUND as GROUND_NAME
from mech_twin.machines.page.parameters import distinct
from mech_twin.machines.page.roles import PageModel
from mech_twin.mechanics.code_generation import Expression, Number
from mech_twin.mechanics.kinematics import Kinematics
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
        self._turning(made, at, motion)
        pins = [at(j.between[1]) for j in page.joints.values() if j.kind == "revolute"]
        if pins:
            made.append(Shape("pins", "points", tuple(pins), STEEL, self._width))
        drawn: dict[str, Shape] = {}
        for shape in made:
            name = distinct("drawn", shape.name, drawn)
            drawn[name] = shape._replace(name=name)
        return tuple(drawn.values())

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

    def _turning(self, made: list[Shape], at: Callable[[str], Point], motion: Kinematics) -> None:
        """Draw turning springs as spirals, gears in mesh, belts about their wheels, racks on their pinions."""
        page, w, body_number = self._shared.page, self._width, self._shared.assembly.body_number

        def turned(joint: str, end: int) -> float:
            return real(motion.frames[body_number(page.point(page.joints[joint].between[end])[0])].angle)

        def wheel(joint: str) -> float:
            on_ground = page.point(page.joints[joint].between[1])[0] == GROUND_NAME
            return turned(joint, 0 if on_ground else 1)

        for name, spring in page.springs.items():
            if spring.joint is not None and page.joints[spring.joint].kind == "revolute":
                spot = at(page.joints[spring.joint].between[0])
                strip = spiral(spot, w, 4.0 * w, turned(spring.joint, 1), turned(spring.joint, 0))
                made.append(Shape(name, "line", strip, SPRING, 0.3 * w, name))
        for name, coupling in page.couplings.items():
            first, second = (at(page.joints[joint].between[0]) for joint in coupling.joints)
            if coupling.slides:
                rack = page.joints[coupling.joints[1]]
                axis = exact_turn(rack.direction_deg or 0.0)
                x, y = map(real, motion.frames[body_number(page.point(rack.between[0])[0])].turned(axis))
                made += _rack(name, first, coupling.factor, wheel(coupling.joints[0]), (x, y))
            elif coupling.kind != "shaft":
                angle = wheel(coupling.joints[0])
                draw = _belt if coupling.kind == "belt" else _mesh
                made += draw(name, first, second, coupling.factor, angle)

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


TEETH = 10  # of the smaller gear


def _mesh(name: str, first: Point, second: Point, ratio: float, angle: float) -> list[Shape]:
    """Return two gears in mesh by their centres and ratio, the first turned by an angle; none on one centre."""
    x, y = second[0] - first[0], second[1] - first[1]
    apart, size = hypot(x, y), abs(ratio)
    between = apart / (1.0 - ratio) if ratio < 0.0 else apart / abs(1.0 - ratio) if ratio != 1.0 else 0.0
    if between < 1e-9:
        return []
    share = Fraction(size).limit_denominator(20)  # of their teeth: a drawn gear has whole ones
    times = -(-TEETH // max(1, min(share.numerator, share.denominator)))
    teeth = max(3, times * share.numerator), max(3, times * share.denominator)
    height = 0.4 * pi * between / teeth[1]
    towards = atan2(y, x) + (pi if 0.0 < ratio < 1.0 else 0.0)  # in which they touch, from the first
    phase = teeth[0] * (towards - angle)
    other = towards + pi - (pi - phase) / teeth[1] if ratio < 0.0 else towards - (phase + pi) / teeth[1]
    strips = toothed(first, size * between, teeth[0], angle, height), toothed(second, between, teeth[1], other, height)
    ends = zip(("first", "second"), strips, strict=True)
    return [Shape(f"{name}_{end}", "line", strip, STEEL, 0.3 * height) for end, strip in ends]


def _belt(name: str, first: Point, second: Point, ratio: float, angle: float) -> list[Shape]:
    """Return two wheels and the strands of a belt about them."""
    x, y = second[0] - first[0], second[1] - first[1]
    apart = hypot(x, y)
    if apart < 1e-9:
        return []
    least = 0.3 * apart / max(1.0, ratio)
    radii, thick = (ratio * least, least), 0.03 * apart
    lean, towards = (radii[0] - radii[1]) / apart, atan2(y, x)
    wheels = _spoked(first, radii[0], angle), _spoked(second, radii[1], ratio * angle)
    made = [Shape(f"{name}_{i}", "line", wheel, STEEL, 0.5 * thick) for i, wheel in enumerate(wheels)]
    across = (1.0 - lean * lean) ** 0.5
    for side, sign in (("upper", 1.0), ("lower", -1.0)):
        u = lean * cos(towards) - sign * across * sin(towards), lean * sin(towards) + sign * across * cos(towards)
        ends = tuple((p[0] + r * u[0], p[1] + r * u[1]) for p, r in zip((first, second), radii, strict=True))
        made.append(Shape(f"{name}_{side}", "line", ends, STEEL, thick))
    return made


def _spoked(centre: Point, radius: float, angle: float) -> tuple[Point, ...]:
    """Return a circle with a spoke that shows how it is turned."""
    ring = circle((0.0, 0.0), radius)
    c, s = cos(angle), sin(angle)
    return (centre, *((centre[0] + c * x - s * y, centre[1] + s * x + c * y) for x, y in ring))


def _rack(name: str, centre: Point, radius: float, angle: float, axis: Point) -> list[Shape]:
    """Return a pinion and the rack that it drives along a direction."""
    size, teeth = abs(radius), 2 * TEETH
    height, pitch, sign = 0.4 * pi * size / teeth, 2.0 * pi * size / teeth, 1.0 if radius > 0.0 else -1.0
    normal = (sign * axis[1], -sign * axis[0])  # from the centre to where they touch
    phase = atan2(normal[1], normal[0]) - angle
    travel = -sign * size * phase + 0.5 * pitch  # of a gap, which meets the tooth
    begin = travel % pitch - (TEETH // 2 + 1) * pitch
    strip: list[Point] = []
    for i in range(2 * TEETH + 4):
        reach, middle = size + (height if i % 2 else -height), begin + 0.5 * i * pitch
        foot = centre[0] + reach * normal[0], centre[1] + reach * normal[1]
        strip += [
            (foot[0] + s * axis[0], foot[1] + s * axis[1]) for s in (middle - 0.25 * pitch, middle + 0.25 * pitch)
        ]
    pinion = toothed(centre, size, teeth, angle, height)
    return [
        Shape(f"{name}_pinion", "line", pinion, STEEL, 0.3 * height),
        Shape(f"{name}_rack", "line", tuple(strip), STEEL, 0.3 * height),
    ]

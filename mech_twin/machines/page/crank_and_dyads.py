# SPDX-License-Identifier: Apache-2.0
"""A page from a configuration of the former machine ``planar_linkage``: a crank, and up to four dyads on it.

Each link becomes a body of its name, each pin a joint of its name.  A dyad hangs on links before it by A and B::

    rrr   A first C second B      two pinned links      C left of A to B for the branch plus
    rrp   A first C on a guide    a link and a slider   C ahead of A for the branch plus
    rpr   block in A, bar from B  a block on a bar
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mech_twin.declarations.configuration_tree import ConfigurationError

GRAVITY = 9.80665
LENGTHS = {"rrr": ("first_m", "second_m"), "rrp": ("first_m",), "rpr": ()}
Point = tuple[float, float]


class _FormerGroup:
    """A group of a configuration, its keys taken one by one; what is left over was never a key."""

    def __init__(self, values: Any, name: str = "") -> None:
        self.name = name
        if not isinstance(values, Mapping):
            raise ConfigurationError(f"key '{name}', value {values!r}: expected a group")
        self.values = dict(values)

    def _refused(self, key: str, expected: str) -> ConfigurationError:
        shown = f", value {self.values[key]!r}" if key in self.values else ""
        return ConfigurationError(f"key '{f'{self.name}.{key}'.lstrip('.')}'{shown}: expected {expected}")

    def number(self, key: str, default: float | None = None) -> float:
        """Take a number."""
        value = self.values.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self._refused(key, "a number")
        self.values.pop(key, None)
        return float(value)

    def word(self, key: str, known: tuple[str, ...], default: str = "") -> str:
        """Take one of some words."""
        value = self.values.get(key, default)
        if value not in known:
            raise self._refused(key, f"one of {', '.join(known)}")
        self.values.pop(key, None)
        return str(value)

    def group(self, key: str, default: Mapping[str, float] | None = None) -> _FormerGroup:
        """Take a group."""
        if key not in self.values and default is None:
            raise self._refused(key, "a group")
        return _FormerGroup(self.values.pop(key, default), f"{self.name}.{key}".lstrip("."))

    def done(self) -> None:
        """Refuse a key that was not taken."""
        for key in self.values:
            raise self._refused(key, "no such key in a planar_linkage")


class _PageOfLinks:
    """The page as it is made, and the frame of each link with the crank at 0: angle (rad), origin (m)."""

    def __init__(self) -> None:
        self.frames = {"ground": (0.0, 0.0, 0.0), "crank": (0.0, 0.0, 0.0)}
        self.lengths = {"ground": 0.0, "crank": 0.0}
        self.ground: dict[str, Any] = {}
        self.bodies: dict[str, Any] = {}
        self.joints: dict[str, Any] = {}

    def spot(self, link: str, at: Point) -> Point:
        """Return where a point of a link is (m)."""
        angle, x, y = self.frames[link]
        c, s = math.cos(angle), math.sin(angle)
        return x + c * at[0] - s * at[1], y + s * at[0] + c * at[1]

    def point(self, link: str, name: str, at: Point) -> str:
        """Return the name of a point of a link, which is noted unless it is the origin of the link's frame."""
        if at == (0.0, 0.0):
            return link
        there = self.ground if link == "ground" else self.bodies[link].setdefault("points_m", {})
        there[name] = list(at)
        return f"{link}.{name}"

    def link(
        self, name: str, mass: _FormerGroup, length: float, frame: tuple[float, float, float], more: float = 0.0
    ) -> None:
        """Add a link as a body, with its end as a point; ``more`` is inertia of a flywheel (kg m2)."""
        centre = [mass.number("centre_x_m", 0.0), mass.number("centre_y_m", 0.0)]
        sizes = {"mass_kg": mass.number("mass_kg", 0.0), "inertia_kg_m2": mass.number("inertia_kg_m2", 0.0) + more}
        body: dict[str, Any] = {key: size for key, size in sizes.items() if size}
        body |= {"centre_m": centre} if any(centre) else {}
        mass.done()
        self.bodies[name], self.frames[name], self.lengths[name] = body, frame, length
        if length > 0.0:
            self.point(name, "end", (length, 0.0))

    def end(self, link: str) -> str:
        """Return the name of a link's end."""
        return f"{link}.end" if self.lengths[link] > 0.0 else link

    def pin(self, name: str, first: str, second: str) -> None:
        """Add a pin; its angle at the start follows from the links' frames."""
        turned = self.frames[_body(second)][0] - self.frames[_body(first)][0]
        angle = round(math.degrees(math.remainder(turned, 2.0 * math.pi)), 9)
        self.joints[name] = {"kind": "revolute", "between": [first, second], "start_deg": angle + 0.0}

    def guide(self, name: str, first: str, second: str, degrees: float, travel: float) -> None:
        """Add a guide along which a body slides without turning."""
        self.joints[name] = {"kind": "slider", "between": [first, second], "start_m": round(travel, 12)}
        if degrees:
            self.joints[name] |= {"direction_deg": degrees, "turned_deg": degrees}

    def dyad(self, key: str, dyad: _FormerGroup) -> None:
        """Add a dyad: its two links, and the three joints that it hangs and closes by."""
        kind, branch = dyad.word("kind", tuple(LENGTHS)), dyad.word("branch", ("plus", "minus"), "plus")
        links, sign = tuple(self.frames), 1.0 if branch == "plus" else -1.0
        start, to = dyad.word("from_link", links), dyad.word("to_link", links, "ground")
        at = dyad.number("from_x_m", self.lengths[start]), dyad.number("from_y_m", 0.0)
        on = dyad.number("to_x_m", 0.0), dyad.number("to_y_m", 0.0)
        sizes = [
            dyad.number(f"{name}_m", None if f"{name}_m" in LENGTHS[kind] else 0.0) for name in ("first", "second")
        ]
        guide_deg = dyad.number("guide_deg", 0.0)
        masses = [dyad.group(name, {}) for name in ("first", "second")]
        dyad.done()
        a, b = self.spot(start, at), self.spot(to, on)
        first, second = f"{key}_first", f"{key}_second"
        (turned, away), c = (self.frames[to][0] + math.radians(guide_deg), 0.0), b
        if kind == "rrr":
            c = _hinge(key, a, b, sizes, sign)
        elif kind == "rrp":
            away = _along_guide(key, a, b, turned, sizes[0], sign)
            c = b[0] + away * math.cos(turned), b[1] + away * math.sin(turned)
        angle = math.atan2(c[1] - a[1], c[0] - a[0])
        frames = {
            "rrr": ((angle, *a), (math.atan2(c[1] - b[1], c[0] - b[0]), *b)),
            "rrp": ((angle, *a), (turned, *c)),
            "rpr": ((math.atan2(a[1] - b[1], a[0] - b[0]), *a), (math.atan2(a[1] - b[1], a[0] - b[0]), *b)),
        }[kind]
        hung = self.end(start) if at == (self.lengths[start], 0.0) else self.point(start, f"{key}_from", at)
        held = self.point(to, f"{key}_to", on)
        for name, mass, length, frame in zip((first, second), masses, sizes, frames, strict=True):
            self.link(name, mass, length, frame)
        self.pin(f"{key}_from", hung, first)
        if kind == "rpr":
            self.guide(f"{key}_between", second, first, 0.0, math.dist(a, b))
        else:
            self.pin(f"{key}_between", self.end(first), self.end(second))
        if kind == "rrp":
            self.guide(f"{key}_to", held, second, guide_deg, away)
        else:
            self.pin(f"{key}_to", held, second)

    def stroke(self, stroke: _FormerGroup) -> dict[str, Any]:
        """Return a resistance of the guide along which a tool works: its own, or that of a body that goes with it."""
        link, at = stroke.word("link", tuple(self.bodies)), (stroke.number("x_m", 0.0), stroke.number("y_m", 0.0))
        degrees, force = stroke.number("direction_deg"), stroke.number("force_n")
        stroke.done()
        guide = self.joints.get(f"{link[:6]}_to", {})
        along = guide.get("direction_deg", 0.0) - degrees
        own = guide.get("kind") == "slider" and link.endswith("second") and _body(guide["between"][0]) == "ground"
        if own and along % 180.0 == 0.0:
            way = "forward" if along % 360.0 == 0.0 else "backward"
            return {"joint": f"{link[:6]}_to", f"against_{way}_n": force}
        tool, (x, y), angle = self.point(link, "tool", at), self.spot(link, at), math.radians(degrees)
        c, s = math.cos(angle), math.sin(angle)
        self.bodies |= {"tool_along": {}, "tool_across": {}}
        self.frames |= {"tool_along": (angle, c * x, s * x), "tool_across": (angle, x, y)}
        self.guide("tool_stroke", "ground", "tool_along", degrees, c * x + s * y)
        self.guide("tool_aside", "tool_along", "tool_across", 0.0, c * y - s * x)
        self.joints["tool_aside"]["direction_deg"] = 90.0
        self.pin("tool_pin", tool, "tool_across")
        return {"joint": "tool_stroke", "against_forward_n": force}


def _body(point: str) -> str:
    return point.partition(".")[0]


def _hinge(key: str, a: Point, b: Point, sizes: list[float], sign: float) -> Point:
    """Return the pin between two links, left of the line from A to B for the sign +1."""
    x, y, apart = b[0] - a[0], b[1] - a[1], math.dist(a, b)
    first, second = sizes
    along = (first * first - second * second + apart * apart) / (2.0 * apart) if apart else math.inf
    if not abs(along) < first:
        raise ConfigurationError(f"key '{key}': the links do not meet with the crank at 0; expected a crank that turns")
    across = sign * math.sqrt(first * first - along * along)
    return a[0] + (along * x - across * y) / apart, a[1] + (along * y + across * x) / apart


def _along_guide(key: str, a: Point, b: Point, angle: float, length: float, sign: float) -> float:
    """Return the travel of a slider along its guide (m), ahead of the foot of A on it for the sign +1."""
    c, s = math.cos(angle), math.sin(angle)
    x, y = a[0] - b[0], a[1] - b[1]
    if not abs(c * y - s * x) < length:
        raise ConfigurationError(f"key '{key}': first_m does not reach the guide with the crank at 0; expected more")
    return c * x + s * y + sign * math.sqrt(length * length - (c * y - s * x) * (c * y - s * x))


def page_of(former: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tree of a page from that of a ``planar_linkage``.

    Raises
    ------
    ConfigurationError
        Naming key, value and what was expected.
    """
    given, made = _FormerGroup(former), _PageOfLinks()
    crank = given.group("crank")
    flywheel, length = crank.number("flywheel_kg_m2", 0.0), crank.number("length_m")
    made.link("crank", crank.group("mass", {}), length, made.frames["crank"], flywheel)
    crank.done()
    made.pin("crank_bearing", "ground", "crank")
    for number in range(1, 5):
        if number == 1 or f"dyad_{number}" in given.values:
            made.dyad(f"dyad_{number}", given.group(f"dyad_{number}"))
    loads: dict[str, Any] = {}
    springs: dict[str, Any] = {}
    for key in [key for key in ("load_1", "load_2", "load_3") if key in given.values]:
        load = given.group(key)
        link, at = load.word("link", tuple(made.bodies)), (load.number("x_m"), load.number("y_m", 0.0))
        force = [load.number("force_x_n", 0.0), load.number("force_y_n", 0.0)]
        loads[key] = {"point": made.point(link, key, at), "force_n": force}
        load.done()
    for key in [key for key in ("spring_1", "spring_2") if key in given.values]:
        spring = given.group(key)
        link, at = spring.word("link", tuple(made.bodies)), (spring.number("x_m"), spring.number("y_m", 0.0))
        foot = made.point("ground", key, (spring.number("ground_x_m"), spring.number("ground_y_m")))
        springs[key] = {"between": [foot, made.point(link, key, at)]}
        springs[key] |= {name: spring.number(name) for name in ("rate_n_per_m", "free_m")}
        spring.done()
    if "working_stroke" in given.values:
        loads["working_stroke"] = made.stroke(given.group("working_stroke"))
    page: dict[str, Any] = {
        "name": "linkage", "gravity_m_per_s2": [0.0, -given.number("gravity_m_per_s2", GRAVITY)],
        "ground": {"points_m": made.ground}, "bodies": made.bodies, "joints": made.joints,
        "drives": {"motor": _drive(given)}, "springs": springs, "loads": loads,
    }  # fmt: skip
    friction = given.group("friction", {})
    coulomb, viscous = friction.number("coulomb_nm", 0.0), friction.number("viscous_nms_per_rad", 0.0)
    friction.done()
    rubbing: dict[str, Any] = {"joint": "crank_bearing"}
    if coulomb:
        page["friction"] = {"shaft": rubbing | {"coulomb_nm": coulomb}}
    if viscous:
        page["dampers"] = {"oil": rubbing | {"rate_nms_per_rad": viscous}}
    page["supply"] = given.values.pop("supply", {"initial_fraction": 1.0, "rate_per_s": 2.0})
    page["coupling"] = given.values.pop("coupling", {"step_s": 0.0005})
    given.done()
    return {key: value for key, value in page.items() if value}


def _drive(given: _FormerGroup) -> dict[str, Any]:
    """Return the drive of the crank; one that turns it clockwise has a gear of negative ratio."""
    drive, made = given.group("drive"), {"joint": "crank_bearing"}
    kind, speed = drive.word("kind", ("constant_speed", "kloss")), drive.number("speed_rpm")
    drive.done()
    motor, gear = given.values.pop("motor", None), given.group("gear", {"ratio": 1.0})
    ratio, efficiency = gear.number("ratio"), gear.number("efficiency", 1.0)
    gear.done()
    if kind == "constant_speed":
        return {"kind": kind, **made, "speed_rpm": speed}
    return {
        "kind": "induction_motor", **made, "motor": motor, "gear_ratio": math.copysign(ratio, speed),
        "gear_efficiency": efficiency,
    }  # fmt: skip

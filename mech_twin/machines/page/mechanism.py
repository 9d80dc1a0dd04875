# SPDX-License-Identifier: Apache-2.0
"""Frames of a page: of each body, and of each pin with the axes of the machine; loops are cut at their joints."""

import math
from itertools import pairwise

from mech_twin.capabilities.figure import Point
from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, Inertia, Joint, Loop, fixed, sliding, turning
from mech_twin.machines.page.drawing import COLOURS
from mech_twin.machines.page.elements import DEGREE
from mech_twin.machines.page.parameters import GROUND, Page, distinct
from mech_twin.machines.page.roles import PageModel
from mech_twin.mechanics.structure import FREE, REVOLUTE, SLIDER, Branch

REACH = 10.0  # of the machine's size: a joint slides no further, for the description


def frame_of(name: str) -> str:
    """Return the frame of a body or a pin: its name, unless the root has that."""
    return distinct("frame", name, (ROOT,))


class Frames:
    """Builder of the tree of frames; it stores the joints and the rotation angle of each body."""

    def __init__(self, shared: PageModel) -> None:
        self.shared, self.joints = shared, list[Joint]()
        self.turns: dict[str, tuple[tuple[tuple[str, float], ...], float]] = {ROOT: ((), 0.0)}

    @property
    def page(self) -> Page:
        """The page."""
        return self.shared.page

    def own(self, name: str) -> str:
        """Return the name of a frame that is neither a body's nor a pin's."""
        return distinct("frames", name, self.page.named)

    def body(self, number: int) -> str:
        """Return the frame of a body."""
        name = [GROUND, *self.page.bodies][number]
        return ROOT if number == 0 else frame_of(name)

    def place(self, branch: Branch) -> None:
        """Add the frames from a body to the next along a joint of the tree."""
        name, joint = list(self.page.joints.items())[branch.joint]
        (_, first_at), (_, second_at) = (self.page.point(point) for point in joint.between)
        onward = branch.child == self.shared.assembly.structure.joints[branch.joint].second
        near, far, sense = (first_at, second_at, 1.0) if onward else (second_at, first_at, -1.0)
        parent, child = self.body(branch.parent), self.body(branch.child)
        turned, angle = self.turns[parent]
        seat, by = self.own(f"{name}_seat"), sense * (joint.turned_deg or 0.0) * DEGREE
        if joint.kind == REVOLUTE:
            self.joints.append(turning(name, parent, seat, near, ratio=sense))
            turned = (*turned, (name, sense))
        elif joint.kind == FREE:
            seat, turned = self._free(name, parent, near, sense), (*turned, (f"{name}_angle", sense))
        else:
            self.joints.append(fixed(parent, seat, near, by))
            angle += by
            if joint.kind == SLIDER:
                direction = (joint.direction_deg or 0.0) * DEGREE - (by if onward else 0.0)
                axis = sense * math.cos(direction), sense * math.sin(direction)
                onto = self.own(f"{name}_slide")
                self._slide(name, seat, onto, axis)
                seat = onto
        self.turns[child] = (turned, angle)
        self.joints.append(fixed(seat, child, (-far[0], -far[1])))

    def _slide(self, name: str, parent: str, child: str, axis: Point) -> None:
        self.joints.append(sliding(name, parent, child, axis, REACH * self.shared.assembly.size_m))

    def _free(self, name: str, parent: str, near: Point, sense: float) -> str:
        """Add the three frames of a body that flies; return the last."""
        seat, *ends = (self.own(f"{name}_{part}") for part in ("seat", "first", "second", "third"))
        self.joints.append(fixed(parent, seat, near))
        if sense > 0.0:
            self._slide(f"{name}_x", seat, ends[0], (1.0, 0.0))
            self._slide(f"{name}_y", ends[0], ends[1], (0.0, 1.0))
            self.joints.append(turning(f"{name}_angle", ends[1], ends[2]))
        else:
            self.joints.append(turning(f"{name}_angle", seat, ends[0], ratio=-1.0))
            self._slide(f"{name}_x", ends[0], ends[1], (-1.0, 0.0))
            self._slide(f"{name}_y", ends[1], ends[2], (0.0, -1.0))
        return ends[2]

    def pin(self, name: str, point: str) -> None:
        """Add the frame of a pin at a point, turned back to the axes of the machine."""
        body, at = self.page.point(point)
        parent = ROOT if body == GROUND else frame_of(body)
        turned, angle = self.turns[parent]
        frames = [*(self.own(f"{name}_back_{i}") for i in range(len(turned))), frame_of(name)]
        self.joints.append(fixed(parent, frames[0], at, -angle))
        for before, after, (joint, sense) in zip(frames, frames[1:], reversed(turned), strict=False):
            self.joints.append(turning(joint, before, after, ratio=-sense))


def mechanism(shared: PageModel) -> FrameTree:
    """Return the frames of a page."""
    page, structure = shared.page, shared.assembly.structure
    frames = Frames(shared)
    for branch in structure.branches:
        frames.place(branch)
    for name, joint in page.joints.items():
        if joint.kind != FREE:
            frames.pin(name, joint.between[1])
    for name, contact in page.contacts.items():
        frames.pin(name, contact.point or page.joints[contact.joint or ""].between[1])
    loops, names = [], list(page.joints)
    for number in structure.loops:
        joint = page.joints[names[number]]
        if joint.kind == REVOLUTE:
            other = frames.own(f"{names[number]}_other")
            frames.pin(other, joint.between[0])
            loops.append(Loop(frame_of(names[number]), other))
    carried = {joint.name for joint in frames.joints}
    lengths = tuple(name for name in shared.assembly.columns if name in shared.assembly.slides - carried)
    sliders = tuple(n for n, d in page.drives.items() if not d.turns)
    masses = tuple(
        Inertia(frame_of(n), b.mass_kg, (b.centre_m[0], b.centre_m[1]), b.inertia_kg_m2) for n, b in page.bodies.items()
    )
    mass_remarks = tuple(
        f"{name}: {body.inertia_kg_m2:g} kg m2 without a mass, of which no link has an inertia"
        for name, body in page.bodies.items()
        if body.inertia_kg_m2 > 0.0 == body.mass_kg
    )
    driven = sorted((drive.joint for drive in page.drives.values()), key=lambda n: page.joints[n].kind != REVOLUTE)
    return FrameTree(
        tuple(frames.joints), tuple(loops), _bars(shared), (*lengths, *sliders), masses, mass_remarks,
        next(iter(driven), ""), shared.turning_stops,
    )  # fmt: skip


def _bars(shared: PageModel) -> tuple[Bar, ...]:
    width = 0.03 * shared.assembly.size_m
    found = []
    for k, (name, body) in enumerate(shared.page.bodies.items()):
        ends = [(0.0, 0.0), *body.points_m.values()]
        for tail, head in pairwise(ends):
            found.append(Bar(frame_of(name), tail, head, width, COLOURS[k % len(COLOURS)]))
        if len(ends) == 1:
            found.append(Bar(frame_of(name), (-width, 0.0), (width, 0.0), width, COLOURS[k % len(COLOURS)]))
    return tuple(found)

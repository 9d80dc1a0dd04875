# SPDX-License-Identifier: Apache-2.0
"""Frames of a page lie where its bodies and pins are, pins have the axes of the machine, loops close."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from catalogue import PAGES
from mechanics.random_structures import coordinates_of, thrown
from urdf_parser_py.urdf import URDF

from mech_twin.capabilities.mechanism import POINT_M, poses, urdf
from mech_twin.machines.page.drawing import PageDrawing
from mech_twin.machines.page.mechanism import mechanism
from mech_twin.machines.page.parameters import Page
from mech_twin.machines.page.roles import PageModel
from mech_twin.mechanics.kinematics import Kinematics
from mech_twin.parameters.load import machine_parameters


def as_page(structure, s):
    """Return the page of a random structure without loops, in a pose."""
    names = [body.name for body in structure.bodies]
    ground, bodies, joints = {}, {}, {}
    for name, body in zip(names[1:], structure.bodies[1:], strict=True):
        bodies[name] = {"mass_kg": body.mass, "inertia_kg_m2": body.inertia, "points_m": {}}
    for number, joint in enumerate(structure.joints):
        ends = []
        for body, at, side in ((joint.first, joint.first_at, "a"), (joint.second, joint.second_at, "b")):
            there = ground if body == 0 else bodies[names[body]]["points_m"]
            there[f"p{number}{side}"] = tuple(map(float, at))
            ends.append(f"{names[body]}.p{number}{side}")
        place = structure.first_coordinate[number]
        made = {"kind": joint.kind, "between": tuple(ends)}
        if joint.kind == "revolute":
            made["start_deg"] = math.degrees(s[place])
        if joint.kind == "slider":
            made |= {"direction_deg": math.degrees(math.atan2(joint.axis[1], joint.axis[0])), "start_m": s[place]}
        if joint.kind in ("slider", "weld"):
            made["turned_deg"] = math.degrees(joint.turned[0])
        if joint.kind == "free":
            made |= {"start_x_m": s[place], "start_y_m": s[place + 1], "start_deg": math.degrees(s[place + 2])}
        joints[joint.name] = made
    return Page.model_validate({"ground": {"points_m": ground}, "bodies": bodies, "joints": joints})


@pytest.mark.parametrize("seed", range(40))
def test_frames_of_random_trees_lie_where_the_bodies_are(seed):
    structure, there = thrown(np.random.default_rng(seed), 5, 0)
    shared = PageModel(as_page(structure, coordinates_of(structure, there)))
    tree = mechanism(shared)
    positions = dict(zip(shared.assembly.coordinates, shared.assembly.start, strict=True))
    found = poses(tree, positions)
    for body, (x, y, angle) in zip(structure.bodies[1:], there[1:], strict=True):
        assert found[body.name][:2] == pytest.approx((x, y), abs=1e-9)
        assert math.remainder(found[body.name].angle_rad - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("path", PAGES)
def test_pins_have_the_axes_of_the_machine_and_loops_close(path):
    shared = PageModel(machine_parameters(path))
    tree, assembly = mechanism(shared), shared.assembly
    s = assembly.start.copy()
    first = (*assembly.split.driven, *assembly.split.free)[0]
    for _ in range(4):
        s[first] += 0.02
        s = assembly.closed(s)
        motion = Kinematics(assembly.structure, s.tolist())
        found = poses(tree, dict(zip(assembly.coordinates, s, strict=True)))
        for number, (name, joint) in enumerate(shared.page.joints.items()):
            if joint.kind == "free":
                continue
            made = assembly.structure.joints[number]
            point = motion.point(made.second, made.second_at)
            assert found[name][:2] == pytest.approx((point.x, point.y), abs=1e-9)
            assert math.remainder(found[name].angle_rad, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
        for loop in tree.loops:
            assert found[loop.first][:2] == pytest.approx(found[loop.second][:2], abs=1e-9)


@pytest.mark.parametrize("path", PAGES)
def test_a_foreign_parser_reads_the_description(path):
    shared = PageModel(machine_parameters(path))
    robot = URDF.from_xml_string(urdf(shared.page.name, mechanism(shared)))
    assert set(shared.page.bodies) <= {link.name for link in robot.links}


@pytest.mark.parametrize("path", PAGES)
def test_the_description_of_a_page_holds_the_masses_of_its_bodies(path: str) -> None:
    page = machine_parameters(path).expanded
    text = urdf("page", mechanism(PageModel(page)))
    robot = URDF.from_xml_string(text.encode())
    found = {link.name: link.inertial for link in robot.links if link.inertial}
    assert found.keys() == {name for name, body in page.bodies.items() if body.mass_kg > 0.0}
    for name, inertial in found.items():
        body = page.bodies[name]
        told = body.inertia_kg_m2 or body.mass_kg * POINT_M**2
        assert (inertial.mass, inertial.inertia.izz) == pytest.approx((body.mass_kg, told), rel=1e-14)
        assert tuple(inertial.origin.xyz) == pytest.approx((*body.centre_m, 0.0), rel=1e-14)
        moments = np.linalg.eigvalsh(inertial.inertia.to_matrix())
        assert moments[0] > 0.0 and moments[2] <= moments[0] + moments[1]  # those of a body: a reader refuses others
    for name in page.bodies.keys() - found.keys():
        massless = page.bodies[name].inertia_kg_m2
        assert (f"{name}: {massless:g} kg m2 without a mass" in text) == (massless > 0.0)


@pytest.mark.parametrize(
    "name", ["machine", "crank_pin_seat", "crank_bearing_back_0", "guide_slide", "wrist_pin_other", "pins"]
)
def test_the_name_of_a_body_hides_no_frame_and_no_shape(name):
    path = next(path for path in PAGES if path.endswith("slider_crank.yaml"))
    text = Path(path).read_text(encoding="utf-8")
    seen = []
    for body in ("rod", name):
        tree = yaml.safe_load(re.sub(r"\brod\b", body, text))
        shared = PageModel(Page.model_validate(tree))
        frames = mechanism(shared)
        places = dict(zip(shared.assembly.coordinates, shared.assembly.start, strict=True))
        shapes = PageDrawing(shared).shapes_at(places)
        seen.append((sorted(poses(frames, places).values()), sorted(str(shape.points_m) for shape in shapes)))
        assert len(set(frames.frames)) == len(frames.frames)
        assert len({shape.name for shape in shapes}) == len(shapes)
    assert seen[0] == seen[1]

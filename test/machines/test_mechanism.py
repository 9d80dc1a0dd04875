# SPDX-License-Identifier: Apache-2.0
"""Frames of every machine lie where its drawing has its pins, its chains close, and a foreign parser agrees."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from catalogue import NAMES, PAGES, built
from crank_drives import BOOM
from numpy.typing import NDArray
from urdf_parser_py.urdf import URDF

from mech_twin.capabilities.mechanism import ROOT, FrameTree, Pose, poses, urdf
from mech_twin.engine.run import frames
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import PAGE, assignments, machine_parameters
from mech_twin.roles import Machine
from mech_twin.samples import Frame, LinkageSample

NEAR_M = 1e-9
RUN_S = 0.6
SHORT_S = 1e-6  # either way, for a speed
EVERY = 37  # steps between positions that are looked at
FOUR_BAR_PINS = ("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing")
SLIDER = {"joints": ("crank_bearing", "crank_pin", "follower_pin"), "counterweight": ("counterweight",)}
# shape of the drawing -> frames at its points, in their order; None for a point that is none
DRAWN: dict[str, Mapping[str, tuple[str | None, ...]]] = {
    "compaction_press": {"pins": FOUR_BAR_PINS, "pendulum": ("rocker_bearing", "plate_end")},
    "mb10_breaker": {"pins": FOUR_BAR_PINS, "rocker": ("coupler_end", None, "striker"), "tool": ("tool", None)},
    "vibration_crank": SLIDER,
    "impact_mass": {"mass": (None, None, None, None, None), "stop": (None, None)},
    "roller_former": {
        "rod_1": ("crank_pin_1", "cart_pin_1"),
        "rod_2": ("crank_pin_2", "rod_end_2"),
        "guide_rollers_1": ("guide_front_1", "guide_rear_1"),
        "guide_rollers_2": ("guide_front_2", "guide_rear_2"),
    },
    "winding_drum": {"axis": ("shaft",), "yarn": ("yarn_exit", None)},
}


def mechanism_of(machine: Machine) -> FrameTree:
    assert machine.mechanism is not None
    return machine.mechanism


def positions(frame: Frame) -> dict[str, float]:
    return dict(zip(frame.linkage.joints, frame.linkage.position, strict=True))


def looked_at(machine: Machine) -> Iterator[Frame]:
    for number, frame in enumerate(frames(machine, RUN_S)):
        if number % EVERY == 0:
            yield frame


def distance_m(pose: Pose, point: tuple[float, float]) -> float:
    return math.hypot(pose.x_m - point[0], pose.y_m - point[1])


@pytest.mark.parametrize("name", NAMES)
def test_frames_are_one_tree_that_the_joint_states_move(name: str) -> None:
    machine = built(name)
    mechanism = mechanism_of(machine)
    known = {ROOT}
    for joint in mechanism.joints:
        assert joint.parent in known
        assert joint.child not in known
        known.add(joint.child)
        assert (joint.name in machine.linkage.joints) == (joint.kind != "fixed")
    assert {bar.link for bar in mechanism.bars} <= known


@pytest.mark.parametrize("name", NAMES)
def test_every_wrench_has_a_frame_in_whose_axes_it_is_given(name: str) -> None:
    machine = built(name)
    for frame in looked_at(machine):
        at = poses(mechanism_of(machine), positions(frame))
        for pin in machine.forces.pins:
            assert math.remainder(at[pin].angle_rad, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12), pin


@pytest.mark.parametrize("name", NAMES)
def test_frames_lie_at_the_pins_of_the_drawing(name: str) -> None:
    machine = built(name)
    compared, travelled = 0, set()
    for frame in looked_at(machine):
        at = poses(mechanism_of(machine), positions(frame))
        shapes = {shape.name: shape for shape in machine.draw(frame.linkage, None)}
        for shape, named in DRAWN[name].items():
            for pin, point in zip(named, shapes[shape].points_m, strict=True):
                if pin is not None:
                    assert distance_m(at[pin], point) < NEAR_M, (shape, pin, frame.linkage.step)
                    compared += 1
        travelled.add(positions(frame)[machine.linkage.joints[0]])
    assert len(travelled) > 10, "the machine stood still"
    assert compared > 0 or name == "impact_mass"


def test_the_mass_has_its_frame_at_its_face() -> None:
    machine = built("impact_mass")
    for frame in looked_at(machine):
        at = poses(mechanism_of(machine), positions(frame))
        shapes = {shape.name: shape for shape in machine.draw(frame.linkage, None)}
        assert at["mass"].x_m == max(x for x, _ in shapes["mass"].points_m)
        assert at["stop"].x_m == shapes["stop"].points_m[0][0]


def test_the_breakers_frames_turn_with_its_body() -> None:
    machine = built("mb10_breaker")
    turned = [positions(frame)["body"] for frame in looked_at(machine)]
    assert max(turned) > 1e-3, "the body never left its collar, and the comparison says nothing of its frames"


def linkage_of_kind(*settings: str) -> Machine:
    return CATALOGUE["vibration_crank"].build(machine_parameters("vibration_crank", None, assignments(list(settings))))


@pytest.mark.parametrize("name", NAMES)
def test_closed_chains_close_where_they_were_opened(name: str) -> None:
    machine = built(name)
    mechanism = mechanism_of(machine)
    for frame in looked_at(machine):
        at = poses(mechanism, positions(frame))
        for loop in mechanism.loops:
            second = at[loop.second]
            assert distance_m(at[loop.first], (second.x_m, second.y_m)) < NEAR_M, loop
    assert bool(mechanism.loops) == (name not in ("impact_mass", "winding_drum"))


def test_an_infinite_rod_has_no_end() -> None:
    machine = linkage_of_kind("rod_m=.inf")
    assert mechanism_of(machine).loops == ()
    frame = next(iter(frames(machine, RUN_S)))
    at = poses(mechanism_of(machine), positions(frame))
    (x, y) = next(shape for shape in machine.draw(frame.linkage, None) if shape.name == "joints").points_m[2]
    assert distance_m(at["follower_pin"], (x, y)) < NEAR_M


# -- the description, read by a parser of somebody else ----------------------------------------------------------


def turn(axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Return the 4x4 rotation about an axis, by Rodrigues' formula."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    whole = np.eye(4)
    whole[:3, :3] = np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k
    return whole


def shift(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    whole = np.eye(4)
    whole[:3, 3] = vector
    return whole


def in_space(robot: Any, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Return the place of each link, as robot_state_publisher finds it: names, mimic joints, axes, origins."""
    found = {robot.get_root(): np.eye(4)}
    waiting = list(robot.joints)
    while waiting:
        joint = next(j for j in waiting if j.parent in found)
        waiting.remove(joint)
        place = found[joint.parent] @ shift(np.array(joint.origin.xyz))
        place = place @ turn(np.array([0.0, 0.0, 1.0]), joint.origin.rpy[2])
        if joint.type != "fixed":
            source = joint.mimic.joint if joint.mimic else joint.name
            value = values[source] * (joint.mimic.multiplier if joint.mimic else 1.0)
            axis = np.array(joint.axis)
            place = place @ (shift(value * axis) if joint.type == "prismatic" else turn(axis, value))
        found[joint.child] = place
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_foreign_reader_of_the_description_finds_every_frame_where_it_is(name: str) -> None:
    machine = built(name)
    mechanism = mechanism_of(machine)
    robot = URDF.from_xml_string(urdf(name, mechanism).encode())
    assert robot.name == name
    assert {link.name for link in robot.links} == set(mechanism.frames)
    for frame in looked_at(machine):
        at = poses(mechanism, positions(frame))
        for link, place in in_space(robot, positions(frame)).items():
            expected = at[link]
            assert np.hypot(place[0, 3] - expected.x_m, place[1, 3] - expected.y_m) < NEAR_M, link
            angle = math.atan2(place[1, 0], place[0, 0])
            assert abs(math.remainder(angle - expected.angle_rad, 2.0 * math.pi)) < NEAR_M, link
            assert place[2, 3] == 0.0


# masses of a machine as its configuration tells them
MASSES: dict[str, Callable[[Any], float]] = {
    "mb10_breaker": lambda p: sum(getattr(p.linkage, f"{link}_mass_kg") for link in LINKS) + p.tool.mass_kg,
    "compaction_press": lambda p: p.links.crank.mass_kg + p.links.plate.mass_kg + p.links.pendulum.mass_kg,
    "vibration_crank": lambda p: p.masses.reciprocating + p.masses.rotating + p.counterweight_kg,
    "impact_mass": lambda p: p.mass_kg,
    "roller_former": lambda p: p.carts.count * (p.carts.mass_kg + p.carts.rod_mass_kg),
    "winding_drum": lambda p: 0.0,
}
LINKS = ("crank", "coupler", "rocker")


@pytest.mark.parametrize("name", NAMES)
def test_a_foreign_reader_finds_the_masses_of_the_machine(name: str) -> None:
    machine = built(name)
    text = urdf(name, mechanism_of(machine))
    inertials = [link.inertial for link in URDF.from_xml_string(text.encode()).links if link.inertial]
    assert sum(inertial.mass for inertial in inertials) == pytest.approx(MASSES[name](machine.parameters), rel=1e-12)
    assert bool(inertials) == (name != "winding_drum")
    for inertial in inertials:
        assert inertial.inertia.ixx + inertial.inertia.iyy == inertial.inertia.izz
    unknown = {"mb10_breaker": "body: ", "roller_former": "crank: ", "winding_drum": "drum: "}
    assert unknown.get(name, "planar") in text


def doubled_kinetic_energy_j(robot: Any, linkage: LinkageSample) -> float:
    """Return mass times speed squared of all links, from where they are shortly before and after."""
    before, after = (
        in_space(robot, {j: q + way * v for j, q, v in zip(linkage.joints, *linkage[3:5], strict=True)})
        for way in (-SHORT_S, SHORT_S)
    )
    doubled = 0.0
    for link in robot.links:
        if link.inertial:
            centre = np.array([*link.inertial.origin.xyz, 1.0])
            velocity = (after[link.name] - before[link.name]) @ centre / (2.0 * SHORT_S)
            turned = np.linalg.inv(before[link.name]) @ after[link.name]
            rate = math.atan2(turned[1, 0], turned[0, 0]) / (2.0 * SHORT_S)
            doubled += link.inertial.mass * velocity @ velocity + link.inertial.inertia.izz * rate**2
    return doubled


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("compaction_press", {}),
        ("vibration_crank", {}),
        ("vibration_crank", BOOM),
        ("roller_former", {}),
    ],
)
def test_the_masses_of_the_description_move_with_the_energy_of_the_machine(name: str, settings: dict[str, Any]) -> None:
    """The inertia reduced to the crank, which the machine has from its own equations, against mass times speed."""
    parameters = machine_parameters(name, None, settings)
    machine = CATALOGUE[name].build(parameters)
    robot = URDF.from_xml_string(urdf(name, mechanism_of(machine)).encode())
    more = parameters.carts.count * parameters.carts.crank_inertia_kg_m2 if name == "roller_former" else 0.0
    compared = 0
    for frame in looked_at(machine):
        linkage, speed = frame.linkage, frame.linkage.joint("crank").velocity
        if abs(speed) < 0.1:
            continue
        expected = frame.forces.quantities["reduced_inertia_kg_m2"]
        assert doubled_kinetic_energy_j(robot, linkage) / speed**2 + more == pytest.approx(expected, rel=1e-6)
        compared += 1
    assert compared > 5


def test_the_masses_of_a_pages_description_move_with_its_energy() -> None:
    """Without gravity and springs a slider-crank's energy is that of its motion."""
    page = next(page for page in PAGES if page.endswith("slider_crank.yaml"))
    machine = PAGE.build(machine_parameters(page, None, {"gravity_m_per_s2": [0.0, 0.0]}))
    robot = URDF.from_xml_string(urdf("slider_crank", mechanism_of(machine)).encode())
    energies = [
        (doubled_kinetic_energy_j(robot, frame.linkage) / 2.0, frame.linkage.memory["energy_j"])
        for frame in looked_at(machine)
    ]
    assert len(energies) > 5
    assert [moved for moved, _ in energies] == pytest.approx([told for _, told in energies], rel=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_the_description_says_where_a_closed_chain_was_opened(name: str) -> None:
    mechanism = mechanism_of(built(name))
    text = urdf(name, mechanism)
    assert text.count("closed chain") == len(mechanism.loops)
    for loop in mechanism.loops:
        assert f"{loop.first} and {loop.second} are one pin" in text

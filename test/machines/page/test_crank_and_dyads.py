# SPDX-License-Identifier: Apache-2.0
"""Pages made of a crank and dyads have the numbers of the machine `planar_linkage`, whose place they took.

The reference values are that machine's, of version 0.1.0 at commit 29e0c5b, in runs of 1 s: frames of its links, drive
torque, pin forces with moments, largest values of the run, and works; then its cycle in closed form and its flywheel.
The first is the configuration that was installed, the next three were printed on its page, the others are drawn.
"""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from machines.page.pages import SLIDER_CRANK, page

from mech_twin.capabilities.variation import varied
from mech_twin.engine.run import frames
from mech_twin.errors import StudyError
from mech_twin.machines.page import build
from mech_twin.machines.page import sizing as page_sizing
from mech_twin.machines.page.parameters import Page
from mech_twin.machines.page.sizing import sizing
from mech_twin.mechanics.kinematics import Kinematics

FORMER = json.loads((Path(__file__).parent / "former_linkages.json").read_text(encoding="utf-8"))
RELATIVE = dict.fromkeys(FORMER, 1e-9)
RELATIVE["crank_rocker"] = 2e-8  # a page holds its motor's slope over a step: that is what 0.1 ms leave


@cache
def built(name):
    """Return the machine of a page."""
    return build(Page.model_validate(FORMER[name]["page"]))


@cache
def told(name):
    """Return the frames of a run."""
    return tuple(frames(built(name), 1.0))


def drive_torque(name, frame):
    """Return what the crank gets beyond the inertia of the rotor, as the former machine told it."""
    linkage, motor = frame.linkage, built(name).parameters.drives["motor"]
    effort = linkage.joint("crank_bearing").effort + linkage.memory.as_dict().get("motor_gear_moment_nm", 0.0)
    if motor.motor is None:
        return effort
    inertia = motor.motor.rotor_inertia_kg_m2 * motor.gear_ratio**2
    return effort - inertia * linkage.memory["crank_bearing_acceleration_rad_per_s2"]


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMER)
def test_a_page_of_dyads_moves_and_bears_as_the_former_machine(name):
    run, former, shared = told(name), FORMER[name], built(name).linkage.shared
    torque = max(map(abs, (former["run"]["torque_max_nm"], former["run"]["torque_min_nm"])))
    force = max(former["run"]["pins_max_n"].values())
    size = shared.assembly.size_m
    for at in former["at"]:
        frame = run[at["step"]]
        crank = frame.linkage.joint("crank_bearing")
        assert crank.position == pytest.approx(at["crank_rad"], abs=RELATIVE[name])
        assert crank.velocity == pytest.approx(at["crank_rad_per_s"], rel=RELATIVE[name])
        motion = Kinematics(
            shared.assembly.structure, [frame.linkage.joint(x).position for x in shared.assembly.coordinates]
        )
        for link, (angle, x, y) in at["frames"].items():
            found = motion.frames[shared.assembly.body_number(link)]
            assert math.remainder(found.angle - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=RELATIVE[name])
            assert (found.x, found.y) == pytest.approx((x, y), abs=RELATIVE[name] * size)
        for pin, expected in at["pins"].items():
            of_block = pin.endswith("between") and shared.page.joints[pin].kind == "slider"  # on the block, not the bar
            found = np.array(frame.forces.wrenches[frame.forces.pins.index(pin)][:3]) * (-1.0 if of_block else 1.0)
            assert found == pytest.approx(np.array(expected), abs=RELATIVE[name] * force), pin
        assert drive_torque(name, frame) == pytest.approx(at["torque_nm"], abs=RELATIVE[name] * torque)


OTHERS = [pytest.param(name, marks=pytest.mark.slow) for name in list(FORMER)[2:]]


@pytest.mark.parametrize("name", [*list(FORMER)[:2], *OTHERS])
def test_the_largest_values_and_works_of_its_run_are_the_former_machine_s(name):
    run, former = told(name)[1:], FORMER[name]["run"]
    torques = [drive_torque(name, frame) for frame in run]
    largest = max(map(abs, torques))
    assert max(torques) == pytest.approx(former["torque_max_nm"], abs=RELATIVE[name] * largest)
    assert min(torques) == pytest.approx(former["torque_min_nm"], abs=RELATIVE[name] * largest)
    for pin, most in former["pins_max_n"].items():
        place = run[0].forces.pins.index(pin)
        found = max(math.hypot(*frame.forces.wrenches[place][:2]) for frame in run)
        assert found == pytest.approx(most, rel=RELATIVE[name]), pin
    works = run[-1].linkage.memory.as_dict()
    turned_over = run[-1].linkage.memory["turned_over_j"]
    stroke = works.get("working_stroke_work_j", works.get("tool_stroke_work_j", 0.0))
    assert stroke == pytest.approx(former["load_work_j"], abs=1e-9 * turned_over)
    if name != "crank_rocker":  # of a motor the former machine booked the work behind its rotor and gear
        assert works["motor_work_j"] == pytest.approx(former["drive_work_j"], abs=1e-9 * turned_over)


@pytest.mark.parametrize("name", FORMER)
def test_the_drive_torque_is_the_same_by_work_and_by_equilibrium(name):
    for frame in told(name):
        assert abs(frame.forces.residuals["drive_torque_routes"]) <= 1e-12
        assert abs(frame.linkage.residuals["energy_balance"]) <= 1e-11


@pytest.mark.parametrize("name", FORMER)
def test_the_flywheel_is_the_former_machine_s(name):
    bare = Page.model_validate(FORMER[name]["page"] | FORMER[name]["without_flywheel"])
    found = sizing(bare, {"non_uniformity": 0.05}, "flywheel_inertia_kg_m2", dict)
    assert found.metrics["flywheel_inertia_kg_m2"] == pytest.approx(FORMER[name]["flywheel_kg_m2"], rel=3e-6)


def sized_at(speed_rpm):
    """Return the flywheel of a page without gravity or friction, whose speed is no matter."""
    turned = page(SLIDER_CRANK, drives={"motor": {"speed_rpm": speed_rpm}})
    return sizing(turned, {"non_uniformity": 0.05}, "flywheel_inertia_kg_m2", dict).metrics["flywheel_inertia_kg_m2"]


@pytest.mark.slow
def test_a_flywheel_against_inertia_alone_is_the_same_at_any_speed():
    usual = sized_at(300.0)
    for speed_rpm in (0.017, 17000.0, 60000.0):
        assert sized_at(speed_rpm) == pytest.approx(usual, rel=1e-4)
    for speed_rpm in (0.016, 170000.0):
        with pytest.raises(StudyError, match=r"rpm; a flywheel is sized from 0\.01667 to 166667 rpm"):
            sized_at(speed_rpm)


def test_the_flywheel_keeps_the_asked_non_uniformity_in_a_time_run():
    found = sizing(built("shaper").parameters, {"non_uniformity": 0.1}, "flywheel_inertia_kg_m2", dict)
    turn = list(frames(built("shaper"), 1.0))
    torque = turn[-1].linkage.memory["motor_work_j"] / (2.0 * math.pi)
    free = varied(
        found.parameters,
        {
            "drives.motor": {
                "kind": "constant_torque",
                "joint": "crank_bearing",
                "torque_nm": -torque,
                "speed_rpm": None,
            },
            "joints.crank_bearing.start_rad_per_s": -2.0 * math.pi,
        },
    )
    speeds = [-frame.linkage.joint("crank_bearing").velocity for frame in frames(build(free), 3.0)][1000:2000]
    spread = 2.0 * (max(speeds) - min(speeds)) / (max(speeds) + min(speeds))
    assert spread == pytest.approx(0.1, rel=0.1)  # the mean speed of a free run is not exactly the rated one


SHAFTS = """
gravity_m_per_s2: [0, -9.81]
ground: {points_m: {beside: [1, 0]}}
bodies: {crank: {inertia_kg_m2: 0.05}, cam: {mass_kg: 3, inertia_kg_m2: 0.02, centre_m: [0.1, 0]}}
joints:
  shaft: {kind: revolute, between: [ground, crank]}
  cam_shaft: {kind: revolute, between: [ground.beside, cam], start_deg: 30}
couplings: {mesh: {kind: gear, joints: [shaft, cam_shaft], ratio: -0.5}}
drives: {motor: {kind: constant_speed, joint: shaft, speed_rpm: 300}}
"""
FILLED = """
gravity_m_per_s2: [0, 0]
ground: {points_m: {head: [0.5, 0]}}
bodies:
  crank: {inertia_kg_m2: 0.05, points_m: {pin: [0.05, 0]}}
  rod: {points_m: {end: [0.2, 0]}}
  piston: {}
joints:
  shaft: {kind: revolute, between: [ground, crank], start_deg: 80}
  pin: {kind: revolute, between: [crank.pin, rod]}
  wrist: {kind: revolute, between: [rod.end, piston]}
  guide: {kind: slider, between: [ground, piston], start_m: 0.2}
springs:
  air:
    between: [piston, ground.head]
    gas: {area_m2: 0.002, volume_m3: 1.5e-4, exponent: 1, ports: {inlet: {joint: guide, open_below_m: 0.16}}}
drives: {motor: {kind: constant_speed, joint: shaft, speed_rpm: 300}}
"""
SWING_J = 2.0 * 3.0 * 9.81 * 0.1  # of the weight of the cam, whose turn takes two of the crank


def pressed_j():
    """Return the work of compressing the air that closed at its port, down to the crank's dead centre."""
    start = 0.05 * math.cos(math.radians(80.0)) + math.sqrt(0.04 - (0.05 * math.sin(math.radians(80.0))) ** 2)
    closed, least = (1.5e-4 + 0.002 * (start - place) for place in (0.16, 0.25))
    return 101325.0 * (closed * math.log(closed / least) - closed + least)


@pytest.mark.parametrize(
    ("text", "swing_j", "inertia"), [(SHAFTS, SWING_J, 0.05 + 0.25 * 0.05), (FILLED, pressed_j(), 0.05)]
)
def test_a_flywheel_is_of_all_turns_until_the_mechanism_is_as_it_was(text, swing_j, inertia):
    """At constant inertia it is the swing of the work over that of the square of the speed, less the inertia."""
    found = sizing(page(text), {"non_uniformity": 0.05}, "flywheel_inertia_kg_m2", dict)
    expected = swing_j / (0.05 * (10.0 * math.pi) ** 2) - inertia
    assert found.metrics["flywheel_inertia_kg_m2"] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("coupling", "joint"),
    [
        (
            {"kind": "rack", "ratio": None, "radius_m": 0.1},
            {"kind": "slider", "start_deg": None, "start_m": 0.0},
        ),
        ({"ratio": math.sqrt(2.0)}, {}),
    ],
)
def test_a_motion_that_does_not_repeat_has_no_flywheel(coupling, joint, monkeypatch):
    """What moves alike in two turns tells where it is after a hundred: they are not computed."""
    steps = []

    def counted(machine, duration_s):
        for frame in frames(machine, duration_s):
            steps.append(frame.linkage.step)
            yield frame

    monkeypatch.setattr(page_sizing, "frames", counted)
    changed = {"couplings": {"mesh": {"joints": ["shaft", "cam_shaft"], **coupling}}, "joints": {"cam_shaft": joint}}
    with pytest.raises(StudyError, match="cam_shaft is not as it was after any of 100 turns; a flywheel is sized for"):
        sizing(page(SHAFTS, **changed), {"non_uniformity": 0.05}, "flywheel_inertia_kg_m2", dict)
    assert len(steps) <= 4 * page_sizing.POSITIONS

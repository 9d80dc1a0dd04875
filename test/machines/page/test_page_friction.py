# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction of a contact along its line, against closed forms and an integration of its own."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from machines.page.pages import run

from mech_twin import rollout
from mech_twin.machines.page import build
from mech_twin.machines.page.parameters import Page

HAMMER = Path(__file__).parents[3] / "config" / "pages" / "spring_hammer.yaml"

BLOCK = """
gravity_m_per_s2: [0, -10]
bodies: {belt: {mass_kg: 1}, carriage: {}, block: {mass_kg: 2}}
joints:
  rolls: {kind: slider, between: [ground, belt], start_m: 0.0}
  along: {kind: slider, between: [ground, carriage], start_m: 0.0}
  up: {kind: slider, between: [carriage, block], direction_deg: 90, start_m: 0.0}
drives: {motor: {kind: constant_speed, joint: rolls, speed_m_per_s: 1.0}}
contacts: {sole: {point: block, line: belt, normal_deg: 90, restitution: 0.0, friction: 0.25}}
"""
CONVEYOR = """
gravity_m_per_s2: [0, -9.81]
bodies:
  crank: {inertia_kg_m2: 0.1, points_m: {pin: [0.005, 0]}}
  yoke: {}
  trough: {mass_kg: 5}
  carriage: {}
  block: {mass_kg: 2}
joints:
  shaft: {kind: revolute, between: [ground, crank], start_deg: 30.0}
  pin: {kind: revolute, between: [crank.pin, yoke]}
  slot: {kind: slider, between: [trough, yoke], direction_deg: 120, start_m: 0.0, turned_deg: 0.0}
  leaf: {kind: slider, between: [ground, trough], direction_deg: 30, start_m: 0.005}
  along: {kind: slider, between: [ground, carriage], start_m: 0.00433}
  up: {kind: slider, between: [carriage, block], direction_deg: 90, start_m: 0.0025}
drives: {motor: {kind: constant_speed, joint: shaft, speed_rpm: 400}}
contacts: {sole: {point: block, line: trough, normal_deg: 90, restitution: 0.0, friction: 0.6}}
"""
PLATE = """
gravity_m_per_s2: [0, -9.80665]
bodies:
  plate:
    mass_kg: 60
    inertia_kg_m2: 4
    centre_m: [0, 0.1]
    points_m: {front: [0.3, 0], rear: [-0.3, 0], axle: [0.1, 0.12]}
  deck: {mass_kg: 30, inertia_kg_m2: 1.5, points_m: {left: [-0.2, -0.1], right: [0.2, -0.1]}}
joints:
  fly: {kind: free, between: [ground, plate], start_y_m: 0.002}
  deck_fly: {kind: free, between: [plate, deck], start_y_m: 0.45}
drives: {exciter: {kind: unbalance, point: plate.axle, mass_kg: 0.9, radius_m: 0.04, speed_rpm: 2400, start_deg: 30}}
supply: {initial_fraction: 0, rate_per_s: 1}
springs:
  s_left: {between: [plate.rear, deck.left], rate_n_per_m: 40000, preload_n: 150}
  s_right: {between: [plate.front, deck.right], rate_n_per_m: 40000, preload_n: 150}
dampers:
  d_left: {between: [plate.rear, deck.left], rate_ns_per_m: 300}
  d_right: {between: [plate.front, deck.right], rate_ns_per_m: 300}
contacts:
  front_soil:
    {point: plate.front, line: ground, normal_deg: 90, stiffness_n_per_m: 5.0e+7, damping_s_per_m: 1.5, friction: 0.4}
  rear_soil:
    {point: plate.rear, line: ground, normal_deg: 90, stiffness_n_per_m: 5.0e+7, damping_s_per_m: 1.5, friction: 0.4}
coupling: {step_s: 0.0005}
"""

SLED = """
gravity_m_per_s2: [0, -10]
bodies:
  carriage: {}
  lift: {}
  plate: {mass_kg: 50, inertia_kg_m2: 3, points_m: {front: [0.3, 0], rear: [-0.3, 0]}}
joints:
  along: {kind: slider, between: [ground, carriage], start_m: 0.0}
  up: {kind: slider, between: [carriage, lift], direction_deg: 90, start_m: 0.0}
  tilt: {kind: revolute, between: [lift, plate], start_deg: 0.0}
drives: {push: {kind: table, joint: along, period_s: 0.4}}
contacts:
  front_foot: {point: plate.front, line: ground, normal_deg: 90, restitution: 0.0}
  rear_foot: {point: plate.rear, line: ground, normal_deg: 90, restitution: 0.0}
"""


def slid(front: float, rear: float, centre: tuple[float, float], push: list[list[float]], dt: float = 2e-6) -> float:
    """Return the travel of the sled in 1 s by time stepping, from the balance of its moments (m)."""
    mass, g, a, (c, height) = 50.0, 10.0, 0.3, centre
    most = 0.5 * mass * g * (front + rear + (front - rear) * c / a)
    forces = np.interp((np.arange(round(1.0 / dt)) + 0.5) * dt % 0.4, *zip(*push, strict=True))
    x, v = 0.0, 0.0
    for force in forces.tolist():
        sense = math.copysign(1.0, v if v != 0.0 else force)
        if v == 0.0 and abs(force) <= most:
            continue
        after = v + dt * (force - sense * most) / (mass * (1.0 - sense * (front - rear) * height / (2.0 * a)))
        after = 0.0 if after * sense < 0.0 else after
        x, v = x + 0.5 * dt * (v + after), after
    return x


@pytest.mark.parametrize(
    ("front", "rear", "centre", "top"),
    [
        (0.6, 0.25, (0.05, 0.12), 300.0),
        (0.2, 0.35, (-0.1, 0.06), 250.0),
        pytest.param(0.4, 0.4, (0.0, 0.1), 260.0, marks=pytest.mark.slow),
    ],
)
def test_a_body_on_two_feet_slides_by_the_friction_of_both(front, rear, centre, top):
    push = [[0.0, 0.0], [0.1, top], [0.3, -top], [0.4, 0.0]]
    feet = {"front_foot": {"friction": front}, "rear_foot": {"friction": rear}}
    given = {"bodies": {"plate": {"centre_m": list(centre)}}, "drives": {"push": {"table_s_n": push}}}
    expected, off = slid(front, rear, centre, push), []
    for step_s in (1e-3, 2.5e-4):
        told, simulation = run(SLED, 1.0, contacts=feet, coupling={"step_s": step_s}, **given)
        assert all(r.worst <= r.limit for r in simulation.residuals().values())
        off.append(abs(told[-1].linkage.joint("along").position - expected))
    assert abs(expected) > 1e-4
    assert off[0] < 1e-3 * abs(expected)  # the force of a contact is that of a step ago
    assert off[1] < max(0.5 * off[0], 1e-8 * abs(expected))


@pytest.mark.slow
@pytest.mark.parametrize("is_rigid", [True, False])
def test_plates_on_two_rubbing_feet_go_on_whatever_their_numbers(is_rigid):
    random = np.random.default_rng(13)
    for _ in range(12):
        tree = yaml.safe_load(PLATE)
        tree["bodies"]["plate"] |= {
            "mass_kg": random.uniform(20.0, 120.0),
            "inertia_kg_m2": random.uniform(1.0, 8.0),
            "centre_m": [random.uniform(-0.1, 0.1), random.uniform(0.02, 0.2)],
        }
        tree["drives"]["exciter"] |= {"mass_kg": random.uniform(0.2, 2.0), "speed_rpm": random.uniform(1e3, 4e3)}
        for name, foot in tree["contacts"].items():
            law = {"restitution": random.uniform(0.0, 0.5)}
            if not is_rigid:
                law = {
                    "stiffness_n_per_m": 10.0 ** random.uniform(6.0, 8.0),
                    "damping_s_per_m": random.uniform(0.3, 2.0),
                }
            place = {key: foot[key] for key in ("point", "line", "normal_deg")}
            tree["contacts"][name] = place | law | {"friction": random.uniform(0.1, 0.8)}
        _, simulation = run(yaml.safe_dump(tree), 1.0)
        assert all(r.worst <= r.limit for r in simulation.residuals().values())


@pytest.mark.slow
def test_a_plate_whose_two_feet_stick_while_it_turns_goes_on_and_keeps_its_energy():
    _, simulation = run(PLATE, 0.5)
    assert all(r.worst <= r.limit for r in simulation.residuals().values())


def test_a_block_on_a_belt_is_taken_along_by_mu_g_until_it_rides():
    told, simulation = run(BLOCK, 0.6)
    assert all(r.worst <= r.limit for r in simulation.residuals().values())
    for frame in told[::37]:
        t, place = frame.linkage.time_s, frame.linkage.joint("along")
        x, v = (1.25 * t * t, 2.5 * t) if t < 0.4 else (0.2 + t - 0.4, 1.0)
        assert place.position == pytest.approx(x, abs=1e-12)
        assert place.velocity == pytest.approx(v, abs=1e-12)
    sole = told[100].forces.wrenches[told[100].forces.pins.index("sole")]
    assert (sole.force_x_n, sole.force_y_n) == pytest.approx((5.0, 20.0), rel=1e-12)
    (stick,) = (event for frame in told for event in frame.linkage.events)
    assert (stick.kind, stick.contact) == ("stick", "sole_friction")
    assert stick.time_s == pytest.approx(0.4, abs=1e-12)
    assert told[-1].linkage.memory["sole_friction_work_j"] == pytest.approx(-5.0 * 0.2, rel=1e-12)


def test_a_compliant_sole_rubs_with_its_force_of_the_instant():
    contact = {"restitution": None, "stiffness_n_per_m": 1e6}
    depth = (20.0 / 1e6) ** (2.0 / 3.0)
    told, _ = run(BLOCK, 0.3, contacts={"sole": contact}, joints={"up": {"start_m": -depth}})
    assert told[-1].linkage.joint("along").velocity == pytest.approx(2.5 * 0.3, rel=1e-9)


def conveyed(duration_s: float, dt: float = 2e-6) -> float:
    """Return the travel of a block on a trough shaken under 30 degrees, by time stepping (m)."""
    omega, r, g, mu = 400.0 * math.pi / 30.0, 0.005, 9.81, 0.6
    cosine, sine = math.cos(math.pi / 6.0), 0.5
    x, v = 0.0, 0.0
    for i in range(round(duration_s / dt)):
        t = (i + 0.5) * dt
        pressing = g - r * omega * omega * math.cos(omega * t) * sine
        assert pressing > 0.0
        most = mu * pressing * dt
        trough = -r * omega * math.sin(omega * (i + 1) * dt) * cosine
        v += min(max(trough - v, -most), most)
        x += v * dt
    return x


def test_a_shaken_trough_conveys_what_lies_on_it():
    duration_s, travels = 0.6, []
    expected = conveyed(duration_s)
    for step_s in (1e-3, 2.5e-4):
        told, simulation = run(CONVEYOR, duration_s, coupling={"step_s": step_s})
        assert all(r.worst <= r.limit for r in simulation.residuals().values()), simulation.residuals()
        along = [frame.linkage.joint("along").position for frame in told]
        travels.append(along[-1] - along[0])
        kinds = {event.kind for frame in told for event in frame.linkage.events}
        assert {"stick", "slip"} <= kinds
    assert abs(expected) > 0.01
    assert travels[0] == pytest.approx(expected, rel=1e-3)  # the force of the contact is that of a step ago
    assert abs(travels[1] - expected) < 0.5 * abs(travels[0] - expected)


@pytest.mark.parametrize("coulomb_n", [0.0, 1e-12])
def test_friction_of_nothing_lets_a_ram_go_from_its_anvil_as_if_there_were_none(coulomb_n):
    """The ram lets go with no acceleration but rounding's, which the friction must not follow."""
    tree = yaml.safe_load(HAMMER.read_text())
    tree["friction"]["ram_friction"]["coulomb_n"] = coulomb_n
    rubbing = rollout(build(Page.model_validate(tree)), 1.6)
    del tree["friction"]
    free = rollout(build(Page.model_validate(tree)), 1.6)
    released, expected = ([e.time_s for e in one.events if e.kind == "release"] for one in (rubbing, free))
    assert len(expected) >= 7
    assert released == pytest.approx(expected, abs=1e-10)
    ram = "linkage.ram_guide.velocity"
    assert rubbing[ram] == pytest.approx(free[ram], abs=1e-8)


@pytest.mark.parametrize("coulomb_n", [5.0, 9.0, 11.5, 16.0])
def test_a_ram_leaves_a_layer_that_bears_no_more_when_its_spring_pulls_as_its_friction_holds(coulomb_n):
    tree = yaml.safe_load(HAMMER.read_text())
    tree["friction"]["ram_friction"]["coulomb_n"] = coulomb_n
    tree["contacts"]["layer"] = {"joint": "ram_guide", "most_m": 0.62, "layer_m_n": [[0.0, 0.0], [0.3, 500.0]]}
    found = rollout(build(Page.model_validate(tree)), 1.0)
    rubs = [event for event in found.events if event.contact == "ram_friction"]
    assert all(one.kind != other.kind for one, other in itertools.pairwise(rubs)), "it sticks and slips by turns"
    speed, ram = found["linkage.ram_guide.velocity"], found["linkage.ram_guide.position"]
    slips = [(e.time_s, int(e.time_s / 1e-3)) for e in rubs if e.kind == "slip"]
    left = [(time_s, k) for time_s, k in slips if abs(speed[k]) < 1e-12 and speed[k + 1] < 0.0 and ram[k] > 0.62]
    assert len(left) >= 4
    for time_s, k in left:
        angle = math.pi * (1.0 + 10.0 * time_s)
        crosshead = 0.05 * math.cos(angle) + math.sqrt(0.25**2 - (0.05 * math.sin(angle)) ** 2)
        pull = 8000.0 * (ram[k] - crosshead - 0.4)
        assert pull == pytest.approx(coulomb_n, abs=1e-6)

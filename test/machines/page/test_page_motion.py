# SPDX-License-Identifier: Apache-2.0
"""Laws of a page's motion: closed forms, events at their instants, energies, forces, and a run that goes on."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from machines.page.pages import BALL, PENDULUM, SLIDER_CRANK, page, run
from scipy.special import ellipk

from mech_twin import rollout
from mech_twin.cli.run_summary import show_events
from mech_twin.machines.page.mechanism import mechanism
from mech_twin.machines.page.roles import PageModel
from mech_twin.view.extent import event_line

REST = {"rest": {"joint": "pivot", "least_deg": -80.0, "restitution": 0.0}}


def impacts(simulation):
    return [event for event in simulation.events if event.kind == "impact"]


def test_a_bouncing_ball_strikes_at_its_instants_and_comes_to_rest():
    told, simulation = run(BALL, 2.0)
    fall = math.sqrt(0.2)
    found = impacts(simulation)
    expected = fall
    for k, event in enumerate(found[:12]):
        assert event.time_s == pytest.approx(expected, abs=1e-11)
        assert event.pre_velocity_m_per_s == pytest.approx(10.0 * fall * 0.5**k, rel=1e-10)
        assert event.impulse_ns == pytest.approx(2.0 * 1.5 * 10.0 * fall * 0.5**k, rel=1e-10)
        expected += 2.0 * fall * 0.5 ** (k + 1)
    assert told[-1].linkage.position == pytest.approx([0.0], abs=1e-12)
    assert told[-1].linkage.velocity == (0.0,)
    assert told[-1].forces.wrenches[-1].force_y_n == pytest.approx(20.0, rel=1e-12)  # the weight
    assert told[-1].linkage.memory["impacts_work_j"] == pytest.approx(-20.0, rel=1e-9)


def test_a_pendulum_has_the_period_of_the_elliptic_integral():
    told, _ = run(PENDULUM, 2.0)
    length = (0.1 + 2 * 0.25) / (2 * 0.5)
    period = 4.0 * math.sqrt(length / 9.81) * ellipk(math.sin(math.radians(15.0)) ** 2)
    before = next(f for f, g in pairwise(told) if f.linkage.velocity[0] < 0.0 < g.linkage.velocity[0])
    after = told[before.linkage.step + 1]
    share = before.linkage.velocity[0] / (before.linkage.velocity[0] - after.linkage.velocity[0])
    assert before.linkage.time_s + share * 1e-3 == pytest.approx(0.5 * period, abs=2e-9)
    assert max(abs(f.linkage.residuals["energy_balance"]) for f in told) < 1e-10


def test_a_stop_of_a_pin_is_told_as_angular_speed_angular_impulse_and_moment(capsys):
    _, simulation = run(PENDULUM, 0.5, contacts=REST)
    numbers = simulation.numbers()
    drop_m = 0.5 * (math.sin(math.radians(80.0)) - math.sin(math.radians(60.0)))
    speed = math.sqrt(2.0 * 2.0 * 9.81 * drop_m / 0.6)
    assert numbers["rest_impact_speed_max_rad_per_s"] == pytest.approx(speed, rel=1e-9)
    assert numbers["rest_impact_impulse_max_nms"] == pytest.approx(0.6 * speed, rel=1e-9)
    assert numbers["rest_impact_moment_mean_nm"] == pytest.approx(0.6 * speed / 0.5, rel=1e-9)
    assert numbers["rest_moment_max_nm"] == pytest.approx(2.0 * 9.81 * 0.5 * math.cos(math.radians(80.0)), rel=1e-9)
    assert not [name for name in numbers if name.startswith("rest_") and name.endswith(("_m_per_s", "_ns", "_n"))]
    show_events(simulation.events, simulation.event_counts, numbers, everything=True)
    assert f"{speed:.4g} rad/s" in capsys.readouterr().out
    tree = mechanism(PageModel(page(PENDULUM, contacts=REST)))
    line = event_line(impacts(simulation)[0], tree.turning_stops)
    assert re.search(rf"{re.escape(f'{speed:+.4g}')} -> [+-]0 rad/s  [0-9.]+ N m s", line), line


def test_a_slider_crank_at_constant_speed_has_its_closed_form():
    told, simulation = run(SLIDER_CRANK, 0.5)
    r, rod, w = 0.1, 0.4, 20.0 * math.pi
    for frame in told[::7]:
        angle = math.radians(30.0) + w * frame.linkage.time_s
        slope = -math.asin(r / rod * math.sin(angle))
        travel = r * math.cos(angle) + rod * math.cos(slope)
        slope_rate = -r * w * math.cos(angle) / (rod * math.cos(slope))
        speed = -r * w * math.sin(angle) - rod * math.sin(slope) * slope_rate
        slope_bend = (r * w * w * math.sin(angle) + rod * math.sin(slope) * slope_rate**2) / (rod * math.cos(slope))
        bend = -r * w * w * math.cos(angle) - rod * math.cos(slope) * slope_rate**2 - rod * math.sin(slope) * slope_bend
        assert frame.linkage.joint("guide").position == pytest.approx(travel, abs=1e-12)
        assert frame.linkage.joint("guide").velocity == pytest.approx(speed, abs=1e-10)
        assert frame.forces.quantities["path_x_m"] == pytest.approx(travel, abs=1e-12)
        wrist = frame.forces.wrenches[frame.forces.pins.index("wrist")]
        assert wrist.force_x_n == pytest.approx(3.0 * bend, abs=1e-8 * 3.0 * r * w * w)
        centre = (r * math.cos(angle) + 0.2 * math.cos(slope), r * math.sin(angle) + 0.2 * math.sin(slope))
        rate = (
            -r * w * math.sin(angle) - 0.2 * math.sin(slope) * slope_rate,
            r * w * math.cos(angle) + 0.2 * math.cos(slope) * slope_rate,
        )
        held = 0.5 * (0.05 * w * w + rate[0] ** 2 + rate[1] ** 2 + 0.02 * slope_rate**2 + 3.0 * speed**2)
        assert centre[0] != 0.0
        assert frame.linkage.memory["energy_j"] == pytest.approx(held, rel=1e-11)
    assert all(residual.worst <= residual.limit for residual in simulation.residuals().values())


@pytest.mark.slow
def test_a_given_speed_keeps_its_angle_over_ten_thousand_steps():
    told, _ = run(SLIDER_CRANK, 10.0)
    last = told[-1].linkage
    assert last.time_s == 10.0
    assert last.joint("bearing").position == pytest.approx(math.radians(30.0) + 200.0 * math.pi, abs=3e-13)


def test_friction_stops_a_block_where_its_energy_is_used_up():
    text = """
gravity_m_per_s2: [0, 0]
bodies: {block: {mass_kg: 2}}
joints: {guide: {kind: slider, between: [ground, block], start_m_per_s: 3}}
friction: {rubbing: {joint: guide, coulomb_n: 5}}
"""
    told, simulation = run(text, 2.0)
    (stick,) = [event for event in simulation.events if event.kind == "stick"]
    assert stick.time_s == pytest.approx(2.0 * 3.0 / 5.0, abs=1e-12)
    assert told[-1].linkage.position[0] == pytest.approx(0.5 * 2.0 * 9.0 / 5.0, abs=1e-12)
    assert told[-1].linkage.velocity[0] == 0.0
    assert told[-1].linkage.memory["rubbing_work_j"] == pytest.approx(-9.0, rel=1e-12)


def test_a_program_switches_at_its_own_instants():
    text = """
gravity_m_per_s2: [0, 0]
bodies: {mass: {mass_kg: 1}}
joints: {guide: {kind: slider, between: [ground, mass]}}
drives: {pulse: {kind: program, joint: guide, levels_n: [2, -1], period_s: 0.3, first_s: 0.1003}}
"""
    told, simulation = run(text, 0.9)
    times = [event.time_s for event in simulation.events]
    assert times[:4] == pytest.approx([0.1003, 0.3, 0.4003, 0.6], abs=1e-12)
    speed = 3 * (2 * 0.1003 - (0.3 - 0.1003))
    assert told[-1].linkage.velocity[0] == pytest.approx(speed, abs=1e-12)


def test_an_oscillator_with_a_damper_decays_as_it_should():
    text = """
gravity_m_per_s2: [0, 0]
ground: {points_m: {wall: [-1, 0]}}
bodies: {mass: {mass_kg: 2}}
joints: {guide: {kind: slider, between: [ground, mass], start_m: 0.1}}
springs: {spring: {between: [ground.wall, mass], rate_n_per_m: 200, free_m: 1}}
dampers: {dashpot: {joint: guide, rate_ns_per_m: 4}}
"""
    told, _ = run(text, 1.0)
    decay, w = 1.0, math.sqrt(100.0 - 1.0)
    for frame in told[::50]:
        t = frame.linkage.time_s
        x = 0.1 * math.exp(-decay * t) * (math.cos(w * t) + decay / w * math.sin(w * t))
        assert frame.linkage.position[0] == pytest.approx(x, abs=1e-11)
        assert frame.forces.quantities["spring_force_n"] == pytest.approx(-200.0 * x, abs=1e-8)


def test_a_dc_motor_runs_up_by_its_line():
    text = """
gravity_m_per_s2: [0, 0]
bodies: {wheel: {inertia_kg_m2: 0.5}}
joints: {shaft: {kind: revolute, between: [ground, wheel]}}
drives: {motor: {kind: dc_motor, joint: shaft, stall_torque_nm: 10, no_load_speed_rpm: 300}}
"""
    told, _ = run(text, 1.0)
    w0 = 10.0 * math.pi
    rate = 10.0 / w0 / 0.5
    for frame in told[::100]:
        assert frame.linkage.velocity[0] == pytest.approx(w0 * (1 - math.exp(-rate * frame.linkage.time_s)), abs=1e-9)


MOTORS = {
    "dc_motor": {"stall_torque_nm": 10, "no_load_speed_rpm": 1500, "rotor_inertia_kg_m2": 0.01},
    "induction_motor": {
        "motor": {
            "rated_power_w": 1500, "rated_speed_rpm": 1410, "synchronous_speed_rpm": 1500,
            "breakdown_torque_ratio": 2.4, "starting_torque_ratio": 2.0, "rotor_inertia_kg_m2": 0.01,
        }
    },
    "table": {"table_rpm_nm": [[0, 10], [1500, 0]], "rotor_inertia_kg_m2": 0.01},
}  # fmt: skip


@pytest.mark.parametrize("kind", MOTORS)
def test_a_motor_that_starts_at_a_speed_gives_the_torque_of_it_from_the_first_sample_on(kind):
    text = """
gravity_m_per_s2: [0, 0]
bodies: {wheel: {inertia_kg_m2: 0.5}}
joints: {shaft: {kind: revolute, between: [ground, wheel], start_rad_per_s: 76}}
"""
    drive = {"kind": kind, "joint": "shaft", "gear_ratio": 2.0, **MOTORS[kind]}
    told, _ = run(text, 0.002, drives={"motor": drive})
    torque = 2.0 * told[0].motor.effort[0]
    assert told[0].linkage.effort[0] == pytest.approx(torque, rel=1e-12)
    assert told[0].forces.quantities["motor_torque_nm"] == pytest.approx(torque, rel=1e-12)
    assert told[0].linkage.memory["shaft_acceleration_rad_per_s2"] == pytest.approx(torque / 0.54, rel=1e-12)


@pytest.mark.slow
def test_a_compliant_contact_gives_the_depth_of_its_energy():
    changes = {"contacts": {"bounce": {"restitution": None, "stiffness_n_per_m": 1e6}}}
    told, simulation = run(
        BALL.replace("restitution: 0.5", "stiffness_n_per_m: 1.0e+6"), 1.0, coupling={"step_s": 1e-5}
    )
    del changes
    first, second = [event.time_s for event in list(simulation.events)[:2]]
    assert first == pytest.approx(math.sqrt(0.2), abs=1e-10)
    depth = -min(frame.linkage.position[0] for frame in told if first < frame.linkage.time_s < second)
    assert 1e6 / 2.5 * depth**2.5 == pytest.approx(2.0 * 10.0 * (1.0 + depth), rel=1e-6)


def test_constant_speed_takes_impacts_without_changing():
    """A driven crank throws a ram against an anvil: the drive's books hold the impact's share."""
    text = Path("config/pages/spring_hammer.yaml").read_text(encoding="utf-8")
    _, simulation = run(text, 3.0)
    assert len(impacts(simulation)) > 3
    assert all(residual.worst <= residual.limit for residual in simulation.residuals().values())


FALLING = """
gravity_m_per_s2: [0, -9.81]
bodies: {frame: {mass_kg: 40, inertia_kg_m2: 1}, weight: {mass_kg: 14}, piston: {mass_kg: 2}}
joints:
  fall: {kind: free, between: [ground, frame], start_x_m: 0.3, start_y_m: 0.8}
  guide: {kind: slider, between: [frame, weight], direction_deg: -77, start_m: 0.49}
  cylinder: {kind: slider, between: [frame, piston], direction_deg: -70, start_m: 0.19}
springs: {held: {between: [piston, weight], rate_n_per_m: 60000, preload_n: 0}}
"""


def test_joints_of_a_machine_in_free_fall_carry_rounding_of_its_weight():
    told, simulation = run(FALLING, 0.02)
    weight = 56 * 9.81
    assert max(abs(w.force_x_n) + abs(w.force_y_n) for f in told for w in f.forces.wrenches) < 1e-14 * weight
    assert simulation.residuals()["drive_torque_routes"].worst < 1e-14


RIDER = """
gravity_m_per_s2: [0, 0]
bodies: {frame: {mass_kg: 2.9}, rider: {mass_kg: 0.31}}
joints:
  guide: {kind: slider, between: [ground, frame]}
  ride: {kind: slider, between: [frame, rider]}
loads: {push: {point: frame, force_n: [130, 0]}}
"""


def test_a_joint_without_force_beside_loaded_ones_carries_their_rounding():
    _, simulation = run(RIDER, 0.003)
    assert simulation.residuals()["drive_torque_routes"].worst < 1e-8


PARALLEL = """
gravity_m_per_s2: [0, 0]
ground: {points_m: {front: [1.5, 0], shaft: [-0.737, 0.376]}}
bodies:
  rear: {mass_kg: 2, inertia_kg_m2: 0.03, points_m: {top: [0, 0.4]}}
  front: {mass_kg: 2, inertia_kg_m2: 0.03, points_m: {top: [0, 0.4]}}
  trough: {mass_kg: 120, inertia_kg_m2: 40, points_m: {front: [1.5, 0]}}
  rod: {mass_kg: 4, inertia_kg_m2: 0.2, points_m: {end: [0.6, 0]}}
  crank: {mass_kg: 10, inertia_kg_m2: 0.2, points_m: {pin: [0.012, 0]}}
joints:
  rear_bush: {kind: revolute, between: [ground, rear], start_deg: 20}
  front_bush: {kind: revolute, between: [ground.front, front], start_deg: 20}
  rear_top: {kind: revolute, between: [rear.top, trough], start_deg: -20}
  front_top: {kind: revolute, between: [front.top, trough.front]}
  bearing: {kind: revolute, between: [ground.shaft, crank], start_deg: 90}
  pin: {kind: revolute, between: [crank.pin, rod]}
  eye: {kind: revolute, between: [rod.end, trough]}
drives: {motor: {kind: constant_speed, joint: bearing, speed_rpm: 400}}
"""


def test_a_loop_closes_near_the_guess_without_whole_turns():
    told, _ = run(PARALLEL, 0.001)
    for name in ("rear_bush", "front_bush"):
        assert math.degrees(told[0].linkage.joint(name).position) == pytest.approx(20.0, abs=0.1)


FOUR_BAR = """
ground: {points_m: {right: [0.4, 0]}}
bodies:
  crank: {inertia_kg_m2: 0.01, points_m: {pin: [0.1, 0]}}
  coupler: {inertia_kg_m2: 0.01, points_m: {end: [0.4, 0]}}
  rocker: {inertia_kg_m2: 0.01, points_m: {end: [0.3, 0]}}
joints:
  bearing: {kind: revolute, between: [ground, crank], start_deg: 60}
  pin: {kind: revolute, between: [crank.pin, coupler]}
  pivot: {kind: revolute, between: [ground.right, rocker]}
  eye: {kind: revolute, between: [coupler.end, rocker.end]}
drives: {motor: {kind: constant_speed, joint: bearing, speed_rpm: 60}}
"""
OPEN_DEG = 2.0 * math.degrees(math.atan2(math.sqrt(3.0) / 20.0, -0.35)) - 240.0  # of the pivot; crossed: -120


@pytest.mark.parametrize("joint, guess, closed", [
    ("pivot", 120.0, OPEN_DEG), ("pivot", 10.0, OPEN_DEG), ("pivot", -60.0, -120.0), ("pivot", -140.0, -120.0),
    ("eye", 70.0, 60.0), ("eye", -70.0, -60.0),
])  # fmt: skip
def test_a_loop_closes_in_the_pose_nearest_to_the_guess(joint, guess, closed):
    told, _ = run(FOUR_BAR, 0.001, joints={joint: {"start_deg": guess}})
    off = math.degrees(told[0].linkage.joint(joint).position) - closed
    assert math.remainder(off, 360.0) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_slider_starts_on_the_side_of_its_guess(sign):
    told, _ = run(SLIDER_CRANK, 0.001, joints={"guide": {"start_m": sign * 0.4}})
    expected = 0.1 * math.cos(math.pi / 6.0) + sign * math.sqrt(0.4**2 - 0.05**2)
    assert told[0].linkage.joint("guide").position == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("rate", [17128.20512820513, 33353.38345864661])
def test_friction_that_lets_go_beside_a_closed_gap_is_no_endless_series_of_events(rate):
    """The ram has come to rest on its anvil by rounding inside it; there its friction reaches the bound."""
    found = rollout("config/pages/spring_hammer.yaml", 0.2, {"springs.spring.rate_n_per_m": rate})
    assert len(found.event_numbers.kind) < 100
    assert abs(found["linkage.residual.energy_balance"]).max() < 1e-9


CLASHING = """
gravity_m_per_s2: [0, -9.81]
ground: {points_m: {floor: [0, 0]}}
bodies:
  {ball: {mass_kg: 1}, cart: {mass_kg: 2}, SHAKEN: {mass_kg: 3}, wheel: {inertia_kg_m2: 1}, half: {inertia_kg_m2: 1}}
joints:
  fall: {kind: slider, between: [ground, ball], direction_deg: 90, start_m: 0.1}
  way: {kind: slider, between: [ground, cart], start_m: 0.1}
  TRACK: {kind: slider, between: [ground, SHAKEN], start_m: 0.1, start_m_per_s: 7}
  axle: {kind: revolute, between: [ground, wheel]}
  second: {kind: revolute, between: [ground, half]}
drives:
  push: {kind: constant_force, joint: way, force_n: 5}
  TOTAL: {kind: constant_force, joint: TRACK, force_n: 0.5}
  motor: {kind: dc_motor, joint: axle, stall_torque_nm: 1, no_load_speed_rpm: 60, gear_ratio: 2, gear_efficiency: 0.9}
  shaker: {kind: unbalance, point: cart, mass_kg: 0.1, radius_m: 0.01, speed_rpm: 600}
couplings:
  belt: {kind: belt, joints: [axle, second], ratio: 1, rate_nm_per_rad: 1, damping_nms_per_rad: 0.1, efficiency: 0.9}
dampers:
  BLOWS: {joint: way, rate_ns_per_m: 3}
  GEAR: {joint: TRACK, rate_ns_per_m: 2}
  LOSS: {joint: TRACK, rate_ns_per_m: 1}
friction: {a: {joint: way, coulomb_n: 1}, b: {joint: way, coulomb_n: 0.5}, RUB: {joint: TRACK, coulomb_n: 0.1}}
contacts: {hit: {point: ball, line: ground.floor, normal_deg: 90, restitution: 0.4, friction: 0.1}}
outputs: {SPEED: {distance: [ground.floor, cart]}}
"""
ITS_OWN = {
    "BLOWS": "impacts", "TOTAL": "drive", "GEAR": "motor_gear", "LOSS": "belt_loss", "RUB": "hit_friction",
    "SHAKEN": "shaker_mass", "TRACK": "hit_impact", "SPEED": "way_speed",
}  # fmt: skip


def test_names_lose_no_number():
    told = []
    for names in ({name: name.lower() for name in ITS_OWN}, ITS_OWN):
        text = CLASHING
        for place, name in names.items():
            text = text.replace(place, name)
        frames, simulation = run(text, 0.3)
        samples = [*frames[-1].linkage.memory.as_dict().values(), *frames[-1].forces.quantities.as_dict().values()]
        told.append((sorted(samples), sorted(simulation.numbers().values())))
    for plain, clashing in zip(*told, strict=True):
        assert clashing == pytest.approx(plain, rel=1e-12)


TRAMMEL = """
gravity_m_per_s2: [0, 0]
bodies:
  across: {mass_kg: 2}
  up: {mass_kg: 2}
  bar: {mass_kg: 0, inertia_kg_m2: 0.01, points_m: {end: [0.5, 0]}}
joints:
  x: {kind: slider, between: [ground, across], start_m: 0.3}
  y: {kind: slider, between: [ground, up], direction_deg: 90, start_m: 0.4, start_m_per_s: 1}
  first: {kind: revolute, between: [across, bar], start_deg: 120}
  second: {kind: revolute, between: [bar.end, up]}
"""


def test_a_bar_on_two_sliders_turns_through_their_dead_points():
    told, _ = run(TRAMMEL, 3.0)
    rate = 1.0 / (0.5 * math.cos(math.pi / 3.0))  # across and up are as one mass that goes round
    for frame in told[::100]:
        angle = math.pi / 3.0 + rate * frame.linkage.time_s
        at = frame.linkage.joint("x").position, frame.linkage.joint("y").position
        assert at == pytest.approx((0.5 * math.cos(angle), 0.5 * math.sin(angle)), abs=1e-9)


@pytest.mark.slow
def test_a_crank_behind_a_slip_clutch_turns_through_the_dead_centres_of_its_slider():
    changes = {
        "bodies": {"hub": {"inertia_kg_m2": 0.1}},
        "joints": {
            "shaft": {"kind": "revolute", "between": ["ground", "hub"]},
            "bearing": {"between": ["hub", "crank"]},
        },
        "drives": {"motor": {"kind": "constant_torque", "joint": "shaft", "speed_rpm": None, "torque_nm": 10}},
        "friction": {"clutch": {"joint": "bearing", "coulomb_nm": 4}},
    }
    told, simulation = run(SLIDER_CRANK, 2.0, **changes)
    assert simulation.numbers()["run_clutch_work_j"] < -10.0
    turned = told[-1].linkage.joint("shaft").position + told[-1].linkage.joint("bearing").position
    assert turned > 4.0 * math.pi
    assert max(abs(frame.linkage.residuals["energy_balance"]) for frame in told) < 1e-7


@pytest.mark.slow
def test_closed_rigid_contacts_do_not_drift(tmp_path):
    two_feet = tmp_path / "box.yaml"
    two_feet.write_text("""
bodies:
  table: {mass_kg: 50}
  slide: {mass_kg: 1}
  lifted: {mass_kg: 1}
  part: {mass_kg: 5, inertia_kg_m2: 0.05, points_m: {left: [-0.2, 0], right: [0.3, 0]}}
joints:
  lift: {kind: slider, between: [ground, table], direction_deg: 90, start_m: -0.0179}
  along: {kind: slider, between: [ground, slide]}
  ride: {kind: slider, between: [slide, lifted], direction_deg: 90, start_m: -0.0179}
  tilt: {kind: revolute, between: [lifted, part]}
springs:
  mount: {joint: lift, rate_n_per_m: 3.0e+4, free_m: 0}
  side: {joint: along, rate_n_per_m: 1000, free_m: 0.02}
dampers: {loss: {joint: lift, rate_ns_per_m: 200}}
drives: {shaker: {kind: unbalance, point: table, mass_kg: 1, radius_m: 0.1, speed_rpm: 300}}
contacts:
  near: {point: part.left, line: table, normal_deg: 90, restitution: 0.0}
  far: {point: part.right, line: table, normal_deg: 90, restitution: 0.0, friction: 0.1}
""")
    told = rollout(str(two_feet), duration_s=100.0).columns
    lifted = told["linkage.ride.position"] - told["linkage.lift.position"]
    tilt = np.sin(told["linkage.tilt.position"])
    assert told["linkage.regime"].min() == 1.0
    for arm_m in (-0.2, 0.3):
        assert np.abs(lifted + arm_m * tilt).max() < 2e-12

# SPDX-License-Identifier: Apache-2.0
"""Elements of a page against their closed forms, with the energy in balance."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from machines.page.pages import BALL, SLIDER_CRANK, page, run

from mech_twin import rollout
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.machines.page import build
from mech_twin.machines.page.parameters import Page
from mech_twin.samples import EffortCommand

BLOCK = """
gravity_m_per_s2: [0, 0]
bodies: {block: {mass_kg: 2}}
joints: {guide: {kind: slider, between: [ground, block]}}
"""
WHEEL = """
gravity_m_per_s2: [0, 0]
bodies: {wheel: {inertia_kg_m2: 0.5}}
joints: {shaft: {kind: revolute, between: [ground, wheel]}}
"""
TWO_WHEELS = """
gravity_m_per_s2: [0, 0]
bodies: {first: {inertia_kg_m2: 0.2}, second: {inertia_kg_m2: 0.3}}
joints:
  first_shaft: {kind: revolute, between: [ground, first], start_rad_per_s: 2}
  second_shaft: {kind: revolute, between: [ground, second]}
"""
SHAKER = """
gravity_m_per_s2: [0, 0]
bodies: {box: {mass_kg: 9}}
joints: {guide: {kind: slider, between: [ground, box]}}
springs: {spring: {joint: guide, rate_n_per_m: 4000, free_m: 0}}
drives: {shaker: {kind: unbalance, point: box, mass_kg: 1, radius_m: 0.05, speed_rpm: 300}}
"""


def balanced(text, duration_s, **changes):
    """Return frames and simulation of a run whose residuals keep their limits."""
    told, simulation = run(text, duration_s, **changes)
    assert all(r.worst <= r.limit for r in simulation.residuals().values()), simulation.residuals()
    return told, simulation


def moving(speed):
    return {"joints": {"guide": {"start_m_per_s": speed}}}


def test_a_progressive_spring_has_the_turning_point_of_its_two_rates():
    k1, k2, bend, v0, mass = 200.0, 1000.0, 0.1, 2.0, 2.0
    rows = [[-1.0, 200.0], [0.1, -20.0], [1.0, -20.0 - 900.0]]
    told, _ = balanced(BLOCK, 0.4, springs={"spring": {"joint": "guide", "table_m_n": rows}}, **moving(v0))
    w1, w2 = math.sqrt(k1 / mass), math.sqrt(k2 / mass)
    met = math.asin(bend * w1 / v0) / w1
    v1 = math.sqrt(v0**2 - (w1 * bend) ** 2)
    at_rest = bend - k1 * bend / k2  # of the second rate's line
    for frame in told[::13]:
        t = frame.linkage.time_s
        if t <= met:
            x = v0 / w1 * math.sin(w1 * t)
        elif t <= met + 0.1:
            into = t - met
            x = at_rest + (bend - at_rest) * math.cos(w2 * into) + v1 / w2 * math.sin(w2 * into)
        else:
            continue
        assert frame.linkage.position[0] == pytest.approx(x, abs=1e-10)


GAS = {"joint": "guide", "gas": {"area_m2": -0.002, "volume_m3": 4e-4, "pressure_pa": 3e5, "exponent": 1.3}}


def gas_energy(x, area=0.002, v0=4e-4, p0=3e5, n=1.3, outside=101325.0):
    """Return the work that takes a chamber from its start to a travel that makes it smaller."""
    v = v0 - area * x
    return p0 * v0 / (n - 1.0) * ((v0 / v) ** (n - 1.0) - 1.0) - outside * area * x


def test_a_gas_spring_keeps_the_energy_of_its_adiabat():
    told, _ = balanced(BLOCK, 0.2, springs={"cushion": GAS}, **moving(6.0))
    reach = 0.0
    for frame in told:
        x, v = frame.linkage.position[0], frame.linkage.velocity[0]
        assert v * v + gas_energy(x) == pytest.approx(36.0, rel=1e-9)
        assert frame.linkage.memory["cushion_work_j"] == pytest.approx(-gas_energy(x), abs=1e-8)
        reach = max(reach, x)
    assert reach > 0.05


def test_an_open_port_lets_the_gas_out_and_closes_on_air():
    ports = {"vent": {"joint": "guide", "open_below_m": -0.02}}
    gas = {**GAS["gas"], "ports": ports, "exponent": 1.4}
    there = {"springs": {"cushion": {"joint": "guide", "gas": gas}}, **moving(-1.0)}
    pull = {"back": {"point": "block", "force_n": [300.0, 0.0]}}
    told, simulation = balanced(BLOCK, 0.2, loads=pull, **there)
    out, back = [event.time_s for event in simulation.events if event.kind == "switch"][:2]
    assert 0.0 < out < back
    shut = 4e-4 + 0.002 * 0.02
    seen = 0
    for frame in told:
        t, force = frame.linkage.time_s, frame.forces.quantities["cushion_force_n"]
        volume = 4e-4 - 0.002 * frame.linkage.position[0]
        if t < out:
            expected = -0.002 * (3e5 * (4e-4 / volume) ** 1.4 - 101325.0)
        elif t < back:
            expected = 0.0
        elif frame.linkage.position[0] > -0.02:
            expected = -0.002 * 101325.0 * ((shut / volume) ** 1.4 - 1.0)
            seen += 1
        else:
            break
        assert force == pytest.approx(expected, abs=1e-6)
    assert seen > 20


def test_a_leak_empties_a_chamber_to_the_pressure_outside():
    gas = {**GAS["gas"], "exponent": 1.0, "leak_per_s": 3.0}
    held = {"hold": {"kind": "constant_speed", "joint": "guide", "speed_m_per_s": 0.0}}
    told, _ = balanced(BLOCK, 1.0, springs={"cushion": {"joint": "guide", "gas": gas}}, drives=held)
    left = 101325.0 / 3e5
    for frame in told[::100]:
        share = left + (1.0 - left) * math.exp(-3.0 * frame.linkage.time_s)
        assert frame.linkage.memory["cushion_gas_1"] == pytest.approx(share, abs=1e-11)
        assert frame.linkage.effort[0] == pytest.approx(0.002 * (3e5 * share - 101325.0), rel=1e-9)


def drive(**keys):
    return {"drives": {"motor": {"kind": "table", **keys}}}


def test_a_torque_by_speed_runs_up_as_its_straight_line():
    rows = [[-1000.0, 20.0], [0.0, 10.0], [1000.0, 0.0]]
    told, _ = balanced(WHEEL, 1.0, **drive(joint="shaft", table_rpm_nm=rows, gear_ratio=2.0))
    full = 1000.0 * math.pi / 30.0
    rate = 2.0 * 2.0 * 10.0 / full / 0.5
    for frame in told[::100]:
        speed = 0.5 * full * (1.0 - math.exp(-rate * frame.linkage.time_s))
        assert frame.linkage.velocity[0] == pytest.approx(speed, abs=1e-9)
        assert frame.forces.quantities["motor_torque_nm"] == pytest.approx(2.0 * 10.0 * (1.0 - 2.0 * speed / full))


def test_a_force_over_time_gives_the_momentum_of_its_area():
    rows = [[0.0, 0.0], [0.0503, 40.0], [0.06, -10.0], [0.1, 0.0]]
    told, _ = balanced(BLOCK, 1.0, **drive(joint="guide", table_s_n=rows, period_s=0.1))
    area = 0.5 * 40.0 * 0.0503 + 0.5 * 30.0 * 0.0097 - 0.5 * 10.0 * 0.04
    for periods in (1, 5, 10):
        assert told[100 * periods].linkage.velocity[0] == pytest.approx(periods * area / 2.0, rel=1e-11)
    assert told[25].motor.effort[0] == pytest.approx(40.0 * 0.025 / 0.0503, rel=1e-12)


@pytest.mark.parametrize("step_s", [0.01, 0.001])
def test_a_force_under_a_rising_supply_gives_the_momentum_of_its_area_at_every_step(step_s):
    ramp = {"supply": {"initial_fraction": 0.0, "rate_per_s": 2.0}, "coupling": {"step_s": step_s}}
    constant = {"drives": {"motor": {"kind": "constant_force", "joint": "guide", "force_n": 16.0}}}
    told, _ = balanced(BLOCK, 0.5, **ramp, **constant)
    for frame in told:
        t = frame.linkage.time_s
        assert frame.linkage.velocity[0] == pytest.approx(0.5 * 16.0 * 2.0 * t * t / 2.0, abs=1e-12)


@pytest.mark.parametrize(
    "motor",
    [
        {"kind": "constant_torque", "torque_nm": 5.0},
        {"kind": "dc_motor", "stall_torque_nm": 5.0, "no_load_speed_rpm": 300.0},
        {"kind": "dc_motor", "stall_torque_nm": 5.0, "no_load_speed_rpm": 300.0, "gear_ratio": 3.0},
    ],
)
def test_an_asked_torque_turns_a_wheel_by_newton_s_law_whatever_the_motor(motor):
    machine = build(page(WHEEL, drives={"motor": {**motor, "joint": "shaft"}}))
    run = rollout(machine, 0.2, command=lambda step: EffortCommand(2.0) if step >= 50 else 1.0)
    speed = run["linkage.shaft.velocity"]
    gained = 2.0 * motor.get("gear_ratio", 1.0) * (run["time_s"][50:] - run["time_s"][50]) / 0.5
    np.testing.assert_allclose(speed[50:] - speed[50], gained, rtol=1e-12, atol=1e-12)
    assert set(run["motor.motor.effort"][50:]) == {2.0}


def test_a_torque_over_the_angle_does_the_same_work_each_turn():
    rows = [[10.0, 0.0], [100.0, 40.0], [200.0, 5.0], [370.0, 0.0]]
    told, _ = balanced(WHEEL, 1.0, joints={"shaft": {"start_deg": 20.0}}, **drive(joint="shaft", table_deg_nm=rows))
    x, y = np.array(rows).T
    turn = math.radians(np.trapezoid(y, x))

    def work(angle):
        turns, into = divmod(math.degrees(angle) - 10.0, 360.0)
        at = np.interp(10.0 + into, x, y)
        ahead = x < 10.0 + into
        return turns * turn + math.radians(np.trapezoid([*y[ahead], at], [*x[ahead], 10.0 + into]))

    assert told[-1].linkage.position[0] > 4.0 * math.pi
    for frame in told[::50]:
        energy = 0.25 * frame.linkage.velocity[0] ** 2
        done = work(frame.linkage.position[0]) - work(math.radians(20.0))
        assert energy == pytest.approx(done, abs=1e-9)


def test_a_resistance_over_the_travel_stops_where_its_area_is_the_energy():
    load = {"cut": {"joint": "guide", "table_m_n": [[0.1, 0.0], [0.2, 50.0], [1.0, 50.0]], "against": "forward"}}
    told, simulation = balanced(BLOCK, 0.5, loads=load, **moving(3.0))
    assert told[-1].linkage.velocity[0] == 0.0
    assert told[-1].linkage.position[0] == pytest.approx(0.2 + (9.0 - 2.5) / 50.0, abs=1e-11)
    assert told[-1].linkage.memory["cut_work_j"] == pytest.approx(-9.0, rel=1e-11)
    assert [event.kind for event in simulation.events] == ["stick"]


def test_a_load_by_speed_slows_as_its_straight_line():
    load = {"fan": {"joint": "shaft", "table_rpm_nm": [[0.0, 0.0], [600.0, -30.0]]}}
    told, _ = balanced(WHEEL, 0.5, loads=load, joints={"shaft": {"start_rad_per_s": 50.0}})
    rate = 30.0 / (20.0 * math.pi) / 0.5
    for frame in told[::50]:
        assert frame.linkage.velocity[0] == pytest.approx(50.0 * math.exp(-rate * frame.linkage.time_s), rel=1e-10)


def test_an_elastic_shaft_swings_at_the_frequency_of_its_two_inertias():
    shaft = {"shaft": {"kind": "shaft", "joints": ["first_shaft", "second_shaft"], "rate_nm_per_rad": 600.0}}
    shaft["shaft"]["damping_nms_per_rad"] = 0.4
    told, _ = balanced(TWO_WHEELS, 0.5, couplings=shaft)
    inertia = 0.2 * 0.3 / 0.5
    decay, w0 = 0.5 * 0.4 / inertia, math.sqrt(600.0 / inertia)
    w = math.sqrt(w0 * w0 - decay * decay)
    for frame in told[::20]:
        t = frame.linkage.time_s
        twist = 2.0 / w * math.exp(-decay * t) * math.sin(w * t)
        first, second = frame.linkage.position
        assert first - second == pytest.approx(twist, abs=1e-11)
        assert 0.2 * first + 0.3 * second == pytest.approx(0.4 * t, abs=1e-11)


def test_a_shaft_with_backlash_carries_nothing_across_its_play():
    shaft = {"kind": "shaft", "joints": ["first_shaft", "second_shaft"], "rate_nm_per_rad": 600.0, "backlash_deg": 6.0}
    told, simulation = balanced(TWO_WHEELS, 0.2, couplings={"shaft": shaft})
    w, half = math.sqrt(600.0 / 0.12), math.radians(3.0)
    kinds = [(event.kind, event.contact) for event in list(simulation.events)[:3]]
    assert kinds == [("contact", "shaft_forward"), ("release", "shaft_forward"), ("contact", "shaft_backward")]
    met, left, back = [event.time_s for event in list(simulation.events)[:3]]
    assert met == pytest.approx(half / 2.0, abs=1e-9)
    assert left == pytest.approx(met + math.pi / w, abs=1e-9)
    assert back == pytest.approx(left + half, abs=1e-9)
    assert all(f.forces.quantities["shaft_moment_nm"] == 0.0 for f in told if left < f.linkage.time_s < back)


@pytest.mark.parametrize(
    ("load", "acceleration"), [(14.0, (16.0 - 14.0) / 0.5), (20.0, 0.0), (26.0, (25.0 - 26.0) / 0.5)]
)
def test_a_gear_passes_on_between_eta_m_and_m_over_eta(load, acceleration):
    motor = drive(joint="shaft", table_rpm_nm=[[-1.0, 10.0], [1.0, 10.0]], gear_ratio=2.0, gear_efficiency=0.8)
    told, _ = balanced(WHEEL, 0.2, loads={"weight": {"body": "wheel", "torque_nm": -load}}, **motor)
    assert told[-1].linkage.velocity[0] == pytest.approx(0.2 * acceleration, abs=1e-11)
    lost = told[-1].linkage.memory["motor_gear_work_j"]
    assert lost <= 0.0
    assert (lost < 0.0) == (acceleration != 0.0)


def test_a_wall_gives_way_until_the_blow_is_spent_and_stays():
    wall = {"wall": {"joint": "guide", "gives_way_n": 400.0}}
    told, _ = balanced(BLOCK, 0.3, contacts=wall, **moving(5.0))
    assert told[-1].linkage.position[0] == pytest.approx(25.0 / 400.0, abs=1e-12)
    assert told[-1].linkage.velocity[0] == 0.0
    pushed, _ = balanced(BLOCK, 0.3, contacts=wall, loads={"push": {"point": "block", "force_n": [399.0, 0.0]}})
    assert pushed[-1].linkage.position[0] == 0.0
    assert pushed[-1].forces.quantities["wall_force_n"] == pytest.approx(-399.0)
    pulled, _ = balanced(BLOCK, 0.3, contacts=wall, loads={"pull": {"point": "block", "force_n": [-4.0, 0.0]}})
    assert pulled[-1].linkage.position[0] == pytest.approx(-0.5 * 2.0 * 0.09, rel=1e-10)


DROP = """
gravity_m_per_s2: [0, -10]
ground: {points_m: {top: [0, 0]}}
bodies: {plate: {mass_kg: 2}}
joints: {fall: {kind: slider, between: [ground, plate], direction_deg: 90, start_m: 0.2}}
contacts: {soil: {point: plate, line: ground.top, normal_deg: 90, layer_m_n: [[0, 0], [1, 4000]]}}
"""
PULL = "drives: {pull: {kind: table, joint: fall, table_s_n: [[0.3, 0], [0.301, 60]]}}\n"


def test_a_layer_takes_the_fall_and_then_bears_the_weight():
    told, _ = balanced(DROP, 0.6)
    depth = (20.0 + math.sqrt(400.0 + 2.0 * 4000.0 * 4.0)) / 4000.0
    assert told[-1].linkage.position[0] == pytest.approx(-depth, abs=1e-10)
    assert told[-1].linkage.velocity[0] == 0.0
    soil = told[-1].forces.wrenches[told[-1].forces.pins.index("soil")]
    assert soil.force_y_n == pytest.approx(20.0, rel=1e-10)


def test_a_body_logs_when_it_enters_and_leaves_a_layer():
    _, simulation = balanced(DROP + PULL, 0.8)
    touched = [event for event in simulation.events if event.kind in ("contact", "release")]
    assert [event.kind for event in touched] == ["contact", "release"]
    assert touched[0].time_s == pytest.approx(0.2, abs=1e-10)


def test_a_layer_gives_nothing_back_and_lets_the_plate_go():
    told, _ = balanced(DROP + PULL, 0.8)
    assert told[-1].linkage.position[0] > 0.2
    work = told[-1].linkage.memory["soil_work_j"]
    depth = (20.0 + math.sqrt(400.0 + 2.0 * 4000.0 * 4.0)) / 4000.0
    assert work == pytest.approx(-2000.0 * depth**2, rel=1e-9)


def test_an_unbalance_shakes_its_body_as_a_rotating_force():
    told, _ = balanced(SHAKER, 1.0)
    w, w0 = 10.0 * math.pi, math.sqrt(4000.0 / 10.0)
    size = 0.05 * w * w / 10.0 / (w0 * w0 - w * w)
    for frame in told[::25]:
        t = frame.linkage.time_s
        x = size * (math.cos(w * t) - math.cos(w0 * t))
        assert frame.linkage.joint("guide").position == pytest.approx(x, abs=1e-10)


@pytest.mark.parametrize("text", [BALL, SLIDER_CRANK, SHAKER])
def test_a_page_is_the_same_when_all_of_its_keys_are_given(text):
    """As a recording and the nodes of a run give them."""
    assert Page.model_validate(configuration_tree(page(text))) == page(text)


def test_the_numbers_of_a_run_leave_out_what_comes_before_it_has_settled():
    rate, mass, v0, settle_s = 4.0, 2.0, 3.0, 0.5
    dampers = {"oil": {"joint": "guide", "rate_ns_per_m": rate}}
    numbers = balanced(BLOCK, 1.0, dampers=dampers, settle_s=settle_s, **moving(v0))[1].numbers()
    v1, v2 = (v0 * math.exp(-rate * t / mass) for t in (settle_s, 1.0))
    assert numbers["guide_speed_max_m_per_s"] == pytest.approx(v1, rel=1e-9)
    assert numbers["run_oil_work_j"] == pytest.approx(0.5 * mass * (v2**2 - v1**2), rel=1e-9)
    assert balanced(BLOCK, 0.4, dampers=dampers, settle_s=settle_s, **moving(v0))[1].numbers() == {}


def test_blows_before_a_run_has_settled_do_not_count():
    every, settled = (run(BALL, 2.0, settle_s=s)[1].numbers() for s in (0.0, 1.0))
    fall, rise = math.sqrt(0.2), math.sqrt(20.0)  # its blows: fall, fall + rise / 10, ...
    assert fall < 1.0 < fall + rise * 0.5 / 5.0 + rise * 0.25 / 5.0
    before = sum(fall + rise / 5.0 * (1.0 - 0.5**k) < 1.0 for k in range(10))
    assert every["bounce_impacts"] - settled["bounce_impacts"] == before
    assert settled["bounce_impact_speed_max_m_per_s"] == pytest.approx(rise * 0.5**before, rel=1e-9)


def test_a_resisted_slider_passes_its_dead_centres_with_its_crank():
    """There the slider has no velocity for its load to use up: the crank loses the work of the load, and no more."""
    free = {"motor": {"kind": "constant_torque", "torque_nm": 0.0, "speed_rpm": None}}
    cut = {"cut": {"joint": "guide", "against_forward_n": 10.0}}
    told, _ = run(SLIDER_CRANK, 0.5, drives=free, joints={"bearing": {"start_rad_per_s": 60.0}}, loads=cut)
    travels = [frame.linkage.joint("guide").position for frame in told]
    forward = sum(max(after - before, 0.0) for before, after in pairwise(travels))
    assert -told[-1].linkage.memory["cut_work_j"] == pytest.approx(10.0 * forward, rel=1e-3)
    for frame in told:
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-7
    assert told[-1].linkage.joint("bearing").position > 20.0


def test_a_joint_is_as_it_started_at_each_turn_and_what_it_had_is_booked():
    """A block of 2 kg under 6 N is taken back from 0.25 turns on, each turn of 0.5 s: v = F t / m at each."""
    feed = {
        "bodies": {"wheel": {}},
        "joints": {
            "shaft": {"kind": "revolute", "between": ["ground", "wheel"], "start_deg": 0},
            "guide": {"start_m": 0.3, "start_m_per_s": 0.2},
        },
        "drives": {
            "motor": {"kind": "constant_speed", "joint": "shaft", "speed_rpm": 120},
            "push": {"kind": "constant_force", "joint": "guide", "force_n": 6},
        },
        "resets": {"feed": {"joint": "guide", "by": "shaft", "at_deg": 90}},
    }
    told, _ = balanced(BLOCK, 1.8, **feed)
    assert [e.time_s for f in told for e in f.linkage.events] == pytest.approx([0.125, 0.625, 1.125, 1.625], abs=1e-9)
    for f in told:
        since = f.linkage.time_s if f.linkage.time_s < 0.125 else (f.linkage.time_s - 0.125) % 0.5
        if 1e-6 < since < 0.5 - 1e-6:
            there = 0.3 + 0.2 * since + 0.5 * 3.0 * since**2
            assert f.linkage.joint("guide").position == pytest.approx(there, abs=1e-10)
    lost = (0.2 + 3.0 * 0.125) ** 2 + 3.0 * (0.2 + 3.0 * 0.5) ** 2 - 4.0 * 0.2**2
    assert told[-1].linkage.memory["feed_work_j"] == pytest.approx(-lost, rel=1e-9)


def test_energy_is_in_balance_where_kinetic_and_potential_energy_cancel():
    fall = {"guide": {"direction_deg": 90.0}}
    told, _ = balanced(BLOCK, 1.0, gravity_m_per_s2=[0.0, -9.81], joints=fall)
    assert told[-1].linkage.velocity[0] == pytest.approx(-9.81, rel=1e-12)
    balanced(
        BLOCK,
        1.0,
        gravity_m_per_s2=[0.0, -9.81],
        joints=fall,
        springs={"k": {"joint": "guide", "rate_n_per_m": 50.0, "free_m": 0.0}},
    )


def test_signed_forces_have_a_least_and_a_largest_value():
    rub = {"rub": {"joint": "guide", "coulomb_n": 12.0}}
    push = {"push": {"kind": "program", "joint": "guide", "levels_n": [10.0, -40.0], "period_s": 0.1, "first_s": 0.05}}
    _, simulation = balanced(BLOCK, 0.3, friction=rub, drives=push)
    numbers = simulation.numbers()
    assert (numbers["push_force_min_n"], numbers["push_force_max_n"]) == (-40.0, 10.0)
    assert numbers["rub_force_max_n"] == 12.0
    assert numbers["rub_force_min_n"] == pytest.approx(-10.0)  # it holds against the push

# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a page is told in one line that names element, key and what was expected."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from machines.page.pages import BALL, PENDULUM, SLIDER_CRANK, page, run

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.hybrid.loop import TOO_MANY
from mech_twin.errors import MotionError
from mech_twin.machines.page import build
from mech_twin.parameters.load import PAGE, machine_parameters, validated

PAGES = Path(__file__).parents[3] / "config" / "pages"
BIT = """
name: bit
gravity_m_per_s2: [0, 0]
bodies: {housing: {mass_kg: 3.5}, striker: {mass_kg: 0.15}, bit: {mass_kg: 0.3}}
joints:
  hold: {kind: slider, between: [ground, housing]}
  barrel: {kind: slider, between: [ground, striker], start_m: -0.01, start_m_per_s: 10}
  seat: {kind: slider, between: [ground, bit]}
contacts:
  blow: {point: striker, line: bit, normal_deg: 180, restitution: 0.81}
  nose: {point: housing, line: bit, normal_deg: 180, restitution: 0.79}
  wall: {joint: seat, gives_way_n: 4000}
loads:
  operator: {point: housing, force_n: [138, 0]}
  air: {point: striker, force_n: [199, 0]}
"""


def refused(text, **changes):
    """Return why a page is refused."""
    with pytest.raises(ValueError) as refusal:  # of pydantic, or of the configuration
        build(page(text, **changes))
    return str(refusal.value)


def test_a_setting_of_an_element_that_is_not_there_names_those_there(tmp_path):
    file = tmp_path / "spring_hammer.yaml"
    file.write_text((PAGES / "spring_hammer.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"--set springs.sprng.rate_n_per_m \(new: springs has spring\): key"):
        machine_parameters("page", file, {"springs.sprng.rate_n_per_m": 5.0})


def test_an_unknown_point_is_named_with_those_there():
    told = refused(SLIDER_CRANK, joints={"pin": {"between": ["crank.pinn", "rod"]}})
    assert "joints.pin.between: crank has no point 'pinn'; expected one of pin" in told


@pytest.mark.parametrize(("group", "kind"), [("drives", {"kind": "table"}), ("loads", {})])
def test_a_table_of_a_whole_turn_ends_as_it_begins(group, kind):
    rows = [[0, 1.0], [90, 4.0], [360, 3.0]]
    told = refused(PENDULUM, **{group: {"one": {**kind, "joint": "pivot", "table_deg_nm": rows}}})
    assert "a table of 360 deg holds for every turn: its last value must be its first, 1, got 3" in told
    rows[-1][1] = 1.0
    build(page(PENDULUM, **{group: {"one": {**kind, "joint": "pivot", "table_deg_nm": rows}}}))


@pytest.mark.parametrize("length_m", [1e3, 1e4])
def test_a_loop_that_cannot_close_is_refused_at_any_length(length_m):
    text = (PAGES / "slider_crank.yaml").read_text(encoding="utf-8")
    told = refused(text, bodies={"rod": {"points_m": {"end": [0.2, length_m]}}})
    assert told.startswith("joints")


def test_places_reach_as_far_as_other_lengths():
    told = refused(SLIDER_CRANK, bodies={"rod": {"points_m": {"end": [1e8, 0.0]}}})
    assert "expected two numbers up to 10000" in told


@pytest.mark.parametrize(
    ("group", "element"),
    [
        ("joints", {"kind": "weld", "between": ["crank.pin", "crank"]}),
        ("springs", {"between": ["crank.pin", "crank"], "rate_n_per_m": 1.0, "free_m": 0.1}),
        ("dampers", {"between": ["crank.pin", "crank"], "rate_ns_per_m": 1.0}),
    ],
)
def test_what_joins_a_body_with_itself_is_refused(group, element):
    told = refused(SLIDER_CRANK, **{group: {"one": element}})
    assert f"{group}.one.between: both points are of crank; expected two bodies" in told


def test_an_unknown_body_and_joint_are_named():
    assert "no body 'pistn'" in refused(SLIDER_CRANK, joints={"wrist": {"between": ["rod.end", "pistn"]}})
    assert "drives.motor.joint: no joint 'berring'" in refused(SLIDER_CRANK, drives={"motor": {"joint": "berring"}})
    gear = {"kind": "gear", "joints": ["bearing", "lay"], "ratio": 2.0}
    assert "couplings.gear.joints: no joint 'lay'" in refused(SLIDER_CRANK, couplings={"gear": gear})


def test_a_key_of_another_kind_is_refused():
    told = refused(SLIDER_CRANK, joints={"bearing": {"start_m": 0.1}})
    assert "kind revolute has no key start_m" in told
    told = refused(SLIDER_CRANK, drives={"motor": {"torque_nm": 1.0}})
    assert "kind constant_speed has no key torque_nm" in told


def test_units_of_slider_and_revolute_are_kept_apart():
    told = refused(SLIDER_CRANK, friction={"rub": {"joint": "guide", "coulomb_nm": 1.0}})
    assert "friction.rub.joint: 'guide' is a slider; expected keys in m, m/s, or N" in told


@pytest.mark.slow
def test_a_loop_that_cannot_close_tells_by_how_much():
    told = refused(
        SLIDER_CRANK, joints={"guide": {"between": ["ground.far", "piston"]}}, ground={"points_m": {"far": [0.0, 2.0]}}
    )
    assert "cannot close" in told
    assert "1.5 m" in told


def test_no_freedom_left_is_told():
    told = refused(PENDULUM, joints={"weld": {"kind": "weld", "between": ["ground", "rod"]}})
    assert "hold its bodies already" in told or "no freedom is left" in told


def test_a_motion_without_inertia_is_named():
    told = refused(PENDULUM, bodies={"rod": {"mass_kg": 0.0, "inertia_kg_m2": 0.0}})
    assert "joints.pivot: a motion without inertia" in told


def test_a_stop_does_not_rub():
    told = refused(BALL, contacts={"stop": {"joint": "fall", "most_m": 2.0, "restitution": 0.0, "friction": 0.1}})
    assert "friction: a stop has no line" in told


def test_a_contact_that_begins_inside_is_named_with_its_depth():
    told = refused(BALL, joints={"fall": {"start_m": -0.25}})
    assert "contacts.bounce: begins 0.25 m behind its line" in told


def test_two_drives_of_one_joint_are_refused():
    told = refused(SLIDER_CRANK, drives={"second": {"kind": "constant_torque", "joint": "bearing", "torque_nm": 1.0}})
    assert "given speed already" in told


def test_more_given_speeds_than_freedoms_are_refused():
    told = refused(SLIDER_CRANK, drives={"second": {"kind": "constant_speed", "joint": "guide", "speed_m_per_s": 1.0}})
    assert "drives: bearing, guide have a given speed, but the machine has 1 freedom" in told


def test_a_second_given_speed_in_one_loop_is_named_though_a_freedom_is_left_elsewhere():
    rail = {"kind": "slider", "between": ["ground", "cart"]}
    drives = {"second": {"kind": "constant_speed", "joint": "guide", "speed_m_per_s": 1.0}}
    told = refused(SLIDER_CRANK, drives=drives, bodies={"cart": {"mass_kg": 1.0}}, joints={"rail": rail})
    assert "drives: the loops lead guide with bearing; give it no speed" in told


def test_a_given_speed_of_a_joint_that_a_coupling_holds_is_named():
    held = {"tie": {"kind": "gear", "joints": ["bearing", "wrist"], "ratio": 1.0}}
    rail = {"kind": "slider", "between": ["ground", "cart"]}
    told = refused(SLIDER_CRANK, couplings=held, bodies={"cart": {"mass_kg": 1.0}}, joints={"rail": rail})
    assert "joints: the loops hold bearing, which has a given speed; take one away" in told


def test_a_body_that_nothing_joins_is_named():
    told = refused(PENDULUM, bodies={"stone": {"mass_kg": 1.0}})
    assert "nothing joins stone to the ground" in told


def test_speeds_that_contradict_each_other_are_refused():
    told = refused(
        SLIDER_CRANK,
        drives={"motor": {"kind": "constant_torque", "torque_nm": 1.0, "speed_rpm": None}},
        joints={"bearing": {"start_rad_per_s": 1.0}, "guide": {"start_m_per_s": 5.0}},
    )
    assert "the speed at the start contradicts" in told


def test_a_spring_between_points_that_coincide_is_refused():
    told = refused(PENDULUM, springs={"coil": {"between": ["ground", "rod"], "rate_n_per_m": 10.0, "free_m": 0.1}})
    assert "springs.coil.between: ground and rod coincide at the start" in told
    wrist = ["rod.end", "piston"]  # apart by rounding
    told = refused(SLIDER_CRANK, springs={"coil": {"between": wrist, "rate_n_per_m": 10.0, "free_m": 0.1}})
    assert "springs.coil.between: rod.end and piston coincide at the start" in told


def test_a_preload_without_a_rate_is_refused():
    told = refused(PENDULUM, springs={"coil": {"joint": "pivot", "rate_nm_per_rad": 0.0, "preload_nm": 5.0}})
    assert "preload_nm needs rate_nm_per_rad above 0" in told


BLOCK = """
bodies: {block: {mass_kg: 2}}
joints: {guide: {kind: slider, between: [ground, block]}}
"""


VENT = {"vent": {"joint": "guid", "open_above_m": 1}}


@pytest.mark.parametrize(
    ("group", "element", "told"),
    [
        ("springs", {"joint": "guide", "table_m_n": [[0.0, 1.0], [0.0, 2.0]]}, "the first column must rise"),
        ("springs", {"joint": "guide", "table_m_n": [[0.0, 1.0]]}, "expected 2 to 50 rows, got 1"),
        ("springs", {"joint": "guide", "gas": {"area_m2": 0.0, "volume_m3": 1.0}}, "area_m2 must not be 0"),
        (
            "springs",
            {"joint": "guide", "gas": {"area_m2": 1.0, "volume_m3": 1.0, "ports": VENT}},
            "springs.there.gas.ports.vent.joint: no joint 'guid'",
        ),
        ("couplings", {"kind": "shaft", "joints": ["guide", "guide"], "rate_nm_per_rad": 1.0}, "'guide' is a slider"),
        ("couplings", {"kind": "gear", "joints": ["guide", "other"], "rate_nm_per_rad": 1.0}, "needs the key ratio"),
        (
            "couplings",
            {"kind": "rack", "joints": ["guide", "other"], "radius_m": 0.1, "rate_n_per_m": 1.0},
            "couplings.there.joints: 'guide' is a slider; expected a revolute there",
        ),
        (
            "couplings",
            {"kind": "belt", "joints": ["guide", "other"], "ratio": -1.0, "rate_nm_per_rad": 1.0},
            "ratio of a belt must be above 0",
        ),
        ("contacts", {"joint": "guide", "gives_way_n": 5.0, "most_m": 1.0}, "wall has no key most_m"),
        ("contacts", {"joint": "guide", "most_m": 1.0, "restitution": 0.5, "line": "ground"}, "stop has no key line"),
        (
            "contacts",
            {"joint": "guide", "most_m": 1.0, "restitution": 0.5, "damping_s_per_m": 1.0},
            "stop has no key damping_s_per_m",
        ),
        ("springs", {"joint": "guide", "rate_n_per_m": 1.0, "free_m": 0.0, "free_deg": 5.0}, "no key free_deg"),
        ("springs", {"joint": "guide"}, "exactly one of rate_n_per_m, table_m_n, rate_nm_per_rad, table_deg_nm, gas"),
        ("contacts", {"joint": "guide", "most_m": 0.0, "layer_m_n": [[0.1, 0], [1, 5]]}, "expected depths from 0 on"),
        ("loads", {"joint": "guide", "table_m_n": [[0, -1], [1, 5]]}, "a resistance is 0 or more"),
        ("drives", {"kind": "table", "joint": "guide"}, "expected exactly one of table_rpm_nm"),
        ("drives", {"kind": "table", "joint": "guide", "table_rpm_nm": [[0, 1], [1, 0]]}, "expected keys in m, m/s"),
        ("drives", {"kind": "unbalance", "mass_kg": 1.0, "radius_m": 0.1, "speed_rpm": 9.0}, "needs the key point"),
        ("drives", {"kind": "constant_force", "force_n": 1.0}, "needs the key joint"),
        ("drives", {"kind": "constant_force", "force_n": 1.0, "joint": ""}, "drives.there.joint: no joint ''"),
    ],
)  # fmt: skip
def test_a_wrong_key_of_an_element_is_named_with_what_was_expected(group, element, told):
    assert told in refused(BLOCK, **{group: {"there": element}})


def test_a_stop_that_begins_inside_is_told_as_an_angle():
    stop = {"stop": {"joint": "pivot", "least_deg": -30.0, "restitution": 0.0}}
    assert "contacts.stop: begins 0.5236 rad behind its stop" in refused(PENDULUM, contacts=stop)


def test_a_stop_of_a_slider_that_begins_inside_is_told_as_a_stop():
    stop = {"stop": {"joint": "fall", "most_m": 0.75, "restitution": 0.0}}
    assert "contacts.stop: begins 0.25 m behind its stop" in refused(BALL, contacts=stop)


def test_more_events_than_are_followed_name_page_and_contacts():
    """A ball that loses nothing, and bounces fifty thousand times in a step."""
    upward = {"fall": {"start_m": 0.0, "start_m_per_s": 1e-7}}
    with pytest.raises(MotionError) as ended:
        run(BALL, 0.01, joints=upward, contacts={"bounce": {"restitution": 1.0}})
    told = str(ended.value)
    assert told.startswith(
        "page: more events in a coupling step than are followed, in the step from 0 s, most of bounce;"
    )


def test_more_changes_without_events_than_are_followed_tell_what_to_do():
    linkage = build(page(BALL)).linkage
    told = str(linkage.failure(TOO_MANY, 0.5, linkage.layout.events.table()))
    assert told.startswith("page: more events in a coupling step than are followed, in the step from 0.5 s;")
    assert "give contacts that rest on each other a stiffness" in told


@pytest.mark.parametrize(("blow", "nose", "speed"), [(0.81, 0.79, 10), (0.99, 0.9, 20), (0.7, 0.9, 5), (0.9, 0.99, 10)])
def test_a_bit_between_two_rattling_masses_comes_to_rest_with_its_energy_accounted_for(blow, nose, speed):
    contacts = {"blow": {"restitution": blow}, "nose": {"restitution": nose}}
    frames, simulation = run(BIT, 0.2, contacts=contacts, joints={"barrel": {"start_m_per_s": speed}})
    assert all(r.worst <= r.limit for r in simulation.residuals().values())
    last = frames[-1].linkage
    assert max(map(abs, last.velocity)) < 1e-9
    forces = [last.memory[f"{name}_force_n"] for name in ("blow", "nose", "wall")]
    assert forces == pytest.approx([199.0, 138.0, -337.0], rel=1e-9)


def test_a_series_of_impacts_by_turns_settles_with_its_energy_accounted_for():
    lighter = {"blow": {"restitution": 0.6}, "nose": {"restitution": 0.3}}
    frames, _ = run(BIT, 0.05, contacts=lighter, loads={"operator": {"force_n": [150, 0]}, "air": {"force_n": [90, 0]}})
    last = frames[-1].linkage
    assert max(map(abs, last.velocity)) < 1e-12
    assert abs(last.residuals["energy_balance"]) < 1e-12
    forces = [last.memory[f"{name}_force_n"] for name in ("blow", "nose", "wall")]
    assert forces == pytest.approx([90.0, 150.0, -240.0], rel=1e-9)  # statics: both press the bit on its wall


def test_a_coupling_that_takes_the_last_freedom_is_told():
    rack = {"rack": {"kind": "rack", "joints": ["bearing", "guide"], "radius_m": 0.02}}
    assert "joints and couplings hold every body" in refused(SLIDER_CRANK, couplings=rack)


def test_a_joint_that_others_lead_is_not_reset():
    told = refused(SLIDER_CRANK, resets={"again": {"joint": "guide", "by": "bearing", "at_deg": 10}})
    assert "resets.again.joint: 'guide' follows other joints or a drive; expected one of none" in told
    told = refused(SLIDER_CRANK, resets={"again": {"joint": "guide", "by": "guide", "at_deg": 10}})
    assert "resets.again.by: no revolute 'guide'; expected one of bearing, pin, wrist" in told


def test_a_name_that_an_element_gives_to_a_number_of_its_own_is_taken():
    free = {"fall": {"kind": "free", "direction_deg": None, "start_m": None}}
    told = refused(BALL, joints={**free, "fall_x": {"kind": "slider", "between": ["ground", "ball"]}})
    assert "joints.fall_x: a number of joints.fall has this name" in told
    told = refused(
        BALL, outputs={"fa": {"point": "ball"}}, springs={"fa_y": {"joint": "fall", "rate_n_per_m": 1, "free_m": 0}}
    )
    assert "springs.fa_y: a number of outputs.fa has this name" in told


def test_what_acts_on_one_body_alone_or_on_the_ground_is_refused():
    told = refused(BALL, contacts={"bounce": {"line": "ball"}})
    assert "contacts.bounce: point and line are of ball; expected two bodies" in told
    for load in ({"body": "ground", "torque_nm": 1.0}, {"point": "ground.floor", "force_n": [1.0, 0.0]}):
        assert "loads.push: acts on the ground" in refused(BALL, loads={"push": load})


def test_a_pair_that_is_no_list_is_told_what_a_list_is():
    with pytest.raises(
        ConfigurationError, match=r"value 9.81: expected a list in brackets, \[first, second\], in m/s2"
    ):
        validated(PAGE, {"gravity_m_per_s2": 9.81, "bodies": {"a": {"mass_kg": 1}}, "joints": {}}, "page")


def test_gas_that_the_motion_presses_beyond_zero_volume_ends_the_run():
    gas = {"joint": "fall", "gas": {"area_m2": 1e-3, "volume_m3": 5e-5}}
    driven = {"down": {"kind": "constant_speed", "joint": "fall", "speed_m_per_s": -0.5}}
    with pytest.raises(
        MotionError, match=r"springs.air.gas.volume_m3: .* beyond zero volume, in the step from 0.099 s"
    ):
        run(BALL, 0.2, springs={"air": gas}, drives=driven, contacts={})


LOOSE_BALL = BALL.partition("contacts")[0]
CHAMBER = {"area_m2": 1e-5, "volume_m3": 1.2e-5, "ports": {"vent": {"joint": "fall", "open_below_m": 0.5}}}


@pytest.mark.parametrize(
    "spring", [{"gas": CHAMBER}, {"rate_n_per_m": 1.0, "free_m": 0.2}, {"table_m_n": [[0, 5], [1, 0]]}]
)
def test_ends_of_a_spring_that_pass_each_other_end_the_run_where_it_has_a_force(spring):
    with pytest.raises(MotionError, match=r"springs.air.between: .* ground.floor and ball pass each other, in the"):
        run(LOOSE_BALL, 1.0, springs={"air": {"between": ["ground.floor", "ball"], **spring}})


def test_a_spring_of_no_length_swings_through_its_own_end():
    spring = {"between": ["ground.floor", "ball"], "rate_n_per_m": 200.0, "free_m": 0.0}
    told, _ = run(LOOSE_BALL, 1.0, springs={"air": spring}, gravity_m_per_s2=[0, 0])
    for frame in told[::100]:
        assert frame.linkage.position[0] == pytest.approx(math.cos(10.0 * frame.linkage.time_s), abs=1e-9)


def test_a_body_that_a_given_speed_presses_against_a_stop_ends_the_run():
    text = """
gravity_m_per_s2: [0, 0]
bodies: {press: {mass_kg: 1}, work: {mass_kg: 1}}
joints:
  stroke: {kind: slider, between: [ground, press]}
  bed: {kind: slider, between: [ground, work], start_m: 0.2}
drives: {motor: {kind: constant_speed, joint: stroke, speed_m_per_s: 0.5}}
contacts:
  push: {point: work, line: press, normal_deg: 0, restitution: 0.0}
  wall: {joint: bed, most_m: 0.3, restitution: 0.0}
"""
    with pytest.raises(
        MotionError, match=r"contacts contradict each other, or a given speed, in the step from 0\.(599|6)"
    ):
        run(text, 1.0)

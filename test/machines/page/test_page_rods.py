# SPDX-License-Identifier: Apache-2.0
"""A contact of a page that strikes through a rod: its impulse, energy, neighbours, refusals, what it tells."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import mech_twin
from machines.page.pages import BALL, page, run
from machines.page.test_page_machines import page as shipped
from machines.test_rollout_contract import assert_same

from mech_twin.capabilities.blow_gauge import GAUGE_UNITS
from mech_twin.engine.rollout import roll_out
from mech_twin.engine.run import frames
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.page import build
from mech_twin.parameters.load import machine
from mech_twin.parts.rod_waves.parameters import WaveTool, wave_grid
from mech_twin.parts.rod_waves.struck_tool import rod_blow

NONE = np.empty((0, 2))
HERTZ = {"face": {"kind": "hertz"}, "wall": {"threshold_n": 2e4}}
LAWS = {"wall": {"exponent": 1.5, "damping_ns_per_m": 2e4}, "tip": {"length_m": 0.1}}


def rod_ball(rod):
    """Return the changes that let the ball fall on a rod."""
    return {"contacts": {"bounce": {"point": "ball", "line": "ground.floor", "normal_deg": 90, "rod": rod}}}


def on_rod(rod):
    """Return the text of the ball without its restitution, and the changes that give it a rod."""
    return BALL.replace(", restitution: 0.5", ""), rod_ball(rod)


HEAD = {"head": {"length_m": 0.28125, "diameter_m": 0.02}}  # 20 cells, 0.69 kg of the ball's 2 kg
YIELDING = {"wall": {"kind": "yielding", "threshold_n": 2e3}}


@pytest.mark.parametrize("rod", [{}, HERTZ, LAWS, {"wall": {"kind": "rigid"}}, HEAD, YIELDING, HEAD | YIELDING])
def test_the_impulse_is_that_of_the_blow_and_its_energy_is_told(rod):
    text, changes = on_rod(rod)
    told, simulation = run(text, 1.6, **changes)
    grid = page(text, **changes).contacts["bounce"].rod.grid
    hits = [e for frame in told for e in frame.linkage.events if e.kind == "impact"]
    assert len(hits) >= 2
    taken = 0.0
    for event in hits:
        v = event.pre_velocity_m_per_s
        found = rod_blow(grid, 2.0, v, 0.0, True, NONE, NONE)
        assert event.impulse_ns == pytest.approx(found.impulse_ns, rel=1e-12)
        rebound = 0.5 * 2.0 * event.post_velocity_m_per_s**2
        kept = found.transmitted_energy_j + found.tool_vibration_j + found.contact_loss_j
        kept += 0.5 * found.tool_momentum_ns**2 / grid.tool_mass_kg + found.striker_vibration_j
        if grid.wall.loading == 0.0:  # it still pushes, and is pressed elastically, when the blow ends
            kept += 0.5 * grid.wall.threshold_n**2 / grid.wall.unloading
        assert rebound + kept == pytest.approx(found.striker_energy_j, rel=1e-9)
        taken += kept
    assert told[-1].linkage.memory["impacts_work_j"] == pytest.approx(-taken, rel=1e-9)
    for residual in simulation.residuals().values():
        assert residual.worst <= residual.limit


def test_a_page_strikes_as_the_impact_mass_on_its_rod_does():
    built = machine("impact_mass", None, {"stop.model": "wave"})
    assert isinstance(built.parameters, ImpactMass)
    text = Path(shipped("impact_mass")).read_text(encoding="utf-8").replace("restitution: 0.3", "rod: {}")
    told, _ = run(text, 1.2)  # each impact makes what rounding left some three times larger: later ones are others
    found = [e for f in told for e in f.linkage.events if e.kind == "impact" and e.pre_velocity_m_per_s > 1e-2]
    run_of_machine = frames(built, 1.2)
    expected = [
        e for f in run_of_machine for e in f.linkage.events if e.kind == "impact" and e.pre_velocity_m_per_s > 1e-2
    ]
    assert len(found) == len(expected) > 15
    for a in found:
        assert -a.post_velocity_m_per_s / a.pre_velocity_m_per_s == pytest.approx(built.parameters.rebound, rel=1e-9)
    for a, b in zip(found[:10], expected[:10], strict=True):
        assert a.time_s == pytest.approx(b.time_s, abs=1e-9)
        assert a.impulse_ns == pytest.approx(b.impulse_ns, rel=1e-7)


CARRIED = """
gravity_m_per_s2: [0, 0]
ground: {points_m: {floor: [0, 0]}}
bodies: {ball: {mass_kg: 2}, rider: {mass_kg: 3}}
joints:
  fall: {kind: slider, between: [ground, ball], direction_deg: 90, start_m: 1}
  ride: {kind: slider, between: [ground, rider], direction_deg: 90, start_m: 1}
loads: {push: {point: rider, force_n: [0, -50]}}
contacts:
  carried: {point: rider, line: ball, normal_deg: 90, restitution: 0}
  bounce: {point: ball, line: ground.floor, normal_deg: 90, rod: {}}
"""


def test_the_numbers_of_a_rod_are_those_of_its_blows_and_not_of_the_bounces_after_them():
    text, changes = on_rod({})
    _, first = run(text, 0.5, **changes)
    _, settled = run(text, 3.0, **changes)
    assert len([e for e in settled.events if e.kind == "impact"]) > 20
    before, after = first.numbers(), settled.numbers()
    assert after["bounce_impacts"] > before["bounce_impacts"] == 1.0
    assert after["steady_bounce_peak_force_n"] == before["steady_bounce_peak_force_n"]
    assert after["steady_bounce_incident_energy_j"] > 0.25 * before["steady_bounce_incident_energy_j"]


def test_a_body_at_rest_on_its_rod_passes_a_blow_on_as_rigid_and_that_is_said():
    text, changes = on_rod({})
    changes["bodies"] = {"ram": {"mass_kg": 3.0}}
    changes["joints"] = {
        "fall": {"start_m": 0.0},
        "drop": {"kind": "slider", "between": ["ground", "ram"], "direction_deg": 90, "start_m": 0.5},
    }
    hit = {"point": "ram", "line": "ball", "normal_deg": 90, "restitution": 0.5}
    changes["contacts"] = changes["contacts"] | {"hit": hit}
    built = build(page(text, **changes))
    _, simulation = run(text, 0.4, **changes)
    passed = [event for event in simulation.events if event.contact == "bounce" and event.impulse_ns > 0.0]
    assert passed[0].impulse_ns == pytest.approx(1.5 * 3.0 * (2.0 * 10.0 * 0.5) ** 0.5, rel=1e-12)
    assert not any(built.gauge.has_reading(event) for event in passed)
    numbers = simulation.numbers()
    assert numbers["bounce_impulses_without_wave"] == len(passed) == 1.0
    assert not [name for name in numbers if name.startswith("steady_")]
    assert "passed on as rigid" in " ".join(built.remarks(numbers))


def test_a_body_that_lies_on_the_striker_takes_part():
    """The closed contact passes its share on, so the mass that strikes is that of both."""
    told, _ = run(CARRIED, 0.5)
    hit = next(e for frame in told for e in frame.linkage.events if e.contact == "bounce" and e.kind == "impact")
    grid = wave_grid(page(CARRIED).contacts["bounce"].rod, 0.0)
    found = rod_blow(grid, 5.0, hit.pre_velocity_m_per_s, 0.0, True, NONE, NONE)
    assert hit.impulse_ns == pytest.approx(found.impulse_ns, rel=1e-12)


def test_a_roll_out_is_the_engine_to_the_bit_and_the_gauge_tells():
    built = machine(shipped("rock_hammer"), None, {"contacts.blow.rod.gauge_curve": True})
    found = roll_out(built, 0.3)
    assert_same(found, list(frames(built, 0.3)))
    strains = found.gauge_numbers("impact", "peak_strain")
    hits = [event for event in found.events if event.kind == "impact"]
    assert len(strains) == len(hits) > 5
    assert built.gauge.sent == ("blow",)
    assert built.gauge.curve(hits[-1]).strain.max() == pytest.approx(strains[-1], rel=1e-9)


def test_each_blow_is_led_through_its_rod_once_however_many_numbers_are_asked():
    built = machine(shipped("rock_hammer"))
    led = []

    def numbers(event):
        led.append(event.time_s)
        return built.gauge.numbers(event)

    found = roll_out(replace(built, gauge=built.gauge._replace(numbers=numbers)), 0.3)
    told = {name: found.gauge_numbers("impact", name) for name in GAUGE_UNITS}
    assert len(led) == len(set(led)) == len(told["peak_force"]) > 5
    hit = next(event for event in found.events if event.kind == "impact")
    assert [values[0] for values in told.values()] == list(built.gauge.numbers(hit))


def test_a_softer_rock_takes_another_share_and_its_name_is_the_user_s():
    shares = []
    for stiffness in (5e6, 2e7, 2e8):
        built = machine(shipped("rock_hammer"), None, {"contacts.blow.rod.wall.stiffness_n_per_m": stiffness})
        observer = built.observer()
        for frame in frames(built, 0.3):
            observer.observe(frame)
        numbers = observer.numbers()
        shares.append(numbers["steady_blow_blow_efficiency"])
        assert numbers["steady_blow_striker_mass_kg"] == pytest.approx(0.3, rel=1e-9)
        assert numbers["last_blow_striker_mass_change"] == pytest.approx(0.0, abs=1e-12)
        assert list(built.remarks(numbers)) == []
    assert shares[0] > shares[1] > shares[2]


CRANK_HAMMER = """
gravity_m_per_s2: [0, 0]
ground: {points_m: {bearing: [0, 0]}}
bodies:
  crank: {mass_kg: 1, inertia_kg_m2: 0.02, points_m: {pin: [0.05, 0]}}
  rod: {mass_kg: 0.5, inertia_kg_m2: 0.005, centre_m: [0.1, 0], points_m: {end: [0.2, 0]}}
  ram: {mass_kg: 2}
joints:
  bearing: {kind: revolute, between: [ground.bearing, crank], start_deg: 300, start_rad_per_s: 60}
  pin: {kind: revolute, between: [crank.pin, rod], start_deg: 75}
  wrist: {kind: revolute, between: [rod.end, ram]}
  guide: {kind: slider, between: [ground.bearing, ram], start_m: 0.22}
contacts: {blow: {joint: guide, most_m: 0.235, rod: {wall: {stiffness_n_per_m: 1.0e+6}}}}
"""


def test_a_mass_that_changes_within_the_blow_is_said():
    """A crank that drives the ram straight on turns on while a soft wall gives way."""
    told, simulation = run(CRANK_HAMMER, 0.05)
    assert any(e.kind == "impact" for frame in told for e in frame.linkage.events)
    assert any("mass at the contact changes within a blow" in line for line in simulation.remarks())


def test_a_window_that_is_over_too_soon_is_said():
    text, changes = on_rod({"wall": {"stiffness_n_per_m": 1e5}, "window_s": 1e-3})
    _, simulation = run(text, 0.5, **changes)
    assert simulation.summary()["steady_bounce_blow_unended"] == 1.0
    assert any("longer than window_s (at most 0.02 s), ended there" in line for line in simulation.remarks())


def told_of_rod(rod, duration=0.6):
    """Return what a run of the ball on a rod tells, and its remarks."""
    text, changes = on_rod(rod)
    _, simulation = run(text, duration, **changes)
    return simulation.summary(), list(simulation.remarks())


def test_a_head_is_part_of_the_striker_s_mass_and_softens_its_blow():
    """A rod at the front gives way as a wave; one that weighs nearly all of the striker is left out, and said."""
    rigid, _ = told_of_rod({})
    headed, remarks = told_of_rod(HEAD)
    assert not remarks
    assert headed["steady_bounce_striker_mass_kg"] == pytest.approx(2.0, rel=1e-12)
    assert headed["steady_bounce_peak_force_n"] < 0.98 * rigid["steady_bounce_peak_force_n"]
    heavy, remarks = told_of_rod({"head": {"length_m": 0.3, "diameter_m": 0.05}})
    assert any("led without it" in line for line in remarks)
    assert heavy["steady_bounce_peak_force_n"] == pytest.approx(rigid["steady_bounce_peak_force_n"], rel=1e-12)


def test_a_yielding_wall_takes_the_rod_s_motion_at_its_force():
    told, _ = told_of_rod(YIELDING)
    assert told["steady_bounce_overtravel_m"] * 2e3 == pytest.approx(told["steady_bounce_tool_energy_j"], rel=1e-12)
    assert told["steady_bounce_wall_peak_force_n"] == pytest.approx(2e3, rel=1e-9)
    assert told["steady_bounce_overtravel_m"] > told["steady_bounce_penetration_m"] > 0.0


def test_a_striker_that_would_go_on_after_its_rod_is_stopped_and_that_is_said():
    told, remarks = told_of_rod(YIELDING | {"rod": {"length_m": 0.05}, "gauge_m": 0.02, "cells": 16})
    assert told["steady_bounce_striker_stopped_m_per_s"] > 0.1
    assert told["steady_bounce_restitution_effective"] == pytest.approx(0.0, abs=1e-12)
    assert any("is stopped at its contact" in line for line in remarks)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (rod_ball({"unseated_gap_m": 0.01}), "stands in its seat"),
        (rod_ball({"gauge_m": 1.0}), "gauge_m must be at most 0.45 m"),
        (rod_ball({"wall": {"kind": "yielding"}}), "threshold_n must be above 0"),
        (rod_ball({"wall": {"kind": "free"}}), "'loading', 'yielding' or 'rigid'"),
        ({"contacts": {"bounce": {"point": "ball", "line": "ground.floor", "normal_deg": 90, "rod": {},
                                  "restitution": 0.5}}}, "expected exactly one of restitution"),
        ({"contacts": {"bounce": {"point": "ground.floor", "line": "ball", "normal_deg": 90, "rod": {}}}},
         "'ball' moves; a rod stands on the ground"),
    ],
)  # fmt: skip
def test_a_rod_that_cannot_be_led_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        page(BALL.replace(", restitution: 0.5", ""), **changes)


def test_a_turning_stop_has_no_rod():
    text = "{bodies: {bar: {mass_kg: 1, inertia_kg_m2: 1}}, joints: {pivot: {kind: revolute, between: [ground, bar]}}}"
    with pytest.raises(ValueError, match="'pivot' turns"):
        page(text, contacts={"stop": {"joint": "pivot", "most_deg": 10, "rod": {}}})


def test_a_rounded_length_is_said():
    set_tip = "contacts.blow.rod.tip.length_m=0.0123"
    told = mech_twin("simulate", shipped("rock_hammer"), "--duration", "0.02", "--json", "--set", set_tip)
    assert json.loads(told.out)["events"]
    assert "contacts.blow.rod.tip.length_m = 0.0123 m is led as 0.0" in told.err


def test_a_page_of_a_rod_is_the_same_rod_as_a_breaker_s():
    given = page(*[BALL.replace(", restitution: 0.5", "")], **rod_ball({})).contacts["bounce"].rod
    assert isinstance(given, WaveTool)
    assert build(page(BALL)).gauge is None

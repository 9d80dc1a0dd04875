# SPDX-License-Identifier: Apache-2.0
"""The breaker's blow as a wave: momentum, energy, its rigid limit, what it tells, what is refused."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import mech_twin
from mech_twin.capabilities.plots import house_style
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.mb10_breaker.dynamics import energies, masses_at, striker
from mech_twin.machines.mb10_breaker.impacts import impact_direction, push_on_body, strike, strike_as_wave
from mech_twin.machines.mb10_breaker.metrics import (
    blow_metrics,
    blow_of,
    rated_crank_speed,
    static_metrics,
    striking_angle,
)
from mech_twin.machines.mb10_breaker.plots import pictures, rated_rod_blow
from mech_twin.machines.mb10_breaker.sizing import settled_run_metrics, with_rest_force
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.parts.rod_waves.struck_tool import NO_CURVE, NO_FORCES, rod_blow
from mech_twin.studies.run_search import search_runs

WAVE = {"tool.model": "wave"}
LOADING = WAVE | {"tool.wave.wall.kind": "loading"}
FOOT = {"tool.wave.foot.length_m": 0.0281, "tool.mass_kg": 11.72, "tool.wave.foot_gap_m": 1e-5}


def built(overrides):
    return machine("mb10_breaker", None, WAVE | overrides)


def struck(overrides, held=False, tool_speed=0.0, seated=True):
    """Return constants, state at the rated blow and the blow."""
    p = built(overrides).parameters
    b = breaker(p)._replace(held=held)
    q, u = striking_angle(b), rated_crank_speed(p)
    return b, q, u, strike_as_wave(b, q, u, 0.0, 0.0, tool_speed, True, seated)


@pytest.mark.parametrize("wall", ["yielding", "loading", "rigid", "free"])
@pytest.mark.parametrize("held", [False, True])
def test_momentum_and_energy_pass_from_crank_and_body_to_tool_and_wall(wall, held):
    b, q, u, hit = struck({"tool.wave.wall.kind": wall}, held)
    m, slope = masses_at(b, q, 0.0), striker(b, q)[1]
    du, dp = hit.u - u, hit.p
    assert m.m11 * du + m.m12 * dp == pytest.approx(-slope * hit.impulse, rel=1e-9)
    if not held:
        turned = b.tool_radius_m * hit.impulse + hit.collar_nms
        assert m.m12 * du + m.m22 * dp == pytest.approx(turned, rel=1e-9)
    before, after = (energies(b, q, *s)[0] for s in ((u, 0.0, 0.0), (hit.u, 0.0, hit.p)))
    assert before - after == pytest.approx(hit.tool_energy + hit.loss, rel=1e-9)
    assert hit.loss > 0.0
    assert hit.tool_speed >= 0.0
    assert hit.closing <= 0.0


def test_a_tool_thrown_back_strikes_the_collar_of_the_body():
    """Tool and body part with the collar's restitution, and momentum passes between them; a body that leaves is not."""
    b, q, u, _ = struck({})
    m, r = masses_at(b, q, 0.0), b.tool_radius_m
    p, back = 0.05 / r, 0.8
    push = push_on_body(b, q, 0.0, p, back)
    left = back - push.impulse_nms / r / b.tool_mass_kg
    assert r * (p + push.dp) - left == pytest.approx(b.collar_restitution * (back - r * p), rel=1e-12)
    assert m.m11 * push.du + m.m12 * push.dp == pytest.approx(0.0, abs=1e-12)
    assert m.m12 * push.du + m.m22 * push.dp == pytest.approx(push.impulse_nms, rel=1e-12)
    before, after = (energies(b, q, *s)[0] for s in ((u, 0.0, p), (u + push.du, 0.0, p + push.dp)))
    given = after - before - u * (m.m11 * push.du + m.m12 * push.dp)
    assert given == pytest.approx(push.work, rel=1e-9)
    assert push.work < 0.5 * b.tool_mass_kg * (back**2 - left**2)
    assert push_on_body(b, q, 0.0, 1.01 * back / r, back).impulse_nms == 0.0
    assert push_on_body(b._replace(held=True), q, 0.0, 0.0, back).impulse_nms == 0.0


def test_a_wall_that_throws_the_tool_back_throws_a_heavy_body_too():
    """The shipped body leaves its collar faster than any tool comes back; one of more inertia does not."""
    p = built({"tool.wave.wall.kind": "loading", "tool.wave.wall.unloading_ratio": 1.0}).parameters
    b = breaker(p)
    b = b._replace(body_inertia_kg_m2=100.0 * b.body_inertia_kg_m2)
    q, u = striking_angle(b), rated_crank_speed(p)
    hit = strike_as_wave(b, q, u, 0.0, 0.0, 0.0, True, True)
    along = impact_direction(b, q, 0.0, True, False)
    found = rod_blow(b.wave, along.effective_kg, striker(b, q)[1] * u, 0.0, True, np.empty((0, 2)), np.empty((0, 2)))
    push = push_on_body(b, q, 0.0, -along.y * found.impulse_ns, -found.tool_momentum_ns / b.tool_mass_kg)
    assert push.dp > 0.0
    assert hit.p == pytest.approx(-along.y * found.impulse_ns + push.dp, rel=1e-12)
    m, du = masses_at(b, q, 0.0), hit.u - u
    assert m.m12 * du + m.m22 * hit.p == pytest.approx(b.tool_radius_m * hit.impulse + push.impulse_nms, rel=1e-9)
    before, after = (energies(b, q, *s)[0] for s in ((u, 0.0, 0.0), (hit.u, 0.0, hit.p)))
    assert before - after == pytest.approx(hit.loss, rel=1e-9)
    assert hit.loss > 0.0


def test_a_blow_between_free_ends_keeps_all_momentum_in_the_tool():
    b, _, _, hit = struck({"tool.wave.wall.kind": "free"})
    assert b.tool_mass_kg * hit.tool_speed == pytest.approx(hit.impulse, rel=1e-12)


@pytest.mark.parametrize("restitution", [0.35, 0.8])
def test_a_stiff_tool_and_face_give_the_rigid_blow(restitution):
    """Impulse, rebound and tool speed of the rigid blow are the limit of a stiffening face on a stiff short tool."""
    missed = []
    for stiffness in (1e6, 1e7, 1e8):
        overrides = {
            "tool.wave.face.stiffness_n_per_m": stiffness,
            "tool.wave.face.restitution": restitution,
            "tool.wave.rod.length_m": 0.05,
            "tool.wave.rod.diameter_m": 0.18,
            "tool.wave.rod.young_modulus_pa": 1e13,
            "tool.wave.gauge_m": 0.0,
            "tool.wave.window_s": 0.015,
            "tool.wave.cells": 4,
        }
        b, q, u, hit = struck(overrides)
        rigid = strike(b, q, u, 0.0, 0.0, 0.0, True, restitution)
        after, of_rigid = (0.5 * b.tool_mass_kg * w**2 / b.wall_force_n for w in (hit.tool_speed, rigid.tool_speed))
        shares = (
            hit.impulse / rigid.impulse,
            hit.tool_speed / rigid.tool_speed,
            hit.closing / rigid.closing,
            (hit.tool_travel + after) / of_rigid,
        )
        missed.append([abs(share - 1.0) for share in shares])
    table = np.array(missed)
    assert (table[:-1] > table[1:]).all()
    assert (table[-1] < 0.02).all()


def test_a_run_keeps_its_balances():
    for overrides in ({}, {"tool.wave.wall.kind": "loading"}, FOOT):
        found = mech_twin.rollout(built(overrides), duration_s=2.0)
        assert found.error is None
        assert any(event.kind == "blow" and event.contact == "tool" for event in found.events)
        for name, residual in found.residuals.items():
            assert residual.worst <= residual.limit, name


def blows(overrides, duration_s=2.0):
    made = built(overrides)
    found = mech_twin.rollout(made, duration_s=duration_s)
    return breaker(made.parameters), [e for e in found.events if e.kind == "blow" and e.contact == "tool"]


HEAD = {"tool.wave.head.length_m": 0.15, "tool.wave.head.diameter_m": 0.06, "tool.wave.wall.kind": "loading"}
LAWS = {"tool.wave.wall.kind": "loading", "tool.wave.wall.exponent": 1.5, "tool.wave.wall.damping_ns_per_m": 2e4}


@pytest.mark.parametrize("overrides", [{}, {"tool.wave.wall.kind": "loading"}, FOOT, HEAD, LAWS])
def test_the_blow_of_an_event_is_the_one_that_moved_the_machine(overrides):
    b, events = blows(overrides)
    for event in events:
        found = blow_of(b, event)[0](NO_CURVE, NO_FORCES)
        assert found.impulse_ns == pytest.approx(event.impulse_ns, rel=1e-12)
        assert abs(found.energy_error) < 1e-12
        assert found.parted


def test_energies_of_a_blow_add_up():
    """What the striker had is in wall, tool, vibration, face and its rebound."""
    b, events = blows({"tool.wave.wall.kind": "loading"})
    simulate, along = blow_of(b, events[-1])
    found = simulate(NO_CURVE, NO_FORCES)
    told = blow_metrics(b, events[-1])
    left = 0.5 * along.effective_kg * told["striker_rebound_m_per_s"] ** 2
    left += told["tool_energy_j"] + told["tool_vibration_j"]
    assert told["transmitted_energy_j"] + left + found.contact_loss_j == pytest.approx(
        found.striker_energy_j, rel=1e-11
    )
    assert told["blow_efficiency"] == pytest.approx(told["transmitted_energy_j"] / found.striker_energy_j)


def test_the_life_of_the_tool_is_the_damage_of_its_blows():
    """Halving the S-N line takes 2^k of the life; a blow beyond the strength breaks the tool; no line tells none."""
    line = {"tool.wave.life.amplitude_pa": 2e8, "tool.wave.life.slope": 5.0}
    b, events = blows({"tool.wave.wall.kind": "loading"}, 0.5)
    lives = built(LAWS | line).parameters.tool.wave.life
    told = blow_metrics(b, events[-1], lives.line)
    half = blow_metrics(b, events[-1], lives.line._replace(amplitude_pa=1e8))
    assert told["life_blows"] == pytest.approx(2.0**5 * half["life_blows"], rel=1e-9)
    assert told["damage_per_blow"] * told["life_blows"] == pytest.approx(1.0)
    assert 0.0 <= told["damage_place_m"] <= 0.45
    weak = blow_metrics(b, events[-1], lives.line._replace(amplitude_pa=1e5, ultimate_pa=1e6))
    assert (weak["damage_per_blow"], weak["life_blows"]) == (1.0, 1.0)
    assert "life_blows" not in blow_metrics(b, events[-1])


def test_a_tool_off_the_wall_is_fired_blank():
    """Its first wave comes back as tension; pressed on a hard wall it comes back as compression."""
    b = breaker(built({"tool.wave.wall.kind": "rigid"}).parameters)
    logs = []
    for seated in (True, False):
        gauge = np.zeros((int(3.0e-4 / b.wave.span_s), 2))
        rod_blow(b.wave, 14.0, 1.6, 0.0, seated, gauge, np.empty((0, 1)))
        logs.append(gauge)
    pressed, blank = (log[:, 1] for log in logs)
    assert blank.min() < 0.0 <= pressed.min()
    first = np.flatnonzero(pressed)[0]
    assert blank[first:60] == pytest.approx(-pressed[first:60], rel=1e-12)


@pytest.mark.parametrize("wall", ["yielding", "loading"])
def test_metrics_of_the_last_blows_are_told(wall):
    """On a hard wall too, where passes between them miss the tool."""
    numbers = mech_twin.simulate("mb10_breaker", 1.0, {**WAVE, "tool.wave.wall.kind": wall}).summary
    for name in ("incident_energy_j", "blow_efficiency", "restitution_effective", "peak_stress_pa", "penetration_m"):
        assert math.isfinite(numbers[f"steady_{name}"]), name


def test_a_blow_that_outlasts_two_degrees_of_the_crank_is_said():
    """A window of 0.87 ms is 3.2 degrees; a stiff face with losses keeps it below 2."""
    stiff = {"tool.wave.face.stiffness_n_per_m": 1e11, "tool.wave.face.restitution": 0.35}
    for overrides, said in (({}, True), (stiff, False)):
        told = mech_twin.simulate("mb10_breaker", 0.6, WAVE | overrides)
        turn = told.summary["steady_crank_turn_in_window_rad"]
        assert (turn > math.radians(2.0)) == said
        assert any("deg within a blow" in line for line in told.remarks) == said
    assert mech_twin.simulate("mb10_breaker", 0.6).remarks == ()


@pytest.mark.slow
def test_a_tool_of_one_s_own_is_drawn_with_its_blow():
    """The peak in the picture of the force at the gauge is that of the tool as it is set."""
    with house_style():
        drawn = list(itertools.islice(pictures(built({"tool.wave.rod.young_modulus_pa": 1e11}).parameters), 3, 7))
    names = [picture.name.removeprefix("mb10_breaker_blow_") for picture in drawn]
    assert names == ["efficiency", "xt", "gauge", "energy"]
    found, gauge, _ = rated_rod_blow(built({"tool.wave.rod.young_modulus_pa": 1e11}).parameters, steps=100)
    peak = gauge[: found.steps].sum(axis=1).max() / 1000.0
    curves = [line.get_ydata()[:100].max() for line in drawn[2].figure.axes[0].get_lines()]
    assert min(abs(peak - curve) for curve in curves) < 1e-9 * peak


@pytest.mark.slow
def test_search_sizes_the_tool_under_a_limit_of_stress():
    """A lower stress takes energy from the wall; the mass that moves is that of the rods found."""
    parameters = machine_parameters("mb10_breaker", None, WAVE | {"tool.wave.wall.kind": "loading"})
    bounds, found = {"tool.wave.rod.diameter_m": (0.025, 0.1)}, []
    for limit in (2.5e8, 3e7):
        limits = {"peak_stress_pa": (-math.inf, limit), "tool_mass_kg": (-math.inf, 15.0)}
        found.append(search_runs("mb10_breaker", "-transmitted_energy_j", bounds, parameters=parameters, limits=limits))
        assert min(found[-1].margins.values()) >= 0.0
        own = found[-1].parameters
        assert (
            mech_twin.analyse("mb10_breaker", WAVE | found[-1].variables).summary["tool_mass_kg"] == own.tool.moved_kg
        )
    assert found[1].objectives["transmitted_energy_j"] <= found[0].objectives["transmitted_energy_j"]


def test_impact_direction_is_that_of_the_rigid_blow():
    b, q, u, _ = struck({})
    along, hit = impact_direction(b, q, 0.0, True, False), strike(b, q, u, 0.0, 0.0, 0.0, True, 0.4)
    assert u - along.x * hit.impulse == hit.u


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"tool.wave.rod.length_m": 0.0}, "wave.rod.length_m must be above 0"),
        ({"tool.wave.gauge_m": 0.46}, "wave.gauge_m must be at most 0.45 m"),
        ({"tool.wave.foot.length_m": 9.0}, "at most 512"),
        ({"tool.wave.head.length_m": 1.0, "tool.wave.head.diameter_m": 0.2}, "wave.head must have at most"),
        ({"tool.wave.wall.exponent": 3.0, "tool.wave.wall.unloading_ratio": 1.5}, "unloading_ratio must be at least"),
        ({"tool.wave.wall.exponent": 3.0, "tool.wave.wall.threshold_n": 5.0}, "threshold_n must be 0 with exponent 3"),
        ({"tool.wave.rod.length_m": 1e-3, "tool.wave.gauge_m": 0.0}, "wave.window_s must be at most"),
    ],
)
def test_a_tool_that_cannot_be_led_is_refused_in_one_line(overrides, message):
    with pytest.raises(ConfigurationError, match=message) as told:
        built(overrides)
    assert "\n" not in str(told.value)


@pytest.mark.slow
def test_less_pressing_force_fires_the_tool_blank():
    """Springs that do not hold the body on its collar leave the tool off the wall, which then gets less of a blow."""
    p = built({}).parameters
    weak, strong = (settled_run_metrics(with_rest_force(p, force), 4.0) for force in (200.0, 1300.0))
    assert strong["off_collar_blows"] == strong["missed_blows"] == 0.0
    assert weak["blows"] - weak["off_collar_blows"] < 0.1 * (weak["blows"] + weak["missed_blows"])
    assert weak["steady_transmitted_energy_j"] < 0.5 * strong["steady_transmitted_energy_j"]


@pytest.mark.parametrize("overrides", [{}, {"tool.wave.wall.kind": "loading"}])
def test_the_rated_blow_tells_the_energy_that_a_blow_of_a_run_tells(overrides):
    """What the striker gave: its kinetic energy before less that after, and not that of a tool that rests at last."""
    b, q, u, hit = struck(overrides)
    before, after = (energies(b, q, *s)[0] for s in ((u, 0.0, 0.0), (hit.u, 0.0, hit.p)))
    told = static_metrics(built(overrides).parameters, b)
    assert told["blow_energy_j"] == pytest.approx(before - after, rel=1e-9)
    mass = told["striker_mass_kg"]
    energy = told["striker_energy_j"]
    assert told["blow_energy_j"] == pytest.approx(
        energy - (hit.impulse - mass * told["striker_speed_m_per_s"]) ** 2 / (2.0 * mass), rel=1e-9
    )

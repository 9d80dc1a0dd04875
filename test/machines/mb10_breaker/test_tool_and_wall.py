# SPDX-License-Identifier: Apache-2.0
"""The tool in the wall: it stops where its energy is spent, is caught up and pushed, or holds the striker fast."""

import itertools
import math
from collections import Counter

import pytest

from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.dynamics import masses_at, striker
from mech_twin.machines.mb10_breaker.impacts import strike
from mech_twin.machines.mb10_breaker.metrics import striking_angle
from mech_twin.machines.mb10_breaker.state import BreakerMemory, breaker
from mech_twin.parameters.load import machine, machine_parameters

HELD = {
    "excitation.kind": "approximated",
    "body.inertia_kg_m2": 0.35,
    "body.spring_rate_n_per_m": 3108.0,
    "body.preload_deflection_m": 0.0483,
}


def run(duration_s, target=None, **overrides):
    twin = machine("mb10_breaker", overrides={key.replace("__", "."): value for key, value in overrides.items()})
    return twin, list(frames(twin, duration_s, *([target] if target else [])))


def kinds(taken):
    return Counter(event.kind for frame in taken for event in frame.linkage.events)


def memory(frame):
    return BreakerMemory(*frame.linkage.memory.values)


def keeps_its_limits(twin, taken):
    for frame in taken:
        for role, sample in ((twin.linkage, frame.linkage), (twin.forces, frame.forces), (twin.body, frame.body)):
            for name, value in sample.residuals.as_dict().items():
                assert abs(value) <= role.residual_limits[name], (frame.linkage.time_s, name)


@pytest.mark.parametrize("force", [500.0, 1000.0])
def test_free_tool_travels_its_energy_over_the_wall_s_force(force):
    """s = E_t/F, decelerated by F/m_t, as long as the striker does not reach it again."""
    twin, taken = run(0.8, tool__wall_force_n=force)
    assert "catch_up" not in kinds(taken)
    energy = None
    for before, frame in itertools.pairwise(taken):
        if energy is not None and memory(before).tool_travel_m > 0.0 == memory(frame).tool_travel_m:
            assert memory(frame).feed_per_blow_m == pytest.approx(energy / force, rel=1e-9)
        for event in frame.linkage.events:
            energy = 0.5 * event.impulse_ns**2 / 10.0 if event.kind == "blow" else energy
    keeps_its_limits(twin, taken)


def test_lifted_body_that_leaves_less_than_the_overtravel_does_not_jam_the_machine():
    twin, taken = run(1.2, body__preload_deflection_m=0.0037523)
    assert kinds(taken)["stalled"] == 0
    assert taken[-1].linkage.velocity[0] > 50.0
    keeps_its_limits(twin, taken)


def test_hard_wall_is_pushed_at_each_blow():
    twin, taken = run(1.0, tool__wall_force_n=20e3)
    told = kinds(taken)
    assert told["push_begins"] == told["blow"] >= 5
    assert told["catch_up"] > told["blow"]
    keeps_its_limits(twin, taken)
    travelled = [memory(frame).tool_travel_m for frame in taken]
    for before, after in itertools.pairwise(travelled):
        assert after >= before - 1e-6 or after == 0.0  # never backwards; the coupling's own defect aside
    for frame in taken:
        assert memory(frame).tool_force_n >= -1e-6


def test_energy_of_a_pushing_machine_is_in_the_balance_without_its_own_book():
    """Work of the drive by the rotor's own samples is not used: energy at both ends against all that was booked."""
    _, taken = run(1.0, tool__wall_force_n=20e3)
    first, last = memory(taken[0]), memory(taken[-1])
    gained = last.energy_j - first.energy_j
    lost = last.blow_loss_j + last.collar_loss_j + last.reseating_loss_j + last.wall_work_j + last.damping_loss_j
    assert gained == pytest.approx(last.drive_work_j - lost + last.coupling_defect_j + last.parameter_work_j, abs=1e-8)
    feed = sum(memory(b).tool_travel_m for b, a in itertools.pairwise(taken) if memory(a).tool_travel_m == 0.0)
    assert last.wall_work_j == pytest.approx(20e3 * (feed + last.tool_travel_m), rel=1e-2)


def test_rigid_wall_stalls_a_machine_whose_body_is_held_and_it_starts_again_when_the_wall_gives_way():
    twin, taken = run(0.8, tool__wall_force_n=1e6, **{k.replace(".", "__"): v for k, v in HELD.items()})
    assert kinds(taken)["stalled"] == 1
    assert taken[-1].linkage.velocity[0] == 0.0
    keeps_its_limits(twin, taken)
    standing = memory(taken[-1])
    q, drive = taken[-1].linkage.position[0], taken[-1].linkage.effort[0]
    slope = striker(breaker(machine_parameters("mb10_breaker")), q)[1]
    assert standing.tool_force_n == pytest.approx(drive / slope, rel=1e-9)  # statics: N dy/dq = Q
    softer = build(machine_parameters("mb10_breaker", overrides={**HELD, "tool.wall_force_n": 100.0}))
    frame = taken[-1]
    linkage, motor, body = frame.linkage, frame.motor, frame.body
    for _ in range(500):
        linkage = softer.linkage.advance(linkage, motor, body)
        motor = softer.motor.respond(linkage, 1.0)
    assert linkage.velocity[0] > 20.0


def test_rigid_wall_throws_a_free_body_back_instead_of_stopping_the_crank():
    twin, taken = run(0.8, tool__wall_force_n=1e6)
    assert kinds(taken)["stalled"] == 0
    assert max(frame.body.position[0] for frame in taken) * 0.25 > 0.003
    keeps_its_limits(twin, taken)


@pytest.mark.parametrize("wall", [500.0, 20e3])
def test_machine_that_is_stopped_and_started_again_strikes_again(wall):
    twin, taken = run(4.0, lambda step: 0.0 if 1000 <= step < 2500 else 1.0, tool__wall_force_n=wall)
    late = [e for f in taken[3200:] for e in f.linkage.events if e.kind == "blow"]
    assert len(late) >= 4
    keeps_its_limits(twin, taken)


def test_second_impact_in_a_pass_obeys_the_law_of_impact():
    """e_t relates the speeds of parting and closing also where the tool is already moving; momentum is kept."""
    b = breaker(machine_parameters("mb10_breaker"))
    q, u, p, w = striking_angle(b), 60.0, 0.1, 0.4
    m, slope = masses_at(b, q, 1e-4), striker(b, q)[1]
    hit = strike(b, q, u, 1e-4, p, w, False, 0.35)
    after = w + hit.impulse / b.tool_mass_kg
    assert slope * hit.u - b.tool_radius_m * hit.p - after == pytest.approx(
        -0.35 * (slope * u - b.tool_radius_m * p - w), abs=1e-12
    )
    assert m.m11 * (hit.u - u) + m.m12 * (hit.p - p) == pytest.approx(-slope * hit.impulse, abs=1e-10)
    before = 0.5 * (m.m11 * u * u + 2.0 * m.m12 * u * p + m.m22 * p * p + b.tool_mass_kg * w * w)
    end = 0.5 * (m.m11 * hit.u**2 + 2.0 * m.m12 * hit.u * hit.p + m.m22 * hit.p**2 + b.tool_mass_kg * after**2)
    assert before - end == pytest.approx(hit.loss, abs=1e-10)


def test_blow_that_presses_the_resting_body_on_its_collar_is_taken_by_the_collar():
    """With the tool 20 mm from the crank's axis the blow presses the body down: it stays, the collar takes the blow."""
    twin, taken = run(1.0, body__tool_radius_m=0.02)
    struck = [frame for frame in taken if any(event.kind == "blow" for event in frame.linkage.events)]
    assert len(struck) >= 5
    for frame in struck:
        assert frame.forces.quantities["collar_impulse_nms"] > 0.01
        assert frame.body.position == (0.0,) and frame.body.velocity == (0.0,)
        assert math.fsum(load.impulse_nms for load in frame.forces.loads) == pytest.approx(0.0, abs=1e-12)
    keeps_its_limits(twin, taken)

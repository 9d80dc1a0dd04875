# SPDX-License-Identifier: Apache-2.0
"""Laws of the breaker: momentum and energy across impacts, routes to one result, events at their own time."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines.mb10_breaker.coupling_error import coupling_error

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.dynamics import FLIGHT, crank_torque, energies, masses_at, striker
from mech_twin.machines.mb10_breaker.forces import pin_forces, pin_impulses
from mech_twin.machines.mb10_breaker.impacts import blow
from mech_twin.machines.mb10_breaker.metrics import striking_angle
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.load import machine, machine_parameters

PARAMETERS = machine_parameters("mb10_breaker")
B = breaker(PARAMETERS)
ON_BODY = breaker(machine_parameters("mb10_breaker", overrides={"drive_mount": "body", "gravity_m_per_s2": 9.80665}))
both_mounts = pytest.mark.parametrize("b", [B, ON_BODY], ids=["frame", "body"])

angle = st.floats(0.0, 2.0 * math.pi)
speed = st.floats(20.0, 80.0)
lift = st.floats(1e-6, 0.012)
rate = st.floats(-0.8, 0.8)


def run(duration_s, **overrides):
    twin = machine("mb10_breaker", overrides={key.replace("__", "."): value for key, value in overrides.items()})
    return twin, list(frames(twin, duration_s))


@both_mounts
@given(q=angle, phi=lift)
@settings(max_examples=40, deadline=None)
def test_masses_have_their_derivatives(b, q, phi):
    step = 1e-5
    low, here, high = masses_at(b, q - step, phi), masses_at(b, q, phi), masses_at(b, q + step, phi)
    for i in range(3):
        assert (high[i] - low[i]) / (2.0 * step) == pytest.approx(here[i + 3], abs=1e-8)


@both_mounts
@given(q=angle, u=speed, phi=lift, p=rate, torque=st.floats(-60.0, 60.0))
@settings(max_examples=60, deadline=None)
def test_reduced_masses_and_dyad_equilibrium_agree(b, q, u, phi, p, torque):
    found = pin_forces(b, q, u, phi, p, torque, FLIGHT)
    assert abs(found.drive_error) <= 1e-10 * max(abs(torque), b.crank.inertia_kg_m2 * u * u)
    assert abs(found.body_error) <= 1e-10 * max(abs(found.moment), 1.0)


@both_mounts
@given(u=speed, p=st.floats(-0.2, 0.2), before=st.floats(0.02, 0.25))
@settings(max_examples=60, deadline=None)
def test_blow_keeps_momentum_and_energy(b, u, p, before):
    q = b.striking_crank_rad - before
    hit = blow(b, q, u, 1e-4, p, False)
    m, slope = masses_at(b, q, 1e-4), striker(b, q)[1]
    du, dp = hit.u - u, hit.p - p
    scale = abs(hit.impulse)
    assert m.m11 * du + m.m12 * dp == pytest.approx(-slope * hit.impulse, abs=1e-10 * scale)
    assert m.m12 * du + m.m22 * dp == pytest.approx(b.tool_radius_m * hit.impulse, abs=1e-10 * scale)
    tool = hit.impulse / b.tool_mass_kg
    closing = slope * u - b.tool_radius_m * p
    assert slope * hit.u - b.tool_radius_m * hit.p - tool == pytest.approx(-b.tool_restitution * closing, abs=1e-10)
    lost = energies(b, q, u, 1e-4, p)[0] - energies(b, q, hit.u, 1e-4, hit.p)[0]
    assert lost == pytest.approx(hit.loss + hit.tool_energy, abs=1e-10 * energies(b, q, u, 1e-4, p)[0])


@both_mounts
def test_impulsive_pins_agree_with_the_jump_of_the_body(b):
    q = striking_angle(b)
    hit = blow(b, q, 66.5, 0.0, 0.0, True)
    found = pin_impulses(b, q, 0.0, hit.u - 66.5, hit.p, hit.impulse)
    assert found.moment == pytest.approx(b.body_inertia_kg_m2 * hit.p, rel=1e-10)
    assert found.drive == pytest.approx(0.0, abs=1e-12)


def test_held_body_is_the_limit_of_a_heavy_one():
    q = striking_angle(B)
    heavy = blow(B._replace(body_inertia_kg_m2=1e9), q, 66.5, 0.0, 0.0, True)
    held = blow(B._replace(held=True), q, 66.5, 0.0, 0.0, True)
    assert heavy.impulse == pytest.approx(held.impulse, rel=1e-7)


def test_balances_close_over_many_blows():
    _, taken = run(4.0)
    assert sum(e.kind == "blow" for f in taken for e in f.linkage.events) > 35
    for frame in taken:
        assert frame.linkage.residuals["loop_closure_m"] <= 1e-12
        assert frame.linkage.residuals["energy_balance"] <= 1e-10
        assert frame.linkage.residuals["momentum_balance"] <= 1e-10
        assert max(frame.forces.residuals.values) <= 1e-10


def test_forces_follow_from_the_joint_states_alone():
    twin, taken = run(0.6)
    for frame in taken[::7]:
        bare = frame.linkage._replace(
            regime=0, residuals=frame.linkage.residuals._replace(values=(0.0,) * 4), events=()
        )
        assert twin.forces.analyse(bare).wrenches == frame.forces.wrenches


def test_impacts_are_applied_once_wherever_they_fall_in_a_step():
    """Shifting the start by fractions of a turn moves the impacts through the step; every blow has its touchdowns."""
    for degrees in range(0, 12, 2):
        _, taken = run(0.9, linkage__initial_crank_deg=float(degrees))
        kinds = [e.kind for f in taken for e in f.linkage.events]
        assert kinds.count("settled") in (kinds.count("blow"), kinds.count("blow") - 1)
        assert all(f.body.position[0] >= -1e-9 for f in taken)


def test_events_carry_the_state_of_their_instant():
    _, taken = run(1.2)
    for event in (e for f in taken for e in f.linkage.events):
        (crank, body, *_), body_after = event.pre, event.post[1]
        if event.kind == "blow":
            assert striker(B, crank.position)[0] == pytest.approx(B.tool_radius_m * body.position, abs=1e-13)
        elif event.kind in ("touchdown", "settled"):
            assert body.position == pytest.approx(0.0, abs=1e-14)
            assert body.velocity < 0.0 <= body_after.velocity


def test_run_goes_on_from_its_samples_whoever_holds_the_roles():
    twin, taken = run(0.5)
    other = build(PARAMETERS)
    middle = taken[250]
    assert other.linkage.advance(middle.linkage, middle.motor, middle.body) == taken[251].linkage
    assert twin.body.follow(middle.body, taken[251].forces) == taken[251].body


def test_gear_loses_power_whichever_way_it_flows():
    assert crank_torque(B, 10.0, 60.0, 0.0) == pytest.approx(10.0 * B.ratio * B.efficiency)
    assert crank_torque(B, -10.0, 60.0, 0.0) == pytest.approx(-10.0 * B.ratio / B.efficiency)


def test_motor_generates_before_the_blow():
    _, taken = run(1.0)
    assert min(f.motor.effort[0] for f in taken[800:]) < 0.0 < max(f.motor.effort[0] for f in taken[800:])


@pytest.mark.slow
@pytest.mark.parametrize("step_s", [2e-3, 2.5e-4])
def test_motion_does_not_depend_on_the_coupling_step(step_s):
    """The bounds are those of the reference, which integrates at 1e-12."""
    found = coupling_error(PARAMETERS, step_s, 1.2)
    assert found.crank_angle_rad <= 1e-7
    assert found.body_angle_rad <= 1e-9
    assert found.blow_time_s <= 1e-9
    assert found.blow_impulse_relative <= 1e-8


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"linkage.crank_m": 0.09}, "fails"),
        ({"body.tool_radius_m": 0.45}, "tool_radius_m - striker_arm_m"),
        ({"body.contact": "none"}, "one_sided"),
        ({"linkage.ground_m": 0.25}, "transmission angle"),
        ({"tool.overtravel_m": 0.16}, "overtravel_m must be less"),
        ({"linkage.crank_m": 0.0001}, "overtravel_m must be less"),
        ({"linkage.initial_crank_deg": 330.0}, "inside the tool"),
        ({"body.spring_rate_n_per_m": 1e12}, "spring_rate_n_per_m"),
        ({"tool.wall_force_n": 1e9}, "wall_force_n"),
        ({"linkage.rocker_inertia_kg_m2": 0.02}, "rocker_inertia_kg_m2"),
    ],
)
def test_impossible_machine_is_refused(overrides, words):
    with pytest.raises(ConfigurationError, match=words):
        machine_parameters("mb10_breaker", overrides=overrides)


def test_live_change_of_spring_preload_and_gravity_is_booked_as_work():
    """The energy of the springs jumps with the change; what it takes is the difference of c (a + l phi)^2/2."""
    _, taken = run(0.9)
    frame = taken[-1]
    changed = {"body.spring_rate_n_per_m": 60000.0, "body.preload_deflection_m": 0.012, "gravity_m_per_s2": 9.80665}
    other = build(machine_parameters("mb10_breaker", overrides=changed))
    after = other.linkage.advance(frame.linkage, frame.motor, frame.body)
    phi = frame.linkage.position[3]
    springs = 0.5 * 60000.0 * (0.012 + 0.2 * phi) ** 2 - 0.5 * 53300.0 * (0.0139 + 0.2 * phi) ** 2
    work = after.memory["parameter_work_j"] - frame.linkage.memory["parameter_work_j"]
    weights = (
        energies(breaker(other.parameters), *frame.linkage.position[:1], 0.0, phi, 0.0)[1]
        - 0.5 * 60000.0 * (0.012 + 0.2 * phi) ** 2
    )
    assert work == pytest.approx(springs + weights, abs=1e-9)
    assert after.residuals["energy_balance"] <= 1e-12


def test_balance_of_a_step_does_not_know_how_long_the_machine_has_run():
    """A day's work in the sums leaves the same error as none: what each step leaves open is summed, not the sums."""
    twin, taken = run(1.0)
    frame = taken[-1]
    memory = frame.linkage.memory.as_dict()
    day = {**memory, "drive_work_j": 3e7, "wall_work_j": 2e7, "blow_loss_j": 8e6, "angular_impulse_nms": -1e7}
    old = frame.linkage._replace(memory=frame.linkage.memory._replace(values=tuple(day.values())))
    later = old
    for _ in range(200):
        later = twin.linkage.advance(later, frame.motor, None)
    assert later.residuals["energy_balance"] <= 1e-13
    assert later.residuals["momentum_balance"] <= 1e-13

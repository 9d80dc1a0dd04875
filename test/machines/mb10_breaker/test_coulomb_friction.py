# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction of the breaker's bearings: closed forms, the motion solved as one, balances, nothing hidden."""

import math
from itertools import pairwise

import numpy as np
import pytest
from machines.mb10_breaker.breaker_reference import BreakerReference
from machines.mb10_breaker.test_friction import turned
from machines.mb10_breaker.test_reference import drawn

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.coupling import next_frame
from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.dynamics import masses_at, spring_moment
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.messages.step_message import linkage
from mech_twin.parameters.load import machine, machine_parameters

mounts = pytest.mark.parametrize("mount", ["frame", "body"])
HANGING = 2


def set_going(overrides, steps, crank=None, body=None, supply=0.0):
    """Return machine and frames from a state (angle, rate) of crank and body."""
    twin = machine("mb10_breaker", overrides={**overrides, "supply.initial_fraction": 0.0})
    frame = next(iter(frames(twin, 0.0, lambda step: supply)))
    linkage, follower = frame.linkage, frame.body
    if crank is not None:
        position, velocity = (crank[0], *linkage.position[1:]), (crank[1], *linkage.velocity[1:])
        linkage = linkage._replace(position=position, velocity=velocity)
    if body is not None:
        follower = follower._replace(position=(body[0],), velocity=(body[1],), regime=1)
    taken = [frame._replace(linkage=linkage, body=follower)]
    for _ in range(steps):
        taken.append(next_frame(twin, taken[-1], supply))
    return twin, taken


def events(taken, kind):
    return [event for frame in taken for event in frame.linkage.events if event.kind == kind]


@mounts
@pytest.mark.parametrize("coulomb", [5.0, 17.0])
def test_crank_with_dry_friction_alone_stops_where_its_energy_is_used_up(mount, coulomb):
    """M11 u^2/2 + c (q - q0) is constant, so it stops after E/c radians, whatever the linkage's inertia does."""
    held = {"excitation.kind": "approximated", "drive_mount": mount, "friction.coulomb_nm": coulomb}
    b = breaker(machine_parameters("mb10_breaker", overrides=held))
    way = 3.0
    start = math.sqrt(2.0 * coulomb * way / masses_at(b, 0.0, 0.0).m11)
    _, taken = set_going(held, 700, crank=(0.0, start))
    (stopped,) = events(taken, "crank_stopped")
    assert stopped.pre[0].position == pytest.approx(way, rel=1e-11)
    for frame in taken:
        q, u, _ = frame.linkage.joint("crank")
        left = 0.5 * masses_at(b, q, 0.0).m11 * u * u + coulomb * q
        assert left == pytest.approx(coulomb * way, rel=1e-11)
    last = taken[-1].linkage
    assert last.velocity[0] == 0.0 == last.memory["crank_sense"] == last.memory["crank_friction_nm"]
    assert last.memory["damping_loss_j"] == pytest.approx(coulomb * way, rel=1e-11)


@mounts
def test_crank_is_let_go_where_the_motor_s_torque_exceeds_its_friction(mount):
    slow = {"supply.rate_per_s": 0.5, "supply.initial_fraction": 0.0, "friction.coulomb_nm": 8.0, "drive_mount": mount}
    taken = list(frames(machine("mb10_breaker", overrides=slow), 0.6))
    (started,) = events(taken, "crank_started")
    assert started.pre[0].effort == pytest.approx(8.0, rel=1e-9)
    assert started.pre[3].effort == pytest.approx(-8.0, rel=1e-9)
    before = [f.linkage for f in taken if f.linkage.time_s < started.time_s]
    assert len(before) > 10
    for sample in before:
        assert sample.velocity[0] == 0.0
        assert sample.effort[0] + sample.memory["crank_friction_nm"] == pytest.approx(0.0, abs=1e-12)
    speeds = [f.linkage.velocity[0] for f in taken if f.linkage.time_s > started.time_s][:20]
    assert all(0.0 < earlier < later for earlier, later in pairwise(speeds))


@mounts
@pytest.mark.parametrize("angle", [20.0, 60.0, 110.0, 200.0, 250.0])
def test_weight_turns_the_crank_only_beyond_its_friction(mount, angle):
    heavy = {
        "linkage.crank_mass_kg": 40.0,
        "linkage.crank_centroid_along_m": 0.03,
        "gravity_m_per_s2": 9.80665,
        "linkage.initial_crank_deg": angle,
        "drive_mount": mount,
    }
    parameters = machine_parameters("mb10_breaker", overrides=heavy)
    weight = -BreakerReference(parameters).mass_and_bias(math.radians(angle), 0.0, 0.0, 0.0)[1][0]
    for share, moves in ((1.0 - 1e-9, True), (1.0 + 1e-9, False)):
        _, taken = set_going({**heavy, "friction.coulomb_nm": share * abs(weight)}, 3)
        speed = taken[-1].linkage.velocity[0]
        assert (speed * weight > 0.0) if moves else speed == 0.0
    held = taken[-1]
    assert held.linkage.memory["crank_friction_nm"] == pytest.approx(-weight, rel=1e-12)
    assert held.forces.residuals["drive_torque_routes"] <= 1e-12


@mounts
@pytest.mark.parametrize("coulomb", [60.0, 130.0, 160.0])
def test_thrown_body_turns_back_or_hangs_by_the_friction_of_its_pivot(mount, coulomb):
    """With the crank held: M22 phi'' = -kappa (phi + phi0) - c sign(phi'), arcs of cosines about displaced centres."""
    stiff = {
        "friction.coulomb_nm": 1000.0,
        "body.friction.coulomb_nm": coulomb,
        "drive_mount": mount,
        "coupling.step_s": 0.0001,
    }
    b = breaker(machine_parameters("mb10_breaker", overrides=stiff))
    kappa, rate, angle = b.spring_rate_n_per_m * b.spring_arm_m**2, 0.3, 0.001
    k = math.sqrt(kappa / masses_at(b, 0.0, 0.0).m22)
    centre = -b.preload_m / b.spring_arm_m - coulomb / kappa
    reach = math.hypot(angle - centre, rate / k)
    top_s, top = math.atan2(rate / k, angle - centre) / k, centre + reach
    _, taken = set_going(stiff, 500, crank=(0.0, 0.0), body=(angle, rate))
    hangs = spring_moment(b, top) <= coulomb
    (turned_at,) = [e for e in events(taken, "body_stopped" if hangs else "body_reversed") if e.time_s < 1.5 * top_s]
    assert turned_at.time_s == pytest.approx(top_s, rel=1e-5)
    assert turned_at.pre[1].position == pytest.approx(top, rel=1e-6)
    touches_s = min((event.time_s for event in events(taken, "touchdown")), default=math.inf)
    assert all(f.linkage.velocity[0] == 0.0 for f in taken if f.linkage.time_s < touches_s)
    rising = [f for f in taken if f.linkage.time_s < top_s]
    for frame in rising:
        t = frame.linkage.time_s
        expected = centre + (angle - centre) * math.cos(k * t) + rate / k * math.sin(k * t)
        assert frame.body.position[0] == pytest.approx(expected, abs=1e-8)
    last = taken[-1]
    if hangs:
        assert last.body.regime == HANGING
        assert last.body.velocity[0] == 0.0
        pressed = spring_moment(b, last.body.position[0])
        assert last.linkage.memory["body_friction_nm"] == pytest.approx(pressed, rel=1e-9)
    else:
        lower = -b.preload_m / b.spring_arm_m + coulomb / kappa  # than this the body comes down about
        fall_s = math.acos(-lower / (top - lower)) / k
        assert events(taken, "touchdown")[0].time_s == pytest.approx(top_s + fall_s, rel=1e-5)


def compared(run, reference):
    blows = np.array([(e.time_s, e.impulse_ns) for f in run for e in f.linkage.events if e.kind == "blow"])
    assert len(blows) == len(reference.blows)
    if len(blows):
        assert np.abs(blows[:, 0] - reference.blows[:, 0]).max() <= 5e-6
        assert np.abs(blows[:, 1] / reference.blows[:, 1] - 1.0).max() <= 2e-5
    assert np.abs(np.array([turned(f.linkage) for f in run]) - reference.samples[:, 0]).max() <= 1e-4
    assert np.abs(np.array([f.linkage.position[3] for f in run]) - reference.samples[:, 2]).max() <= 1e-5
    return len(blows)


def rubbing(seed):
    rng = np.random.default_rng(1000 + seed)
    return {
        **drawn(seed),
        "friction.coulomb_nm": float(rng.uniform(0.1, 12.0)),
        "body.friction.coulomb_nm": float(10.0 ** rng.uniform(0.0, 2.2)),
    }


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_rubbing_machine_is_the_motion_solved_as_one(seed):
    parameters = machine_parameters("mb10_breaker", overrides=rubbing(seed))
    run = list(frames(build(parameters), 0.9))
    reference = BreakerReference(parameters).run(np.array([frame.linkage.time_s for frame in run]))
    assert compared(run, reference) >= 1
    assert events(run, "crank_started")
    assert events(run, "body_reversed") or events(run, "body_stopped")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_rubbing_machine_without_supply_comes_to_rest_as_the_motion_solved_as_one(seed):
    overrides = {**rubbing(seed), "friction.coulomb_nm": 30.0 + 5.0 * seed, "gravity_m_per_s2": 9.80665}
    parameters = machine_parameters("mb10_breaker", overrides=overrides)
    _, run = set_going(overrides, 3200, crank=(0.5, 40.0))
    reference = BreakerReference(parameters)
    reference.motor_torque = lambda rotor: 0.0
    found = reference.run(np.array([f.linkage.time_s for f in run]), np.array([0.5, 40.0, 0.0, 0.0]))
    compared(run, found)
    assert run[-1].linkage.velocity[0] == 0.0 == found.samples[-1, 1]
    assert run[-1].body.velocity[0] == 0.0


WALLS = [
    {"tool.wall_force_n": 20000.0},
    {"tool.wall_force_n": 1e6},
    pytest.param(
        {"tool.wall_force_n": 1e6, "body.preload_deflection_m": 0.002, "body.friction.coulomb_nm": 200.0},
        marks=pytest.mark.slow,
    ),
    {"tool.wall_force_n": 1e6, "excitation.kind": "approximated", "body.friction.coulomb_nm": 0.0},
    {"tool.wall_force_n": 20000.0, "drive_mount": "body", "gravity_m_per_s2": 9.80665, "tool.restitution": 0.0},
    {"body.inertia_kg_m2": 0.5, "friction.coulomb_nm": 0.0},
    {"body.friction.coulomb_nm": 0.0, "gear.efficiency": 0.5},
]


@pytest.mark.parametrize("overrides", WALLS)
def test_balances_hold_with_the_work_of_friction_in_them_until_all_is_at_rest(overrides):
    rubs = {"friction.coulomb_nm": 6.0, "body.friction.coulomb_nm": 25.0, **overrides}
    twin = machine("mb10_breaker", overrides=rubs)
    limits = {**twin.linkage.residual_limits, **twin.forces.residual_limits}
    taken = list(frames(twin, 4.0, lambda step: 1.0 if step < 1200 else 0.0))
    for frame in taken:
        for sample in (frame.linkage, frame.forces):
            for name, value in zip(sample.residuals.names, sample.residuals.values, strict=True):
                assert abs(value) <= limits[name], name
    last = taken[-1].linkage
    assert last.memory["damping_loss_j"] > 0.0
    if rubs["friction.coulomb_nm"] > 0.0:
        assert last.velocity[0] == 0.0 == last.velocity[3]


def test_stalled_crank_with_friction_stands_until_its_torque_suffices_and_starts_again():
    stalls = {"tool.wall_force_n": 1e6, "excitation.kind": "approximated", "friction.coulomb_nm": 6.0}
    twin = machine("mb10_breaker", overrides=stalls)
    taken = list(frames(twin, 1.0))
    assert events(taken, "stalled")
    assert events(taken, "crank_stopped")
    last = taken[-1].linkage
    # the bearing takes what it can, the tool the rest
    assert last.memory["crank_friction_nm"] == pytest.approx(-6.0, rel=1e-12)
    assert last.effort[0] - 6.0 > 0.0
    soft = machine("mb10_breaker", overrides={**stalls, "tool.wall_force_n": 500.0})
    frame = taken[-1]
    for _ in range(300):
        frame = next_frame(soft, frame, 1.0)
        taken.append(frame)
    assert frame.linkage.velocity[0] > 1.0


def test_run_goes_on_from_its_samples_alone_and_through_messages():
    """A step in which a joint is held, one in which it is let go: nothing is kept beside the samples."""
    rubs = {"friction.coulomb_nm": 10.0, "body.friction.coulomb_nm": 120.0}
    taken = list(frames(machine("mb10_breaker", overrides=rubs), 1.5))
    assert events(taken, "body_stopped")
    assert events(taken, "body_started")
    fresh = machine("mb10_breaker", overrides=rubs)
    for before, after in pairwise(taken):
        if before.linkage.events or after.linkage.events:
            passed = linkage.from_message(linkage.to_message(before.linkage))
            assert passed == before.linkage
            assert next_frame(fresh, before._replace(linkage=passed), 1.0) == after


AT_THE_EDGE = [
    # the motor's torque passes the bearing's within rounding as the step's torque line does
    {
        "body.inertia_kg_m2": 45.27336729001822,
        "body.spring_rate_n_per_m": 280.6672328032179,
        "body.preload_deflection_m": 0.011992856046144857,
        "body.restitution": 0.04591000215647843,
        "tool.wall_force_n": 0.0,
        "tool.restitution": 1.0,
        "friction.coulomb_nm": 23.382087619240345,
        "body.friction.coulomb_nm": 194.0134888582077,
        "coupling.step_s": 0.002,
        "tool.mass_kg": 2.6797843571358935,
        "linkage.crank_inertia_kg_m2": 0.01600018164843193,
    },
    # striker and tool part from a common speed, without a wall
    {
        "body.inertia_kg_m2": 0.0031824410540347435,
        "body.spring_rate_n_per_m": 2654.223068860511,
        "body.preload_deflection_m": 0.24753674581378962,
        "body.restitution": 0.031264764210175815,
        "tool.wall_force_n": 0.0,
        "tool.restitution": 0.0,
        "body.friction.coulomb_nm": 1.3841164580820511e-05,
        "coupling.step_s": 0.0001,
        "tool.mass_kg": 6.787455634203529,
        "linkage.crank_inertia_kg_m2": 0.027022550488835312,
    },
]


@pytest.mark.parametrize("overrides", AT_THE_EDGE)
def test_event_at_the_edge_of_rounding_happens_once(overrides):
    step_s = overrides["coupling.step_s"]
    supply = lambda step: 1.0 if step * step_s < 0.48 else 0.0  # noqa: E731
    taken = frames(machine("mb10_breaker", overrides=overrides), 0.6, supply)
    assert sum(1 for _ in taken) == round(0.6 / step_s) + 1


def test_default_machine_has_no_friction_and_no_event_of_it():
    taken = list(frames(machine("mb10_breaker"), 0.8))
    assert not [e for f in taken for e in f.linkage.events if e.contact in ("crank_bearing", "body_pivot")]
    assert {f.linkage.memory["crank_friction_nm"] for f in taken} == {0.0}


def test_dry_friction_of_the_pivot_is_refused_under_the_half_sine_in_one_line():
    with pytest.raises(ConfigurationError, match=r"body.friction.coulomb_nm must be 0") as refused:
        machine("mb10_breaker", overrides={"excitation.kind": "approximated", "body.friction.coulomb_nm": 1.0})
    assert "\n" not in str(refused.value)


def test_energy_balance_holds_where_a_stiff_wall_stops_the_crank_within_half_a_millisecond():
    wall = {"tool.wall_force_n": 1e6, "excitation.kind": "approximated", "friction.coulomb_nm": 5.0}
    taken = list(frames(machine("mb10_breaker", overrides=wall), 0.5))
    (stalled,), (push,) = events(taken, "stalled"), events(taken, "push_begins")
    assert push.pre[0].velocity > 20.0
    assert 2e-4 < stalled.time_s - push.time_s < 5e-4
    assert max(frame.linkage.residuals["energy_balance"] for frame in taken) <= 1e-10

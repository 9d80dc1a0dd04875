# SPDX-License-Identifier: Apache-2.0
"""Motions that random legal breakers came upon: each keeps every residual, or is refused with the bound it passes."""

from __future__ import annotations

import itertools

import pytest
from draws.outcomes import worst_margin
from machines.mb10_breaker.breaker_reference import BreakerReference

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.rollout import roll_out
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import broken_lines
from mech_twin.machines.mb10_breaker.dynamics import energies, striker
from mech_twin.parameters.load import machine

# the pivot's friction holds the lifted body while the striker pushes the tool up to the rocker's extreme
HELD_BODY = {
    "body.friction.coulomb_nm": 49.43817132449243,
    "coupling.step_s": 0.0010951514531432852,
    "linkage.coupler_mass_kg": 13.263039959912021,
    "linkage.crank_inertia_kg_m2": 0.9950848555143744,
    "linkage.crank_mass_kg": 1269.3530190453766,
    "linkage.initial_crank_deg": 100000.0,
    "linkage.rocker_mass_kg": 4.9999999999979,
    "motor.rated_speed_rpm": 1496.159488338103,
    "motor.torque_curve": "starting_corrected",
    "tool.overtravel_m": 0.0023262375023235158,
}
# a heavy tool throws a crank without flywheel back, so that the gear turns its loss round
THROWN_BACK = {
    "excitation.kind": "approximated",
    "coupling.step_s": 0.0012566027999516168,
    "linkage.coupler_centroid_along_m": -0.003422936341003108,
    "linkage.coupler_inertia_kg_m2": 0.0013375547413553505,
    "linkage.crank_centroid_along_m": -1.9245008445683795e-07,
    "linkage.crank_inertia_kg_m2": 1e-12,
    "linkage.rocker_m": 0.36834291668543545,
    "linkage.rocker_mass_kg": 4.4675019101897036,
    "motor.starting_torque_ratio": 1.618414428142375e-08,
    "tool.mass_kg": 1052.9754180454938,
}
# the weight of the links would turn the crank against a supply that sets in, but not against its gear
HELD_BY_GEAR = {
    "motor.breakdown_torque_ratio": 5.65073504962551,
    "motor.rotor_inertia_kg_m2": 1e-12,
    "gear.efficiency": 0.05,
    "linkage.crank_m": 0.014382909192002535,
    "linkage.coupler_mass_kg": 0.9460243984553739,
    "linkage.coupler_centroid_across_m": -2.0,
    "linkage.rocker_centroid_along_m": 0.05657978228304977,
    "tool.mass_kg": 1e-9,
    "tool.wall_force_n": 3.9e-4,
    "gravity_m_per_s2": 100.0,
    "body.preload_deflection_m": 0.9779436599518719,
    "supply.initial_fraction": 0.4,
    "supply.rate_per_s": 20.0,
    "coupling.step_s": 0.0005,
}
# a body of 870 t m^2 on a spring of 1 N/m: where the spring would balance the linkage's moment is 1e9 rad away
HEAVY_BODY = {
    "body.inertia_kg_m2": 869332.1055433701,
    "body.spring_arm_m": 0.001,
    "body.spring_rate_n_per_m": 1.0,
    "body.damping_ratio": 0.15401848548765446,
    "linkage.initial_crank_deg": 318.0,
}
# the weight of the crank swings it to and fro through the blow; the body is pressed on its collar
PENDULUM = {
    "gravity_m_per_s2": 50.0,
    "linkage.crank_centroid_across_m": -0.1,
    "linkage.initial_crank_deg": 100.0,
    "motor.rated_power_w": 1e-3,
    "motor.rotor_inertia_kg_m2": 1e-6,
    "tool.overtravel_m": 1e-4,
    "body.preload_deflection_m": 10.0,
}
# crank and frame are nearly as long as coupler and rocker: what the crank turns doubles within a few degrees
NEAR_CHANGE_POINT = {
    "motor.rated_power_w": 1164.0,
    "motor.rated_speed_rpm": 1328.0,
    "motor.synchronous_speed_rpm": 1403.0,
    "motor.rotor_inertia_kg_m2": 0.00155,
    "gear.efficiency": 0.323,
    "gravity_m_per_s2": 1.21374,
    "linkage.crank_m": 0.012301304382836194,
    "linkage.coupler_m": 0.08200869588557463,
    "linkage.rocker_m": 0.03280347835422985,
    "linkage.ground_m": 0.1024216729665568,
    "linkage.striker_arm_m": 0.0169775,
    "linkage.striker_angle_deg": 86.0,
    "linkage.crank_inertia_kg_m2": 0.39,
    "linkage.crank_mass_kg": 3172180.0,
    "linkage.crank_centroid_across_m": 0.0003,
    "linkage.coupler_mass_kg": 4.5,
    "linkage.coupler_centroid_along_m": -1.02,
    "linkage.rocker_mass_kg": 17.0,
    "linkage.rocker_inertia_kg_m2": 0.0474,
    "linkage.rocker_centroid_along_m": 0.0037,
    "linkage.rocker_centroid_across_m": 0.0285,
    "linkage.initial_crank_deg": 65.0,
    "tool.overtravel_m": 9e-4,
    "tool.wall_force_n": 123.0,
    "body.inertia_kg_m2": 1e6,
    "body.tool_radius_m": 0.1025,
    "coupling.step_s": 0.00185,
}
# a crank without flywheel under a rocker of 12 kg m^2: what it turns varies much within a step
HEAVY_ROCKER = {
    "linkage.crank_inertia_kg_m2": 1e-12,
    "linkage.rocker_inertia_kg_m2": 12.0,
    "body.damping_ratio": 0.00616,
    "gravity_m_per_s2": 0.0,
    "coupling.step_s": 0.00125660279995,
}
# a gear of small efficiency under weights that would turn crank and body alike: on its frame its shaft stands
STANDING_GEAR = {
    "gear.efficiency": 0.14649546913712388,
    "gear.ratio": 1.1635528346655792,
    "gravity_m_per_s2": 100.0,
    "linkage.crank_m": 0.048,
    "linkage.coupler_m": 0.18,
    "linkage.crank_mass_kg": 0.075,
    "linkage.crank_inertia_kg_m2": 0.26,
    "linkage.crank_centroid_along_m": 0.208,
    "linkage.crank_centroid_across_m": -0.105,
    "linkage.coupler_centroid_across_m": 0.059,
    "linkage.rocker_mass_kg": 4.2,
    "linkage.striker_arm_m": 0.0095,
    "body.inertia_kg_m2": 212.0,
    "body.spring_arm_m": 0.001,
    "body.spring_rate_n_per_m": 1.0,
    "body.tool_radius_m": 0.001,
    "tool.overtravel_m": 1e-6,
    "supply.rate_per_s": 0.004,
}
# the motor swings from driving to braking within a step, and its gear has much to lose
BRAKING_MOTOR = {
    "motor.rated_speed_rpm": 1139.4,
    "motor.breakdown_torque_ratio": 3.332,
    "motor.starting_torque_ratio": 20.0,
    "motor.breakdown_slip": 0.9999999999999999,
    "gear.ratio": 11.342,
    "gear.efficiency": 0.3529,
    "linkage.rocker_m": 0.0911,
    "linkage.ground_m": 0.2498,
    "linkage.striker_arm_m": 0.49,
    "linkage.crank_inertia_kg_m2": 1e-12,
    "linkage.coupler_mass_kg": 1e-9,
    "linkage.coupler_inertia_kg_m2": 0.0,
    "linkage.rocker_mass_kg": 0.0758,
    "linkage.rocker_inertia_kg_m2": 2.717e-4,
    "linkage.rocker_centroid_along_m": 0.0,
    "linkage.initial_crank_deg": 97.1,
    "tool.overtravel_m": 1e-6,
    "body.inertia_kg_m2": 2555.0,
    "body.preload_deflection_m": 0.1,
    "supply.initial_fraction": 0.0476,
    "supply.rate_per_s": 1e6,
}
# springs of 10^10 N m press a body of 10^5 kg m^2 on its collar while nothing moves
PRESSED_HARD = {
    "body.inertia_kg_m2": 101292.0,
    "body.spring_arm_m": 1.346,
    "body.spring_rate_n_per_m": 46559714.8,
    "body.preload_deflection_m": 329.4,
    "supply.initial_fraction": 0.0,
}
# the wall stops a crank without flywheel within 80 microseconds
STOPPED_BY_WALL = {
    "motor.rated_power_w": 17.2,
    "motor.rotor_inertia_kg_m2": 1.8e-6,
    "gear.efficiency": 1.0,
    "linkage.crank_m": 0.01874,
    "linkage.coupler_m": 0.12494,
    "linkage.rocker_m": 0.0679,
    "linkage.ground_m": 0.12494,
    "linkage.striker_arm_m": 0.2811,
    "linkage.crank_mass_kg": 0.939,
    "linkage.crank_inertia_kg_m2": 1.787e-4,
    "linkage.coupler_mass_kg": 0.02236,
    "linkage.coupler_inertia_kg_m2": 3.62e-5,
    "linkage.coupler_centroid_along_m": -0.11,
    "linkage.rocker_mass_kg": 0.1043,
    "linkage.rocker_inertia_kg_m2": 6.78e-4,
    "linkage.rocker_centroid_along_m": 0.01722,
    "linkage.initial_crank_deg": 44.17,
    "tool.mass_kg": 1.1235,
    "tool.restitution": 0.0,
    "tool.overtravel_m": 0.001335,
    "tool.wall_force_n": 9722.0,
    "body.inertia_kg_m2": 0.24867,
    "body.spring_arm_m": 0.12494,
    "body.spring_rate_n_per_m": 1658.0,
    "body.preload_deflection_m": 0.00868,
    "body.restitution": 0.0,
    "body.tool_radius_m": 0.15617,
    "body.friction.viscous_nms_per_rad": 0.652,
}
# a motor on a body that swings on its springs: a heavy flywheel turns back against it
SWINGING_MOUNT = {
    "drive_mount": "body",
    "linkage.crank_inertia_kg_m2": 108.0,
    "tool.wall_force_n": 2.4e-5,
    "body.spring_arm_m": 0.766,
    "body.preload_deflection_m": 0.0,
    "coupling.step_s": 0.0007,
    "motor.rotor_inertia_kg_m2": 0.138,
    "motor.rated_power_w": 11000.0,
    "motor.rated_speed_rpm": 975.0,
    "motor.synchronous_speed_rpm": 1000.0,
}
# a flywheel that outweighs its body 10^7 times
HEAVY_FLYWHEEL = {
    "linkage.crank_m": 0.00204,
    "linkage.rocker_m": 0.368,
    "linkage.crank_mass_kg": 1e7,
    "linkage.crank_inertia_kg_m2": 1e8,
    "linkage.initial_crank_deg": 80.0,
    "tool.overtravel_m": 1e-6,
    "body.spring_arm_m": 0.001,
    "body.preload_deflection_m": 0.0,
}
# a tool of 10 000 t that the striker pushes: what moves crank and body is a small part of what it weighs
HEAVY_TOOL = {
    "tool.mass_kg": 1e7,
    "tool.wall_force_n": 45.0,
    "tool.restitution": 0.0,
    "linkage.crank_inertia_kg_m2": 0.05,
    "body.spring_rate_n_per_m": 6652.0,
    "body.preload_deflection_m": 704.0,
    "body.restitution": 0.0,
    "body.tool_radius_m": 0.179,
    "supply.rate_per_s": 1000.0,
}
# a wall that no crank moves: striker and body meet tool and collar by turns, each round a tenth as fast as the last
ROUND_BY_ROUND = {
    "motor.starting_torque_ratio": 4.086364192130909,
    "gear.efficiency": 0.7723470774029109,
    "linkage.crank_m": 0.014382909192029452,
    "linkage.crank_inertia_kg_m2": 1e-12,
    "linkage.coupler_centroid_along_m": -1.9999999950641854,
    "linkage.coupler_centroid_across_m": 0.02923662658733815,
    "tool.restitution": 0.0,
    "tool.wall_force_n": 5140597.66103842,
    "drive_mount": "body",
    "body.preload_deflection_m": 0.0012745854551830472,
    "body.tool_radius_m": 0.001553346286170968,
    "supply.rate_per_s": 1e-6,
    "coupling.step_s": 0.0005,
}
# the crank's weight turns it backward onto a tool that its wall holds; the body is held
STRIKES_BACKWARD = {
    "excitation.kind": "approximated",
    "body.inertia_kg_m2": 0.35,
    "body.spring_rate_n_per_m": 3108.0,
    "body.preload_deflection_m": 0.0483,
    "gravity_m_per_s2": 50.0,
    "linkage.initial_crank_deg": 20.0,
    "motor.rated_power_w": 1e-3,
    "motor.rotor_inertia_kg_m2": 1e-6,
    "tool.wall_force_n": 1e6,
}
STIFF_SPRING = {"body.spring_arm_m": 10.0, "body.spring_rate_n_per_m": 2e6, "body.inertia_kg_m2": 3.9}
LIGHT_BODY = {
    "linkage.coupler_mass_kg": 3e4,
    "linkage.crank_inertia_kg_m2": 0.3,
    "body.inertia_kg_m2": 0.5,
    "coupling.step_s": 1.9e-3,
}


def residuals_of(overrides, command, duration_s=0.5):
    """Return the residuals over their limits of a run, in equal parts at each asked fraction of the supply."""
    built = machine("mb10_breaker", overrides=overrides)
    steps = round(duration_s / built.coupling_step_s)
    run = roll_out(built, duration_s, [], None, lambda step: command[step * len(command) // (steps + 1)])
    assert run.error is None
    return broken_lines(run.residuals, built.coupling_step_s), [event.kind for event in run.events]


def deepest_m(built, run):
    """Return how deep in the tool the striker is, at most, at the end of a step."""
    b = built.linkage.model.breaker
    gaps = [
        b.tool_radius_m * frame.body.position[0]
        + frame.linkage.memory["tool_travel_m"]
        - striker(b, frame.linkage.joint("crank").position)[0]
        for frame in run
    ]
    return -min(gaps)


def test_striker_that_turns_back_leaves_a_body_held_by_friction_at_once():
    broken, kinds = residuals_of(HELD_BODY, (1.0,))
    assert broken == []
    assert "released" in kinds


@pytest.mark.parametrize(
    "overrides",
    [HEAVY_BODY, HEAVY_ROCKER, STIFF_SPRING, LIGHT_BODY],
    ids=["heavy body", "heavy rocker", "stiff spring", "light body"],
)
def test_moment_on_the_body_may_bend_within_a_step(overrides):
    broken, _ = residuals_of(overrides, (1.0, 0.4, 0.0, 1.0))
    assert broken == []


def test_the_routes_to_the_moment_differ_by_the_rounding_of_a_heavy_coupler():
    """Its inertia about the crank's bearing is the largest term of either route, and cancels in the pins."""
    heavy = {"linkage.coupler_mass_kg": 35000.0, "linkage.coupler_centroid_along_m": 2.0, "gravity_m_per_s2": 2.0}
    broken, _ = residuals_of(heavy, (1.0,))
    assert broken == []


@pytest.mark.parametrize(("tool_kg", "wall_n"), [(1e-3, 50.0), (1.0, 500.0)])
def test_striker_that_turns_back_at_its_extreme_leaves_the_tool_whichever_way_the_crank_turns(tool_kg, wall_n):
    """Swinging back, the crank goes through the rocker's extreme with its speed: nothing stands in its way there."""
    built = machine("mb10_breaker", overrides=PENDULUM | {"tool.mass_kg": tool_kg, "tool.wall_force_n": wall_n})
    run = list(frames(built, 1.0))
    assert max(worst_margin(built, frame)[0] for frame in run) <= 1.0
    speeds = [frame.linkage.velocity[0] for frame in run]
    assert min(speeds) < -30.0
    assert max(speeds) > 30.0
    assert "stalled" not in [event.kind for frame in run for event in frame.linkage.events]


def test_linkage_near_its_change_point_keeps_its_balances():
    broken, _ = residuals_of(NEAR_CHANGE_POINT, (1.0,), 0.3)
    assert broken == []


def test_gear_that_turns_back_within_a_step_loses_no_energy_unseen():
    broken, _ = residuals_of(THROWN_BACK, (1.0, 0.9213070926481903, 0.0, 1.0))
    assert broken == []


def test_gear_that_stands_lets_the_crank_go_along_with_the_flying_body():
    """Its shaft stands, u = p, while the torque that this takes lies between eta tau and tau/eta."""
    built = machine("mb10_breaker", overrides=STANDING_GEAR)
    taken = list(frames(built, 0.6))
    assert max(worst_margin(built, frame)[0] for frame in taken) <= 1.0
    (stopped,) = [e for frame in taken for e in frame.linkage.events if e.kind == "gear_stopped"]
    eta, ratio = built.parameters.gear.efficiency, built.parameters.gear.ratio
    assert stopped.contact == "gear"
    assert stopped.pre[0].effort == pytest.approx(eta * ratio * taken[-1].motor.effort[0], rel=0.1)
    after = [frame for frame in taken if frame.linkage.time_s > stopped.time_s]
    assert len(after) > 50
    for frame in after:
        tau = ratio * frame.motor.effort[0]
        assert frame.linkage.velocity[0] == frame.linkage.velocity[3] > 0.0
        assert eta * tau < frame.linkage.effort[0] < tau / eta


def test_gear_that_turns_back_tells_the_body_its_torque_on_either_side():
    """The loss changes its side there, and with it the moment on the body that carries the motor."""
    built = machine("mb10_breaker", overrides=SWINGING_MOUNT)
    taken = list(frames(built, 0.06))
    assert max(worst_margin(built, frame)[0] for frame in taken) <= 1.0
    (turned,) = [e for frame in taken for e in frame.linkage.events if e.kind == "gear_reversed"]
    eta = built.parameters.gear.efficiency
    assert turned.post[0].effort / turned.pre[0].effort == pytest.approx(1.0 / eta**2, rel=1e-9)


def test_motor_torque_that_changes_its_sign_within_a_step_loses_no_energy():
    """The gear's loss makes a kink of it, on which a piece of the motion ends: what is left is rounding."""
    built = machine("mb10_breaker", overrides=BRAKING_MOTOR)
    run = frames(built, 0.5, lambda step: 1.0 if step < 125 else 0.189)
    assert max(worst_margin(built, frame)[0] for frame in run) <= 1e-3


def test_momentum_of_a_body_pressed_hard_is_balanced_over_the_impulse_of_its_springs():
    broken, _ = residuals_of(PRESSED_HARD, (1.0,), 0.1)
    assert broken == []


def test_wall_that_stops_a_light_crank_keeps_the_balances():
    broken, kinds = residuals_of(STOPPED_BY_WALL, (1.0,), 0.12)
    assert broken == []
    assert "pushing" in kinds


def test_tool_that_outweighs_crank_and_body_takes_no_momentum_unseen():
    """What the steps leave open stays that of a light one."""
    taken = list(frames(machine("mb10_breaker", overrides=HEAVY_TOOL), 0.2))
    assert max(frame.linkage.memory["tool_force_n"] for frame in taken) > 0.0
    assert max(abs(frame.linkage.memory.as_dict()["momentum_error_nms"]) for frame in taken) <= 1e-11


def test_series_of_striker_and_body_by_turns_ends_at_rest():
    """The energy of each round is a hundredth of the last; slower than 1e-6 m/s gaps are rounding, and it ends soon."""
    built = machine("mb10_breaker", overrides=ROUND_BY_ROUND)
    run = list(frames(built, 0.48))
    assert max(worst_margin(built, frame)[0] for frame in run) <= 1.0
    kinds = ("push_begins", "catch_up")
    speeds = [event.pre_velocity_m_per_s for frame in run for event in frame.linkage.events if event.kind in kinds]
    known = [speed for speed in speeds if speed > 1e-6]
    ratios = [later / speed for speed, later in itertools.pairwise(known[-3:])]
    assert ratios == pytest.approx([0.1, 0.1], rel=0.02)
    assert max(speeds[len(known) :]) < 1e-6
    assert 1 <= len(speeds) - len(known) <= 3
    crank, body = run[-1].linkage.joint("crank"), run[-1].body
    assert (crank.velocity, body.position, body.velocity) == (0.0, (0.0,), (0.0,))
    assert run[-1].linkage.events == ()


def test_striker_thrown_back_from_the_tool_it_touches_does_not_come_back_into_it_unseen():
    """A lossless gear that a touchdown throws back is turned round within the piece of motion that begins there."""
    built = machine("mb10_breaker", overrides=ROUND_BY_ROUND | {"gear.efficiency": 1.0})
    run = list(frames(built, 0.48))
    assert max(worst_margin(built, frame)[0] for frame in run) <= 1.0
    assert deepest_m(built, run) < 1e-10


def test_crank_that_strikes_backward_stands_on_the_tool_by_statics():
    """N dy/dq = Q - dV/dq, Q the drive's torque; the rocker swings back, so dy/dq < 0."""
    built = machine("mb10_breaker", overrides=STRIKES_BACKWARD | {"linkage.crank_centroid_along_m": 0.1})
    run = list(frames(built, 0.5, lambda step: 0.0))
    assert max(worst_margin(built, frame)[0] for frame in run) <= 1.0
    assert deepest_m(built, run) < 1e-10
    assert [event.kind for frame in run for event in frame.linkage.events].count("stalled") == 1
    b, last = built.linkage.model.breaker, run[-1]
    crank = last.linkage.joint("crank")
    assert crank.velocity == 0.0
    slope = striker(b, crank.position)[1]
    weight = [energies(b, crank.position + side, 0.0, 0.0, 0.0)[1] for side in (1e-5, -1e-5)]
    moment = crank.effort - (weight[0] - weight[1]) / 2e-5
    assert slope < 0.0
    assert last.linkage.memory["tool_force_n"] * slope == pytest.approx(moment, rel=1e-8)


def test_crank_that_its_weight_takes_off_the_tool_again_leaves_no_energy_behind():
    """It swings back onto the tool and comes to a stop there, then the weight takes it away: no series of touches."""
    built = machine("mb10_breaker", overrides=STRIKES_BACKWARD | {"linkage.crank_centroid_across_m": -0.10009})
    run = list(frames(built, 0.5, lambda step: 0.0))
    assert max(worst_margin(built, frame)[0] for frame in run) <= 1.0
    assert deepest_m(built, run) < 1e-10


def test_flywheel_that_outweighs_its_body_keeps_the_routes_to_its_torque():
    broken, _ = residuals_of(HEAVY_FLYWHEEL, (1.0,), 0.02)
    assert broken == []


@pytest.mark.parametrize("mount", ["body", "frame"])
def test_crank_without_bearing_friction_stands_while_its_gear_holds_the_weight(mount):
    """It stands while eta tau < W < tau/eta, and is let go where eta tau is the moment W of the weight."""
    built = machine("mb10_breaker", overrides={**HELD_BY_GEAR, "drive_mount": mount})
    eta, ratio = built.parameters.gear.efficiency, built.parameters.gear.ratio
    weight = BreakerReference(built.parameters).mass_and_bias(0.0, 0.0, 0.0, 0.0)[1][0]
    taken = list(frames(built, 0.012))
    assert max(worst_margin(built, frame)[0] for frame in taken) <= 1.0
    (started,) = [e for frame in taken for e in frame.linkage.events if e.kind == "crank_started"]
    assert started.pre[0].effort == pytest.approx(weight, rel=1e-9)
    before = [frame for frame in taken if frame.linkage.time_s < started.time_s]
    assert len(before) > 3
    for past, frame in itertools.pairwise(before):  # a rising supply reaches what the motor tells as the step ends
        tau = ratio * past.motor.effort[0]
        assert eta * tau < weight < tau / eta
        assert frame.linkage.velocity[0] == 0.0
    after = [frame.linkage.velocity[0] for frame in taken if frame.linkage.time_s > started.time_s]
    assert min(after) > 0.0


@pytest.mark.parametrize("wall_n", [1e4, 1e6])
def test_the_lightest_tool_that_a_wall_allows_keeps_the_balances(wall_n):
    broken, kinds = residuals_of({"tool.wall_force_n": wall_n, "tool.mass_kg": 1.000001e-9 * wall_n}, (1.0,))
    assert broken == []
    assert "blow" in kinds


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"motor.rotor_inertia_kg_m2": 100.0}, "rotor_inertia_kg_m2 must be at most 60.79"),
        ({"body.friction.coulomb_nm": 1e6}, "body.friction.coulomb_nm must be at most 600000 N m"),
        ({"friction.coulomb_nm": 1e6}, "friction.coulomb_nm must be at most 31848.4 N m"),
        (
            {"tool.wall_force_n": 1e7, "linkage.crank_inertia_kg_m2": 1e-3, "motor.rotor_inertia_kg_m2": 1e-4}
            | {"coupling.step_s": 2e-5},
            "tool.wall_force_n must be at most",
        ),
        ({"tool.mass_kg": 1e-7}, r"tool.wall_force_n must be at most 100 N, 1e\+09 m/s2 of the tool.s mass"),
    ],
)
def test_what_cannot_be_followed_is_refused_with_its_bound(overrides, words):
    with pytest.raises(ConfigurationError, match=words) as refused:
        machine("mb10_breaker", overrides=overrides)
    assert "\n" not in str(refused.value)

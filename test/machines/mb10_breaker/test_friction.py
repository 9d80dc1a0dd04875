# SPDX-License-Identifier: Apache-2.0
"""Friction of the breaker's bearings: against the motion solved as one, in the balances, down to rest."""

import math

import numpy as np
import pytest
from machines.mb10_breaker.breaker_reference import BreakerReference, ReferenceState
from scipy.integrate import solve_ivp

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.dynamics import FLIGHT
from mech_twin.machines.mb10_breaker.forces import pin_forces
from mech_twin.machines.mb10_breaker.state import BreakerMemory, breaker
from mech_twin.parameters.load import machine, machine_parameters

RUBBING = {"friction.viscous_nms_per_rad": 0.05, "body.friction.viscous_nms_per_rad": 30.0}
mounts = pytest.mark.parametrize("mount", ["frame", "body"])


def coasting(overrides, speed, steps):
    """Return the samples of a machine whose crank turns at a speed (rad/s), the motor without supply."""
    twin = machine("mb10_breaker", overrides={**overrides, "supply.initial_fraction": 0.0})
    frame = next(iter(frames(twin, 0.0)))
    linkage, body, taken = frame.linkage._replace(velocity=(speed, *frame.linkage.velocity[1:])), frame.body, []
    for _ in range(steps):
        motor = twin.motor.respond(linkage, 0.0)
        assert motor.effort == (0.0,)
        linkage = twin.linkage.advance(linkage, motor, body)
        forces = twin.forces.analyse(linkage)
        body = twin.body.follow(body, forces)
        taken.append((linkage, forces, body))
    return taken


def turned(linkage):
    return linkage.position[0] + 2.0 * math.pi * BreakerMemory(*linkage.memory.values).turns


@mounts
def test_coasting_crank_is_the_motion_solved_as_one(mount):
    """Without blows: up to where the striker first meets the tool."""
    overrides = {**RUBBING, "drive_mount": mount, "friction.viscous_nms_per_rad": 2.0}
    reference = BreakerReference(machine_parameters("mb10_breaker", overrides=overrides))
    reference.motor_torque = lambda rotor: 0.0
    taken = coasting(overrides, 60.0, 60)

    def rates(_, y):
        du, _, collar = reference.accelerations(ReferenceState(*y, 0.0, 0.0), True)
        assert collar > 0.0
        return [y[1], du]

    found = solve_ivp(rates, (0.0, 0.06), (0.0, 60.0), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    linkage = taken[-1][0]
    assert not [event for sample, _, _ in taken for event in sample.events]
    assert (turned(linkage), linkage.velocity[0]) == pytest.approx(tuple(found), rel=1e-10)
    assert linkage.velocity[0] < 45.0


@pytest.mark.slow
@mounts
def test_running_machine_is_the_motion_solved_as_one(mount):
    """With blows, under the motor; tolerances of the coupling at this step (`test_reference`)."""
    p = machine_parameters("mb10_breaker", overrides={**RUBBING, "drive_mount": mount, "coupling.step_s": 0.00025})
    run = list(frames(build(p), 0.8))
    reference = BreakerReference(p).run(np.array([frame.linkage.time_s for frame in run]))
    blows = np.array([(e.time_s, e.impulse_ns) for f in run for e in f.linkage.events if e.kind == "blow"])
    assert len(blows) == len(reference.blows) >= 2
    assert np.abs(blows[:, 0] - reference.blows[:, 0]).max() <= 5e-6
    assert np.abs(blows[:, 1] / reference.blows[:, 1] - 1.0).max() <= 2e-5
    assert np.abs(np.array([turned(f.linkage) for f in run]) - reference.samples[:, 0]).max() <= 1e-4
    assert np.abs(np.array([f.linkage.position[3] for f in run]) - reference.samples[:, 2]).max() <= 1e-5


@mounts
def test_machine_without_supply_comes_to_rest(mount):
    taken = coasting({**RUBBING, "drive_mount": mount, "friction.viscous_nms_per_rad": 1.0}, 60.0, 6000)
    assert any(event.kind == "blow" for linkage, _, _ in taken for event in linkage.events)
    linkage, _, body = taken[-1]
    assert abs(linkage.velocity[0]) < 1e-5
    assert body.position[0] == body.velocity[0] == 0.0
    for linkage, forces, _ in taken:
        assert linkage.residuals["energy_balance"] <= 1e-9
        assert linkage.residuals["momentum_balance"] <= 1e-9
        assert max(forces.residuals.values) <= 1e-10


@mounts
def test_friction_of_the_crank_s_bearing_acts_back_on_the_body(mount):
    p = machine_parameters("mb10_breaker", overrides={**RUBBING, "drive_mount": mount})
    b, v = breaker(p), p.friction.viscous_nms_per_rad
    smooth = b._replace(crank_viscous_nms_per_rad=0.0)
    with_friction = pin_forces(b, 1.0, 50.0, 1e-3, 0.2, 12.0, FLIGHT)
    # the same accelerations need the drive less the friction; frame: its reaction is on the frame, friction's is not
    without = pin_forces(smooth, 1.0, 50.0, 1e-3, 0.2, 12.0 - v * 50.0, FLIGHT)
    if mount == "body":
        assert with_friction.moment == pytest.approx(without.moment, rel=1e-12)
        assert with_friction.crank_acceleration == pytest.approx(without.crank_acceleration, rel=1e-12)
    assert abs(with_friction.drive_error) <= 1e-11
    assert abs(with_friction.body_error) <= 1e-11


@pytest.mark.parametrize(
    "overrides",
    [
        {"friction.viscous_nms_per_rad": 30.1},
        {"friction.viscous_nms_per_rad": -1.0},
        {"body.friction.viscous_nms_per_rad": 1e4},
    ],
)
def test_friction_that_cannot_be_followed_is_refused_in_one_line(overrides):
    with pytest.raises(ConfigurationError, match=r"viscous_nms_per_rad") as refused:
        machine("mb10_breaker", overrides=overrides)
    assert "\n" not in str(refused.value)


def test_pivot_friction_damps_the_body_of_the_half_sine():
    held = {"excitation.kind": "approximated", "body.inertia_kg_m2": 0.35, "body.contact": "none"}
    k = 0.2 * math.sqrt(53300.0 / 0.35)
    by_ratio = machine("mb10_breaker", overrides={**held, "body.damping_ratio": 0.1})
    by_pivot = machine("mb10_breaker", overrides={**held, "body.friction.viscous_nms_per_rad": 0.2 * k * 0.35})
    for one, other in zip(frames(by_ratio, 0.3), frames(by_pivot, 0.3), strict=True):
        assert one.body.position[0] == pytest.approx(other.body.position[0], abs=1e-12)

# SPDX-License-Identifier: Apache-2.0
"""Drives: the promised rates hold, also where the rated speed is changed while running, and either way round."""

from __future__ import annotations

from itertools import pairwise

import pytest
from crank_drives import PRESS_KLOSS, VIBRATION_CRANK_KLOSS

from mech_twin.engine.run import frames
from mech_twin.machines.drives import KlossMotor, kloss_motor_role, prescribed_speed_motor
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.parts.induction_motor import InductionMotorParameters, motor_constants
from mech_twin.samples import LinkageSample, Named
from mech_twin.studies import size

MOTOR = motor_constants(
    InductionMotorParameters(
        rated_power_w=2200.0,
        rated_speed_rpm=1440.0,
        synchronous_speed_rpm=1500.0,
        breakdown_torque_ratio=2.5,
        starting_torque_ratio=2.0,
        rotor_inertia_kg_m2=0.01,
    )
)


def linkage(speed: float, command: float) -> LinkageSample:
    return LinkageSample(0, 0.0, ("crank",), (0.0,), (speed,), (0.0,), 0, command, Named(), Named(), ())


def led(drive, speed, command, steps):
    speeds = [speed]
    for _ in range(steps):
        motor = drive.respond(linkage(speeds[-1], command), 1.0)
        command = motor.command
        speeds.append(motor.velocity[0])
    return speeds


@pytest.mark.parametrize(("old", "new"), [(30.0, 60.0), (60.0, 30.0), (30.0, -30.0)])
def test_a_changed_rated_speed_is_reached_at_the_rate_of_the_supply(old, new):
    speeds = led(prescribed_speed_motor(new, 2.0, 0.001), old, 1.0, 1100)
    assert speeds[-1] == new
    assert max(abs(b - a) for a, b in pairwise(speeds)) <= 2.0 * abs(new) * 0.001 * (1.0 + 1e-6)


def test_an_unchanged_rated_speed_follows_the_command_exactly():
    drive = prescribed_speed_motor(31.4, 2.0, 0.001)
    speed, command = 0.0, 0.0
    for _ in range(600):
        motor = drive.respond(linkage(speed, command), 1.0)
        assert motor.velocity[0] == motor.command * 31.4
        speed, command = motor.velocity[0], motor.command
    assert command == 1.0


def test_a_reversed_motor_is_the_mirror_of_the_motor():
    drive = KlossMotor(MOTOR, 4.8, 2.0, 0.001)
    forward, backward = kloss_motor_role(drive), kloss_motor_role(drive._replace(direction=-1.0))
    for speed, command in ((0.0, 0.5), (31.0, 1.0), (-3.0, 0.2), (40.0, 0.9)):
        one = forward.respond(linkage(speed, command), 1.0)
        two = backward.respond(linkage(-speed, -command), 1.0)
        assert two.effort == (-one.effort[0],)
        assert two.velocity == (-one.velocity[0],)
        assert two.command == -one.command


def test_swapping_the_phases_takes_the_supply_through_zero_at_its_rate():
    drive = kloss_motor_role(KlossMotor(MOTOR, 4.8, 2.0, 0.001, direction=-1.0))
    command, seen = 1.0, []
    for _ in range(1001):
        command = drive.respond(linkage(31.0, command), 1.0).command
        seen.append(command)
    assert max(abs(b - a) for a, b in pairwise(seen)) <= 0.002 * (1.0 + 1e-9)
    assert seen[-1] == -1.0


@pytest.mark.parametrize(
    ("name", "drive"), [("vibration_crank", VIBRATION_CRANK_KLOSS), ("compaction_press", PRESS_KLOSS)]
)
def test_a_motor_that_turns_the_crank_at_another_speed_than_the_figures_is_remarked_on(name, drive):
    assert list(machine(name, overrides=drive).remarks({})) == []
    other = {**drive, "gear.ratio": 0.5 * drive["gear.ratio"]}
    (remark,) = machine(name, overrides=other).remarks({})
    asked = machine_parameters(name).drive.speed_rpm
    assert remark.startswith(f"figures of a cycle and sizes are for drive.speed_rpm = {asked:g}; behind its gear")
    assert remark in size(name, machine_parameters(name, overrides=other), tolerance=0.0).binding


@pytest.mark.parametrize("name", ["compaction_press", "vibration_crank"])
@pytest.mark.parametrize("speed_rpm", [200.0, -200.0])
def test_a_position_bears_the_friction_that_a_run_has_there(name, speed_rpm):
    rubs = {"friction.coulomb_nm": 50.0, "friction.viscous_nms_per_rad": 0.5, "drive.speed_rpm": speed_rpm}
    twin, peak = machine(name, overrides=rubs), machine(name, overrides=rubs).report()["drive_torque_peak_nm"]
    shown = [key for key in twin.analyse(0.0) if key.startswith("drive_") and key.endswith(("_nm", "_w"))]
    for frame in frames(twin, 0.3):
        at, run = twin.analyse(frame.linkage.joint("crank").position), frame.forces.quantities.as_dict()
        for key in shown:
            told = run.get(key, run["drive_torque_nm"])
            assert at[key] == pytest.approx(told, abs=1e-9 * peak * abs(twin.parameters.drive.speed_rpm))

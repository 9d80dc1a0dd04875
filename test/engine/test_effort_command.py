# SPDX-License-Identifier: Apache-2.0
"""A motor asked for an effort, or to hold a position, in place of its supply: in the engine's commands."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from catalogue import built

import mech_twin as mt
from mech_twin.engine.coupling import effort_limit
from mech_twin.engine.run import frames
from mech_twin.errors import StudyError
from mech_twin.samples import EffortCommand

MASS, STEP_S = "impact_mass", 0.001


def test_a_mass_under_an_asked_force_moves_by_newton_s_law() -> None:
    machine = built(MASS)
    force, mass_kg = -0.25 * effort_limit(machine), machine.parameters.mass_kg
    run = mt.rollout(machine, 0.05, command=EffortCommand(force))
    start, speed = run["linkage.mass.position"][0], run["linkage.mass.velocity"][0]
    times = run["time_s"]
    expected = start + speed * times + 0.5 * force / mass_kg * times**2
    assert {event.kind for event in run.events} == {"phase"}
    np.testing.assert_allclose(run["linkage.mass.position"], expected, rtol=0.0, atol=1e-12)
    assert not run["motor.command"].any()


def test_a_position_is_held_by_the_spring_and_damper_asked_for() -> None:
    machine = built(MASS)
    mass_kg, goal, rate = machine.parameters.mass_kg, machine.parameters.stop_position_m - 0.02, 20.0
    held = EffortCommand(position=goal, stiffness=mass_kg * rate**2, damping=2.0 * mass_kg * rate)
    run = mt.rollout(machine, 2.0, command=held)
    assert abs(run["linkage.mass.position"][-1] - goal) < 1e-9
    assert abs(run["linkage.mass.velocity"][-1]) < 1e-8


def test_no_motor_gives_more_than_its_limit() -> None:
    machine = built(MASS)
    limit = effort_limit(machine)
    run = mt.rollout(machine, 0.02, command=EffortCommand(position=1e6, stiffness=1.0))
    assert set(run["motor.generator.effort"]) == {limit}


@pytest.mark.parametrize("name", ["mb10_breaker", "roller_former", MASS])
def test_the_run_frame_by_frame_has_the_bits_of_the_roll_out(name: str) -> None:
    machine = built(name)
    asked = EffortCommand(0.3 * effort_limit(machine), 1.0, 0.5, 0.01)

    def command(step: int) -> Any:
        return asked if 20 <= step < 60 else 0.5

    run = mt.rollout(machine, 0.1, command=command)
    found = list(frames(machine, 100 * STEP_S, command))
    assert len(found) == 101
    for joint in range(len(machine.linkage.joints)):
        column = f"linkage.{machine.linkage.joints[joint]}.position"
        assert run[column].tolist() == [frame.linkage.position[joint] for frame in found]
    assert [frame.motor.asked for frame in found] == [asked if 20 <= step < 60 else None for step in range(101)]
    first = f"linkage.{machine.linkage.joints[0]}.position"
    assert run[first].tolist() != mt.rollout(machine, 0.1, command=0.5)[first].tolist()


@pytest.mark.parametrize("name", ["winding_drum", "vibration_crank"])
def test_a_drive_at_a_given_speed_refuses_an_effort_with_its_reason(name: str) -> None:
    with pytest.raises(StudyError, match=f"{name}: takes no effort command.*given speed"):
        mt.rollout(name, 0.01, command=EffortCommand(1.0))
    with pytest.raises(StudyError, match="takes no effort command"):
        list(frames(built(name), 0.01, lambda step: EffortCommand(1.0) if step else 1.0))


def test_an_effort_that_is_not_finite_is_refused() -> None:
    with pytest.raises(StudyError, match="expected an effort within"):
        mt.rollout(MASS, 0.01, command=EffortCommand(float("nan")))

# SPDX-License-Identifier: Apache-2.0
"""A unit whose motor, wall or spring is somebody else's: their numbers are inputs of the unit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from crank_drives import PRESS_KLOSS
from fmi_slave import Slave

import mech_twin as mt
from mech_twin.fmi.export import export_fmu
from mech_twin.parameters.errors import keys
from mech_twin.parameters.load import machine as built_machine
from mech_twin.parts.induction_motor import CORRECTED


@pytest.mark.slow
def test_a_motor_of_somebody_else_that_gives_the_same_effort_gives_the_same_motion(unit: Any) -> None:
    run = mt.rollout("impact_mass", 0.5)
    efforts = {name: run[name] for name in _efforts_given_to(unit("impact_mass", 2))}
    assert _driven(unit, efforts, 500) == run["linkage.mass.position"].tolist()


@pytest.mark.slow
def test_each_effort_that_can_be_given_moves_the_machine(unit: Any) -> None:
    run = mt.rollout("impact_mass", 0.5)
    efforts = {name: run[name] for name in _efforts_given_to(unit("impact_mass", 2))}
    assert len(efforts) == 2  # the force of either phase; the force at an instant is one of these
    for name in efforts:
        assert _driven(unit, {**efforts, name: 1.5 * run[name]}, 500) != run["linkage.mass.position"].tolist()


@pytest.mark.parametrize(
    ("name", "key", "factor"),
    [
        ("impact_mass", "phase1_force_n", 0.9),
        pytest.param("mb10_breaker", "tool.wall_force_n", 1.4, marks=pytest.mark.slow),
        pytest.param("mb10_breaker", "body.spring_rate_n_per_m", 0.8, marks=pytest.mark.slow),
    ],
)
def test_a_wall_or_spring_that_somebody_else_changes_is_a_live_change_of_the_run(
    unit: Any, name: str, key: str, factor: float
) -> None:
    value = factor * next(each.value for each in keys(built_machine(name).parameters) if each.name == key)
    change, steps = 300, 600
    run = mt.rollout(name, 0.001 * steps, changes=[(0.001 * change, {key: value})])
    with Slave(unit(name, 2)) as slave:
        slave.begin()
        row = {column: [slave.get(column)] for column in run.columns if column != "time_s"}
        for step in range(steps):
            if step == change - 1:
                slave.set(f"live.{key}", value)
            slave.step(0.001 * step)
            for column, found in row.items():
                found.append(slave.get(column))
    assert [column for column, found in row.items() if found != run[column].tolist()] == []
    plain = mt.rollout(name, 0.001 * steps)
    assert any(run[column].tolist() != plain[column].tolist() for column in row)


def _kloss_nm(motor: Any, speed: float, supply: float) -> float:
    """Return the torque of an induction motor by Kloss, with the correction between breakdown and standstill."""
    slip = supply - speed / motor.synchronous_speed_rad_per_s
    size = abs(slip)

    def kloss(s: float) -> float:
        return 2.0 * motor.breakdown_torque_nm / (s / motor.breakdown_slip + motor.breakdown_slip / s)

    if size == 0.0:
        return 0.0
    torque = kloss(size)
    if motor.curve == CORRECTED and slip > motor.breakdown_slip:
        share = min(1.0, (slip - motor.breakdown_slip) / (1.0 - motor.breakdown_slip))
        torque += (motor.starting_torque_nm - kloss(1.0)) * share * share * (3.0 - 2.0 * share)
    return torque if slip > 0.0 else -torque


@pytest.mark.slow
def test_a_motor_computed_outside_drives_the_machine_as_its_own_does_to_coupling_accuracy(tmp_path: Path) -> None:
    """An induction motor in a loop of the importer's own; exchanged twice as often, half the difference."""
    apart, step_s = [], 0.0005
    machine = built_machine("compaction_press", None, {**PRESS_KLOSS, "coupling.step_s": step_s})
    run, motor, start = mt.rollout(machine, 1.0), machine.parameters.motor_curve, machine.parameters.supply
    file = export_fmu(machine, tmp_path / "press.fmu").file
    for held in (2, 1):
        supply, found, exchange_s = start.initial_fraction, [], held * step_s
        with Slave(file) as slave:
            slave.set_truth("motor_given", True)
            slave.set("speed_command", 0.0)
            slave.begin()
            for exchange in range(round(1.0 / exchange_s)):
                if exchange:
                    supply = min(1.0, supply + start.rate_per_s * exchange_s)
                torque = _kloss_nm(motor, slave.get("motor.rotor.velocity"), supply)
                slave.set("given.motor.rotor.effort", torque)
                slave.step(exchange_s * exchange, exchange_s)
                found.append(slave.get("linkage.crank.velocity"))
        own = run["linkage.crank.velocity"][::held]
        assert own[-1] > 0.9 * own.max() > 1.0
        apart.append(float(np.abs(np.array(found) - own[1:]).max() / own.max()))
    assert apart[0] < 0.02
    assert apart[1] < 0.6 * apart[0]


def _efforts_given_to(file: Path) -> list[str]:
    variables = fmpy.read_model_description(str(file)).modelVariables
    return [v.name.removeprefix("given.") for v in variables if v.name.startswith("given.")]


def _driven(unit: Any, efforts: dict[str, np.ndarray], steps: int) -> list[float]:
    with Slave(unit("impact_mass", 2)) as slave:
        slave.set_truth("motor_given", True)
        slave.begin()
        found = [slave.get("linkage.mass.position")]
        for step in range(steps):
            for name, column in efforts.items():
                slave.set(f"given.{name}", float(column[step]))
            slave.step(0.001 * step)
            found.append(slave.get("linkage.mass.position"))
        return found

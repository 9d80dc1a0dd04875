# SPDX-License-Identifier: Apache-2.0
"""A machine that the model cannot be is told so: a double-cage motor is no Kloss curve, whatever its inertia.

The motor is the one that Steinmetz computes as the example of the double squirrel cage (Theory and Calculation of
Electrical Apparatus, 1917, sec. 23): 110 V, stator 0.1 + 0.3j, cages 0.5 + 0.2j and 0.08 + 0.4j, excitation
0.01 - 0.1j (ohm, mho).  The model is given its name plate: rated point, breakdown and starting ratio.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import mech_twin as mt
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import Trajectory
from mech_twin.parameters.load import machine
from mech_twin.parts.induction_motor import motor_constants, motor_torque
from mech_twin.roles import MotorRole
from mech_twin.samples import LinkageSample, MotorSample

pytestmark = pytest.mark.slow
VOLTS, STATOR, CAGES, EXCITATION = 110.0, 0.1 + 0.3j, (0.5 + 0.2j, 0.08 + 0.4j), 0.01 - 0.1j
RATED_SLIP, RATED_NM, FIELD_RAD_PER_S = 0.04, 49.7, 50.0 * np.pi


def double_cage(slip: np.ndarray) -> np.ndarray:
    """Return torque over rated torque at a slip: the cages side by side behind the stator, in synchronous watts."""

    def watts(s: np.ndarray) -> np.ndarray:
        s = np.where(np.abs(s) < 1e-9, 1e-9, s)
        rotor = sum(1.0 / (cage.real / s + 1j * cage.imag) for cage in CAGES)
        return np.abs(VOLTS / (1.0 + STATOR * (EXCITATION + rotor))) ** 2 * rotor.real

    return np.asarray(watts(slip) / watts(np.array(RATED_SLIP)))


SLIPS = np.linspace(1e-3, 1.0, 2000)
NAME_PLATE = {
    "drive.kind": "kloss",
    "motor.rated_power_w": RATED_NM * (1.0 - RATED_SLIP) * FIELD_RAD_PER_S,
    "motor.rated_speed_rpm": 1500.0 * (1.0 - RATED_SLIP),
    "motor.synchronous_speed_rpm": 1500.0,
    "motor.breakdown_torque_ratio": float(double_cage(SLIPS).max()),
    "motor.starting_torque_ratio": float(double_cage(np.array(1.0))),
    "motor.rotor_inertia_kg_m2": 0.3,
    "gear.ratio": 9.6,
    "gear.efficiency": 0.95,
}


@dataclass(frozen=True)
class DoubleCage:
    """The drive of the machine with the torque of the double cage in place of its own."""

    drive: MotorRole

    @property
    def joints(self) -> tuple[str, ...]:
        return self.drive.joints

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        shown = self.drive.respond(linkage, target)
        slip = shown.command - shown.velocity[0] / FIELD_RAD_PER_S
        return shown._replace(effort=(RATED_NM * float(double_cage(np.array(slip))),))


def test_the_curves_differ_by_a_fifth_of_rated_torque() -> None:
    built = machine("vibration_crank", None, NAME_PLATE)
    kloss = motor_constants(built.parameters.motor)  # type: ignore[attr-defined]
    own = [motor_torque(kloss, (1.0 - slip) * FIELD_RAD_PER_S, 1.0) / RATED_NM for slip in SLIPS.tolist()]
    assert np.sqrt(np.mean((np.array(own) - double_cage(SLIPS)) ** 2)) > 0.2
    assert motor_torque(kloss, (1.0 - RATED_SLIP) * FIELD_RAD_PER_S, 1.0) == pytest.approx(RATED_NM, rel=0.01)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path]]:
    """Provide a start of the machine with the double cage, as the speed of its crank shows it, and its map."""
    built = machine("vibration_crank", None, NAME_PLATE)
    other = replace(built, motor=DoubleCage(built.motor))
    run = Trajectory()
    for frame in frames(other, 1.2):
        run.append(frame)
    columns = run.columns()
    times, speed = np.array(columns["time_s"][::5]), np.array(columns["linkage.crank.velocity"][::5])
    speed = speed + 0.02 * np.random.default_rng(6).standard_normal(len(speed))
    folder = tmp_path_factory.mktemp("motor")
    np.savetxt(folder / "start.csv", np.column_stack([times, speed]), delimiter=",", header="t,speed", comments="")
    channels = [{"source": {"column": "speed"}, "is": "linkage.crank.velocity", "sigma": 0.02}]
    tree = {"machine": "vibration_crank", "time": {"column": "t"}, "channels": channels}
    (folder / "map.yaml").write_text(yaml.safe_dump(tree))
    yield folder / "start.csv", folder / "map.yaml"


def test_an_inertia_is_not_bent_to_make_up_for_another_motor(recorded: tuple[Path, Path]) -> None:
    run, given = recorded
    found = mt.identify("vibration_crank", [run], given, ["motor.rotor_inertia_kg_m2"], NAME_PLATE, share=0.0, cores=1)
    (row,) = found.table
    assert row["verdict"] == "model_error"
    assert "linkage.crank.velocity is off by" in row["reason"]
    assert found.parameters.motor.rotor_inertia_kg_m2 == 0.3  # type: ignore[attr-defined]

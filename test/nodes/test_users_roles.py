# SPDX-License-Identifier: Apache-2.0
"""A class of somebody's own takes the place of a role inside the process, with the checks of a node of their own."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from catalogue import built
from command_line import mech_twin
from step_samples import recorded_samples

from mech_twin.engine.run import frames
from mech_twin.machines import mb10_breaker
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.roles.role_node import UsersRoleError, with_users_roles
from mech_twin.nodes.run.composition import run_in_process
from mech_twin.samples import Frame, MotorSample

NAME, RUN_S = "mb10_breaker", 0.2
GEAR = 14.0  # of the page's motor
PAGE = (Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "own-node.md").read_text(encoding="utf-8")
MODULE = (
    PAGE.partition("```python file=my_package.py\n")[2].partition("```")[0]
    + '''
from mech_twin.machines import mb10_breaker


class Same:
    """Each role of the machine itself, as somebody's own."""

    def __init__(self, parameters):
        made = mb10_breaker.build(parameters)
        self.respond = made.motor.respond
        self.analyse = made.forces.analyse
        self.start, self.follow = made.body.start, made.body.follow


class Bad(DcMotor):
    def respond(self, linkage, target):
        return WRONG(super().respond(linkage, target))


class Unmade(DcMotor):
    def __init__(self): ...


class Breaking(DcMotor):
    def respond(self, linkage, target):
        return 1.0 / (linkage.step - linkage.step)


class Tiring(DcMotor):
    def respond(self, linkage, target):
        return super().respond(linkage, target / (linkage.step != 50))
'''
)


@pytest.fixture
def my_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    (tmp_path / "my_package.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    sys.modules.pop("my_package", None)
    with_users_roles(built(NAME), RunOptions(motor="my_package:DcMotor"))
    yield sys.modules["my_package"]
    del sys.modules["my_package"]


def recorded(tmp_path: Path, **options: Any) -> dict[str, list[Any]]:
    asked = RunOptions(pace="max", duration_s=RUN_S, recorder=True, exclusive=False, **options)
    run_in_process(NAME, built(NAME).parameters, asked, tmp_path / "bag", None)
    return recorded_samples(NAME, tmp_path / "bag")


def engine(**options: Any) -> list[Frame]:
    return list(frames(with_users_roles(built(NAME), RunOptions(**options)), RUN_S))


def test_the_machine_runs_on_a_motor_of_somebodys_own(my_package: Any, ros_domain: int, tmp_path: Path) -> None:
    found = recorded(tmp_path, motor="my_package:DcMotor")
    assert [sample.effort[0] for sample in found["step/motor"]] == [
        1.0 * (9.0 - 0.02 * (GEAR * sample.joint("crank").velocity)) for sample in found["step/linkage"]
    ]
    expected = engine(motor="my_package:DcMotor")
    assert found["step/linkage"] == [frame.linkage for frame in expected]
    assert found["step/linkage"] != [frame.linkage for frame in frames(built(NAME), RUN_S)]


@pytest.mark.slow
def test_a_recording_names_the_motor_of_somebodys_own_beside_the_difference(
    my_package: Any, ros_domain: int, tmp_path: Path
) -> None:
    recorded(tmp_path, motor="my_package:DcMotor")
    found = mech_twin("replay", tmp_path / "bag", "--resimulate")
    assert found.code == 1
    assert "recorded with my_package:DcMotor in the place of the motor" in found.err
    assert "topic /mb10_breaker/step/motor" in found.err


def test_our_own_roles_named_as_somebodys_give_the_same_bits(my_package: Any, ros_domain: int, tmp_path: Path) -> None:
    same = "my_package:Same"
    found = recorded(tmp_path, motor=same, forces=same, body=same)
    expected = list(frames(built(NAME), RUN_S))
    assert found["step/linkage"] == [frame.linkage for frame in expected]
    assert found["step/body"] == [frame.body for frame in expected]


WRONG = {
    "a word": (lambda sample: "torque", r"respond: returned str, refused: "),
    "not finite": (lambda sample: sample._replace(effort=(float("nan"),)), r"effort of 'rotor' is nan, not finite"),
    "another joint": (lambda sample: sample._replace(joints=("shaft",)), r"joint rotor is missing; there are shaft"),
    "too few": (lambda sample: sample._replace(effort=()), r"respond: returned MotorSample, refused: "),
    "another step": (
        lambda sample: MotorSample(sample.step + 1, sample.time_s + 1e-3, *sample[2:]),
        r"respond: answered step 1, expected 0",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_a_message_would_be_refused_for_ends_in_one_line(my_package: Any, wrong: str) -> None:
    change, words = WRONG[wrong]
    my_package.WRONG = change
    with pytest.raises(UsersRoleError, match=words) as refused:
        engine(motor="my_package:Bad")
    assert str(refused.value).startswith("run.motor my_package:Bad: ")
    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_a_breach_in_a_process_of_its_own_ends_in_one_line(my_package: Any, ros_domain: int, tmp_path: Path) -> None:
    asked = ["run", NAME, "--motor", "my_package:Tiring", "--processes", "--no-record", "--view", "none"]
    command = [sys.executable, "-m", "mech_twin", *asked]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "run.motor my_package:Tiring: respond: ZeroDivisionError" in ended.stderr
    assert "Exception in" not in ended.stderr
    assert "  File " not in ended.stderr


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("my_package:Breaking", r"respond: ZeroDivisionError: float division by zero \(my_package.py:\d+\)"),
        ("my_package:Unmade", r"cannot be made from the machine's parameters: TypeError: "),
        ("my_package:Nobody", r"AttributeError: .*Nobody"),
        ("no_such_package:DcMotor", r"ModuleNotFoundError: No module named 'no_such_package'"),
        ("my_package", r"expected MODULE:CLASS, or a name of the group mech_twin.roles"),
        ("builtins:dict", r"expected a class with the method respond"),
    ],
)
def test_a_class_that_cannot_take_the_place_is_refused_in_words(my_package: Any, name: str, words: str) -> None:
    with pytest.raises(UsersRoleError, match=words):
        engine(motor=name)


def test_a_machine_without_a_body_has_no_place_for_one() -> None:
    with pytest.raises(UsersRoleError, match=r"run.body my_package:Same: machine winding_drum has no body"):
        with_users_roles(built("winding_drum"), RunOptions(body="my_package:Same"))


def test_what_a_class_does_not_say_the_role_that_was_there_says(my_package: Any) -> None:
    users = with_users_roles(built(NAME), RunOptions(forces="my_package:Same"))
    assert users.forces.pins == built(NAME).forces.pins
    assert replace(users, forces=built(NAME).forces).motor is users.motor
    assert mb10_breaker.PARAMETERS is type(users.parameters)

# SPDX-License-Identifier: Apache-2.0
"""A step message that was damaged is a sample or a MessageError, never anything else."""

from __future__ import annotations

import random
from array import array
from typing import Any

import pytest
from catalogue import NAMES, built
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.step_message import (
    EVENT,
    REVISION,
    STEP,
    MessageError,
    arranged,
    body,
    configuration_mark,
    force,
    linkage,
    motor,
)

MUTATIONS = 1000
NUMBERS = (float("nan"), float("inf"), -float("inf"), 0.0, -1.0, 1e300, -1e300, 5e-324, 2.0**63)
WORDS = (
    "", "~", "/", "\0", STEP, REVISION, "~memory/", "~residual/x", "a/force_x_n", "~load/0/a/b/time_s", "~load/time_s",
    *(EVENT + end for end in ("0/a/b", "²/a/b", "0/after", "9" * 5000 + "/a/b", "0/pre/x")),
)  # fmt: skip


def mutated(message: JointState, chance: random.Random) -> JointState:
    """Return a copy with one to three things wrong with it."""
    columns: dict[str, Any] = {
        "name": list(message.name), "position": list(message.position),
        "velocity": list(message.velocity), "effort": list(message.effort),
    }  # fmt: skip
    copy = JointState(header=message.header)
    for _ in range(chance.randint(1, 3)):
        key = chance.choice(list(columns))
        column = columns[key]
        new = chance.choice(WORDS if key == "name" else NUMBERS)
        at = chance.randrange(len(column) + 1)
        how = chance.randrange(5)
        if how == 0:
            column.insert(at, new)
        elif how == 1:
            del column[at:]
        elif how == 2:
            chance.shuffle(column)
        elif column and how == 3:
            column[at % len(column)] = new
        else:
            for part in columns.values():
                part.append(new if part is column else "more" if part is columns["name"] else 0.0)
    copy.name = columns["name"]
    copy.position, copy.velocity, copy.effort = (array("d", columns[key]) for key in ("position", "velocity", "effort"))
    return copy


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_step_message_is_a_sample_or_a_message_error(name: str) -> None:
    machine = built(name)
    chance = random.Random(name)
    *_, last = frames(machine, 0.05)
    codecs: list[tuple[Any, Any, Any]] = [
        (linkage, last.linkage, machine.linkage.joints),
        (motor, last.motor, machine.motor.joints),
        (force, last.forces, None),
    ]
    if machine.body is not None:
        codecs.append((body, last.body, machine.body.joints))
    refused = 0
    for _ in range(MUTATIONS):
        codec, sample, joints = chance.choice(codecs)
        message = mutated(codec.to_message(sample), chance)
        try:
            decoded = codec.from_message(message, machine.coupling_step_s)
            if joints is not None:
                arranged(decoded, joints)
            configuration_mark(message)
        except MessageError:
            refused += 1
    assert refused > MUTATIONS // 2

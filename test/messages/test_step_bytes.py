# SPDX-License-Identifier: Apache-2.0
"""A sample written straight into bytes is a message of the middleware, each number in the row of its name."""

from __future__ import annotations

import pytest
from catalogue import NAMES, built
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.cdr import encoded, received_message
from mech_twin.messages.step_message import REVISION, SOURCE, TARGET, Row, body, force, linkage, motor

SIGNATURE = Row(SOURCE, 2.0**47 + 1.0)
MARKS = [(), (SIGNATURE,), (Row(REVISION, 3.0, 17.0), SIGNATURE), (Row(TARGET, 0.5), SIGNATURE)]


def again(raw: bytes) -> bytes:
    """Return bytes as they are written anew of what the middleware reads of them."""
    return encoded(received_message(bytes(serialize_message(deserialize_message(raw, JointState)))))


def rows(raw: bytes) -> dict[str, tuple[float, ...]]:
    message = received_message(raw)
    return dict(zip(message.name, zip(message.position, message.velocity, message.effort, strict=True), strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_the_bytes_are_those_of_the_message(name: str) -> None:
    for frame in frames(built(name), 0.3):
        for marks in MARKS:
            assert linkage.to_bytes(frame.linkage, marks) == again(linkage.to_bytes(frame.linkage, marks))
            assert motor.to_bytes(frame.motor, marks) == again(motor.to_bytes(frame.motor, marks))
            assert force.to_bytes(frame.forces, marks) == again(force.to_bytes(frame.forces, marks))
            if frame.body is not None:
                assert body.to_bytes(frame.body, marks) == again(body.to_bytes(frame.body, marks))


@pytest.mark.parametrize("name", NAMES)
def test_each_row_has_the_number_of_its_name(name: str) -> None:
    for frame in frames(built(name), 0.02):
        linkage_rows = rows(linkage.to_bytes(frame.linkage))
        for joint, *numbers in zip(frame.linkage.joints, *frame.linkage[3:6], strict=True):
            assert linkage_rows[joint] == tuple(numbers)
        assert linkage_rows["~regime"][0] == frame.linkage.regime
        assert linkage_rows["~step"][:2] == (frame.linkage.step, frame.linkage.time_s)
        named = {f"~memory/{key}": value for key, value in frame.linkage.memory.as_dict().items()}
        assert {key: row[0] for key, row in linkage_rows.items() if key in named} == named
        assert rows(motor.to_bytes(frame.motor))["~command"] == (frame.motor.command, 0.0, 0.0)
        force_rows = rows(force.to_bytes(frame.forces))
        efforts = {**frame.forces.quantities.as_dict(), "~body_moment_nm": frame.forces.body_moment_nm}
        for pin, wrench in zip(frame.forces.pins, frame.forces.wrenches, strict=True):
            efforts |= {f"{pin}/{field}": value for field, value in wrench._asdict().items()}
        assert {key: row for key, row in force_rows.items() if key in efforts} == {
            key: (0.0, 0.0, value) for key, value in efforts.items()
        }
        shown = rows(force.shown(frame.forces))
        assert shown == {key: row for key, row in force_rows.items() if not key.startswith("~")}
        assert tuple(rows(linkage.shown(frame.linkage))) == frame.linkage.joints

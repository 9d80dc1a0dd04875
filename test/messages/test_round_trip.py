# SPDX-License-Identifier: Apache-2.0
"""Samples survive their messages to the bit, through the wire format."""

from __future__ import annotations

import math

import pytest
from catalogue import NAMES, built
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from mech_twin.engine.run import frames
from mech_twin.messages import scene
from mech_twin.messages.step_message import MessageError, arranged, body, force, linkage, motor
from mech_twin.samples import Coordinate, Drawing, Event, LinkageSample, Named


def over_the_wire(message: JointState) -> JointState:
    return deserialize_message(serialize_message(message), JointState)


@pytest.mark.parametrize("name", NAMES)
def test_every_sample_of_a_run_survives_the_wire(name: str) -> None:
    for frame in frames(built(name), 0.2):
        assert linkage.from_message(over_the_wire(linkage.to_message(frame.linkage))) == frame.linkage
        assert motor.from_message(over_the_wire(motor.to_message(frame.motor))) == frame.motor
        assert force.from_message(over_the_wire(force.to_message(frame.forces))) == frame.forces
        if frame.body is not None:
            assert body.from_message(over_the_wire(body.to_message(frame.body))) == frame.body


@pytest.mark.parametrize("name", NAMES)
def test_every_drawing_survives_the_wire(name: str) -> None:
    machine = built(name)
    first = next(iter(frames(machine, 0.0)))
    drawing = Drawing(0, 0.0, machine.draw(first.linkage, first.body))
    message = deserialize_message(scene.to_bytes(drawing), MarkerArray)
    again = scene.from_message(message)
    assert [shape.name for shape in again.shapes] == [shape.name for shape in drawing.shapes]
    assert [shape.kind for shape in again.shapes] == [shape.kind for shape in drawing.shapes]
    assert [shape.text for shape in again.shapes] == [shape.text for shape in drawing.shapes]
    assert [shape.points_m for shape in again.shapes] == [shape.points_m for shape in drawing.shapes]
    assert [shape.colour for shape in again.shapes] == [shape.colour for shape in drawing.shapes]


@pytest.mark.parametrize("share", [math.nan, math.inf, -0.1, 1.1])
def test_a_marker_of_no_colour_is_refused(share: float) -> None:
    machine = built("winding_drum")
    message = deserialize_message(
        scene.to_bytes(Drawing(0, 0.0, machine.draw(machine.linkage.start(), None))), MarkerArray
    )
    message.markers[0].color.g = share
    with pytest.raises(MessageError, match="colour"):
        scene.from_message(message)


def sample() -> LinkageSample:
    event = Event(0.1234567890123456, "blow", "tool", 1.5, -0.5, 20.9, 7, (Coordinate(1.0, 2.0, 3.0),), ())
    memory, residuals = Named(("energy_j",), (1.0,)), Named(("loop_closure_m",), (1e-16,))
    return LinkageSample(
        2, 0.2, ("crank", "rocker"), (1.0, 2.0), (3.0, 4.0), (5.0, 6.0), 1, 0.5, memory, residuals, (event,)
    )


def test_an_event_keeps_the_full_precision_of_its_time() -> None:
    assert linkage.from_message(over_the_wire(linkage.to_message(sample()))).events == sample().events


def test_joints_are_matched_by_name() -> None:
    shuffled = sample()._replace(
        joints=("rocker", "crank"), position=(2.0, 1.0), velocity=(4.0, 3.0), effort=(6.0, 5.0)
    )
    assert arranged(shuffled, ("crank", "rocker")) == sample()


def test_a_missing_joint_is_named() -> None:
    with pytest.raises(MessageError, match="coupler"):
        arranged(sample(), ("crank", "coupler"))


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_a_number_that_is_not_finite_is_refused(bad: float) -> None:
    with pytest.raises(MessageError, match="finite"):
        linkage.from_message(linkage.to_message(sample()._replace(effort=(bad, 0.0))))


def test_columns_of_unequal_length_are_refused() -> None:
    message = linkage.to_message(sample())
    message.effort = message.effort[:-1]
    with pytest.raises(MessageError, match=r"column effort has \d+ numbers, expected \d+"):
        linkage.from_message(message)


def test_a_stamp_that_contradicts_its_step_is_refused() -> None:
    message = linkage.to_message(sample())
    message.header.stamp.nanosec += 1000
    with pytest.raises(MessageError, match="stamp"):
        linkage.from_message(message)


def test_somebodys_own_joint_state_counts_by_its_stamp() -> None:
    message = JointState(name=["rotor"], position=[1.0], velocity=[2.0], effort=[3.0])
    message.header.stamp.nanosec = 5_000_000
    assert motor.from_message(message, 0.001).step == 5
    with pytest.raises(MessageError, match="coupling step"):
        motor.from_message(message)

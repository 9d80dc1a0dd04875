# SPDX-License-Identifier: Apache-2.0
"""What a shadow publishes of an estimate: states, residuals, virtual sensors, each with its standard deviation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import nan
from typing import NamedTuple

from geometry_msgs.msg import WrenchStamped

from mech_twin.engine.sample_vectors import Array
from mech_twin.measurements.machine_columns import joint_column, sliding_in
from mech_twin.messages import impact
from mech_twin.messages.joint_state_cdr import Header, Stamp, StepMessage, encoded
from mech_twin.messages.topics import (
    DETECTED_IMPACTS,
    ESTIMATED,
    RESIDUALS,
    VIRTUAL_DRIVE,
    VIRTUAL_PRESSING_FORCE,
    Topic,
    sigma_of,
    virtual_pin,
)
from mech_twin.nodes.counting_publisher import CountingPublisher
from mech_twin.roles import Machine
from mech_twin.samples import Event
from mech_twin.studies.observer.estimate import FrameEstimate, SensedChannel

PRESSING_FORCE_COLUMN = "body.pressing_force_n"
FIELDS = ("position", "velocity", "effort")
Output = Callable[[Topic], CountingPublisher]


class JointTable(NamedTuple):
    """Joints of a machine, each once, and the places of position, velocity and effort in a row."""

    names: tuple[str, ...]
    position: tuple[int, ...]
    velocity: tuple[int, ...]
    effort: tuple[int, ...]


class VirtualSensor(NamedTuple):
    """One virtual sensor: its publisher and that of its sigma, and the places of force x, force y and moment."""

    value: CountingPublisher
    sigma: CountingPublisher
    frame: str
    force_x: int | None
    force_y: int | None
    moment: int | None


def joint_table(columns: Mapping[str, int]) -> JointTable:
    """Return the joints of a machine; a body's own come before the linkage's copy of them."""
    found: dict[str, str] = {}
    for role in ("body", "linkage", "motor"):
        for column in columns:
            parts = joint_column(column)
            if parts is not None and parts.role == role and parts.field == "position":
                found.setdefault(parts.joint, role)
    told = [tuple(columns[f"{role}.{joint}.{field}"] for joint, role in found.items()) for field in FIELDS]
    return JointTable(tuple(found), *told)


class ShadowOutputs:
    """Publishers of a shadow.

    Parameters
    ----------
    output : callable
        Makes a counted publisher.
    machine : Machine
        The model.
    columns : mapping
        Places of a row by column.
    namespace : str
        Frames of the wrenches stand below it.
    stamp : callable
        Stamp of a time.
    """

    def __init__(
        self,
        output: Output,
        machine: Machine,
        columns: Mapping[str, int],
        namespace: str,
        stamp: Callable[[float], Stamp],
    ) -> None:
        self._stamp = stamp
        self._joints = joint_table(columns)
        self._columns = columns
        self._estimated, self._sigma = output(ESTIMATED), output(sigma_of(ESTIMATED))
        self._residuals, self._impacts = output(RESIDUALS), output(DETECTED_IMPACTS)
        frames = f"{namespace.removeprefix('/')}/"
        self._virtual: list[VirtualSensor] = []
        for pin in machine.forces.pins:
            places = [columns.get(f"forces.{pin}.{name}") for name in ("force_x_n", "force_y_n", "moment_nm")]
            self._add(output, virtual_pin(pin), frames + pin, *places)
        first = machine.linkage.joints[0]
        drive = columns[f"linkage.{first}.effort"]
        by_force = first in sliding_in(machine)
        self._add(output, VIRTUAL_DRIVE, frames + first, drive if by_force else None, None, None if by_force else drive)
        if machine.body is not None:
            self._add(output, VIRTUAL_PRESSING_FORCE, f"{frames}tool", columns[PRESSING_FORCE_COLUMN], None, None)

    def _add(self, output: Output, topic: Topic, frame: str, *places: int | None) -> None:
        self._virtual.append(VirtualSensor(output(topic), output(sigma_of(topic)), frame, *places))

    def send_joints(self, time_s: float, row: Array, sigma: Array) -> None:
        """Publish the joints, those that are not measured too; what cannot be told is NaN."""
        self._estimated.send(encoded(self._joint_message(time_s, row)))
        self._sigma.send(encoded(self._joint_message(time_s, sigma)))

    def send_residuals(self, estimate: FrameEstimate, channels: tuple[SensedChannel, ...]) -> None:
        """Publish measured less predicted of the channels of a sample; fields that are not measured are NaN."""
        rows: dict[str, dict[str, float]] = {}
        for place, value in zip(estimate.channels, estimate.innovations, strict=True):
            parts = joint_column(channels[place].column)
            name, field = (parts.joint, parts.field) if parts else (channels[place].column, "effort")
            rows.setdefault(name, {})[field] = value
        position, velocity, effort = (tuple(row.get(field, nan) for row in rows.values()) for field in FIELDS)
        header = Header(self._stamp(estimate.time_s))
        self._residuals.send(encoded(StepMessage(header, tuple(rows), position, velocity, effort)))

    def send_virtual(self, time_s: float, row: Array, sigma: Array) -> None:
        """Publish the virtual sensors."""
        for sensor in self._virtual:
            sensor.value.send(_wrench(self._stamp(time_s), sensor, row))
            sensor.sigma.send(_wrench(self._stamp(time_s), sensor, sigma))

    def send_impacts(self, events: tuple[Event, ...]) -> None:
        """Publish the events with an impulse."""
        for event in events:
            if event.impulse_ns != 0.0:
                message = impact.to_message(event)
                message.header.stamp.sec, message.header.stamp.nanosec = self._stamp(event.time_s)
                self._impacts.send(message)

    def _joint_message(self, time_s: float, row: Array) -> StepMessage:
        names, *places = self._joints
        position, velocity, effort = (tuple(row[list(of_field)].tolist()) for of_field in places)
        return StepMessage(Header(self._stamp(time_s)), names, position, velocity, effort)


def _wrench(stamp: Stamp, sensor: VirtualSensor, row: Array) -> WrenchStamped:
    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    message.header.frame_id = sensor.frame
    message.wrench.force.x = 0.0 if sensor.force_x is None else float(row[sensor.force_x])
    message.wrench.force.y = 0.0 if sensor.force_y is None else float(row[sensor.force_y])
    message.wrench.torque.z = 0.0 if sensor.moment is None else float(row[sensor.moment])
    return message

# SPDX-License-Identifier: Apache-2.0
"""A run as columns: one array for each number of a frame."""

from __future__ import annotations

from array import array
from collections.abc import Iterator

from mech_twin.samples import BodySample, Event, ForceSample, Frame, LinkageSample, MotorSample


def frame_numbers(frame: Frame) -> Iterator[tuple[str, float]]:
    """Yield every number of a frame under the name of its column."""
    yield "time_s", frame.linkage.time_s
    for role, sample in (("linkage", frame.linkage), ("motor", frame.motor), ("body", frame.body)):
        if sample is not None:
            yield from joint_numbers(role, sample)
    yield "linkage.regime", float(frame.linkage.regime)
    yield "motor.command", frame.motor.command
    yield from force_numbers(frame.forces)
    if frame.body is not None:
        yield "forces.body_moment_nm", frame.forces.body_moment_nm
        yield "body.pressing_force_n", frame.body.pressing_force_n
        yield "body.regime", float(frame.body.regime)


def joint_numbers(role: str, sample: LinkageSample | MotorSample | BodySample) -> Iterator[tuple[str, float]]:
    """Yield position, velocity and effort of each joint of a role under the names of their columns."""
    for i, joint in enumerate(sample.joints):
        yield f"{role}.{joint}.position", sample.position[i]
        yield f"{role}.{joint}.velocity", sample.velocity[i]
        yield f"{role}.{joint}.effort", sample.effort[i]


def force_numbers(forces: ForceSample) -> Iterator[tuple[str, float]]:
    """Yield every pin reaction and derived quantity under the names of their columns."""
    for pin, wrench in zip(forces.pins, forces.wrenches, strict=True):
        for name, value in zip(wrench._fields, wrench, strict=True):
            yield f"forces.{pin}.{name}", value
    for name, value in forces.quantities.as_dict().items():
        yield f"forces.{name}", value


def frame_events(frame: Frame) -> tuple[Event, ...]:
    """Return the events of the step that ends with this frame, in time order."""
    return step_events(frame.linkage, frame.body)


def step_events(linkage: LinkageSample | None, body: BodySample | None) -> tuple[Event, ...]:
    """Return the events of a step in time order, those of a missing sample left out."""
    own = () if linkage is None else linkage.events
    others = () if body is None else body.events
    return tuple(sorted((*own, *others), key=lambda event: event.time_s)) if own or others else ()


class Trajectory:
    """Columns of samples, growing frame by frame."""

    def __init__(self) -> None:
        self._names: list[str] = []
        self._columns: list[array[float]] = []

    def append(self, frame: Frame) -> None:
        """Add one frame."""
        row = dict(frame_numbers(frame))
        if not self._names:
            self._names = list(row)
            self._columns = [array("d") for _ in row]
        for column, value in zip(self._columns, row.values(), strict=True):
            column.append(value)

    def columns(self) -> dict[str, list[float]]:
        """Return every column by name."""
        return {name: column.tolist() for name, column in zip(self._names, self._columns, strict=True)}

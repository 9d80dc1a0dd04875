# SPDX-License-Identifier: Apache-2.0
"""MotorSample <-> sensor_msgs/JointState on ``step/motor``."""

from __future__ import annotations

from sensor_msgs.msg import JointState

from mech_twin.messages.joint_state_cdr import AnyStep, StepMessage, joint_state
from mech_twin.messages.step_bytes import moving_bytes
from mech_twin.messages.step_message import ASKED, COMMAND, HELD, NOTHING, STEP, MessageError, Row, packed
from mech_twin.messages.step_table import Table, joint_columns, table
from mech_twin.samples import EffortCommand, MotorSample

SCALARS = (STEP, COMMAND)


def to_step(sample: MotorSample, marks: tuple[Row, ...] = ()) -> StepMessage:
    """Return the sample as a step message, with the rows the publishing node adds."""
    scalars = (Row(STEP, float(sample.step), sample.time_s), Row(COMMAND, sample.command))
    return packed(sample, scalars, marks=(*_asked_rows(sample), *marks))


def to_bytes(sample: MotorSample, marks: tuple[Row, ...] = ()) -> bytes:
    """Return the bytes of the sample as a step message."""
    more = (*_asked_rows(sample), *marks)
    return moving_bytes(sample, SCALARS, (sample.step, sample.command), NOTHING, NOTHING, more)


def to_message(sample: MotorSample) -> JointState:
    """Return the sample as a message of the middleware."""
    return joint_state(to_step(sample))


def from_message(message: AnyStep, step_s: float | None = None) -> MotorSample:
    """Return the sample of a message; one without bookkeeping rows comes from somebody's own motor.

    Raises
    ------
    MessageError
        If the message is no motor sample.
    """
    content = table(message)
    return MotorSample(
        *joint_columns(message, content, step_s),
        content.scalar(COMMAND, 1.0),
        _asked(content),
    )


def _asked_rows(sample: MotorSample) -> tuple[Row, ...]:
    """Return the rows of the effort asked, if one is: effort, position; stiffness, damping."""
    if sample.asked is None:
        return ()
    return (Row(ASKED, *sample.asked[:2]), Row(HELD, *sample.asked[2:]))


def _asked(content: Table) -> EffortCommand | None:
    rows = [content.layout.scalars.get(name) for name in (ASKED, HELD)]
    if rows == [None, None]:
        return None
    if None in rows:
        raise MessageError(f"one of the rows '{ASKED}' and '{HELD}' is missing")
    return EffortCommand(*(column[row] for row in rows if row is not None for column in content[1:3]))

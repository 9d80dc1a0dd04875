# SPDX-License-Identifier: Apache-2.0
"""MotorSample <-> sensor_msgs/JointState on ``step/motor``."""

from __future__ import annotations

from sensor_msgs.msg import JointState

from mech_twin.messages.joint_state_cdr import AnyStep, StepMessage, joint_state
from mech_twin.messages.step_bytes import moving_bytes
from mech_twin.messages.step_message import COMMAND, NOTHING, STEP, Row, packed
from mech_twin.messages.step_table import joint_columns, table
from mech_twin.samples import MotorSample

SCALARS = (STEP, COMMAND)


def to_step(sample: MotorSample, marks: tuple[Row, ...] = ()) -> StepMessage:
    """Return the sample as a step message, with the rows the publishing node adds."""
    return packed(sample, (Row(STEP, float(sample.step), sample.time_s), Row(COMMAND, sample.command)), marks=marks)


def to_bytes(sample: MotorSample, marks: tuple[Row, ...] = ()) -> bytes:
    """Return the bytes of the sample as a step message."""
    return moving_bytes(sample, SCALARS, (sample.step, sample.command), NOTHING, NOTHING, marks)


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
    )

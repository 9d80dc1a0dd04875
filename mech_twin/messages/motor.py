"""MotorSample <-> sensor_msgs/JointState on ``motor/joint_states``."""

from __future__ import annotations

from sensor_msgs.msg import JointState

from mech_twin.messages.step_message import COMMAND, STEP, AnyStep, joint_columns, packed, table
from mech_twin.samples import MotorSample


def to_message(sample: MotorSample, message: JointState | None = None) -> JointState:
    """Return the sample as a message."""
    scalars = ((STEP, float(sample.step), sample.time_s, 0.0), (COMMAND, sample.command, 0.0, 0.0))
    return packed(message or JointState(), sample, scalars)


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

"""LinkageSample <-> sensor_msgs/JointState on ``joint_states``."""

from __future__ import annotations

from sensor_msgs.msg import JointState

from mech_twin.messages.step_message import COMMAND, REGIME, STEP, AnyStep, joint_columns, packed, table
from mech_twin.samples import LinkageSample


def to_message(sample: LinkageSample, message: JointState | None = None) -> JointState:
    """Return the sample as a message."""
    scalars = (
        (STEP, float(sample.step), sample.time_s, 0.0),
        (REGIME, float(sample.regime), 0.0, 0.0),
        (COMMAND, sample.command, 0.0, 0.0),
    )
    return packed(message or JointState(), sample, scalars, sample.memory, sample.residuals, sample.events)


def from_message(message: AnyStep, step_s: float | None = None) -> LinkageSample:
    """Return the sample of a message; one without bookkeeping rows (a measured linkage) gives joints only.

    Raises
    ------
    MessageError
        If the message is no linkage sample.
    """
    content = table(message)
    return LinkageSample(
        *joint_columns(message, content, step_s),
        int(content.scalar(REGIME, 0.0)),
        content.scalar(COMMAND, 1.0),
        content.memory(),
        content.residuals(),
        content.events(),
    )

"""LinkageSample <-> sensor_msgs/JointState on ``joint_states``."""

from __future__ import annotations

from sensor_msgs.msg import JointState

from mech_twin.messages.rows import COMMAND, REGIME, REVISION, STEP, packed, step_and_time, table
from mech_twin.samples import LinkageSample


def to_message(sample: LinkageSample, message: JointState | None = None, revision: int = 0) -> JointState:
    """Return the sample as a message; ``revision`` counts the parameter changes it was computed with."""
    scalars = (
        (STEP, float(sample.step), sample.time_s, 0.0),
        (REGIME, float(sample.regime), 0.0, 0.0),
        (COMMAND, sample.command, 0.0, 0.0),
        (REVISION, float(revision), 0.0, 0.0),
    )
    return packed(message or JointState(), sample, scalars, sample.memory, sample.residuals, sample.events)


def from_message(message: JointState, step_s: float | None = None) -> LinkageSample:
    """Return the sample of a message; one without bookkeeping rows (a measured linkage) gives joints only.

    Raises
    ------
    MessageError
        If the message is no linkage sample.
    """
    content = table(message)
    step, time_s = step_and_time(message, content, step_s)
    return LinkageSample(
        step,
        time_s,
        content.layout.joints,
        content.joints(content.position),
        content.joints(content.velocity),
        content.joints(content.effort),
        int(content.scalar(REGIME, 0.0)),
        content.scalar(COMMAND, 1.0),
        content.memory(),
        content.residuals(),
        content.events(),
    )


def revision(message: JointState) -> int:
    """Return how many parameter changes a linkage message was computed with."""
    return int(table(message).scalar(REVISION, 0.0))

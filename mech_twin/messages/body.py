# SPDX-License-Identifier: Apache-2.0
"""BodySample <-> sensor_msgs/JointState on ``step/body``, and the pressing force as a wrench."""

from __future__ import annotations

from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

from mech_twin.messages.joint_state_cdr import AnyStep, StepMessage, encoded, joint_state
from mech_twin.messages.stamped_cdr import stamped_bytes
from mech_twin.messages.step_bytes import moving_bytes
from mech_twin.messages.step_message import REGIME, STEP, Row, packed, set_stamp
from mech_twin.messages.step_table import joint_columns, table
from mech_twin.samples import BodySample

PRESSING_FORCE = "~pressing_force_n"
TOOL_FRAME = "tool"
SCALARS = (STEP, REGIME, PRESSING_FORCE)


def to_step(sample: BodySample, marks: tuple[Row, ...] = ()) -> StepMessage:
    """Return the sample as a step message, with the rows the publishing node adds."""
    scalars = (
        Row(STEP, float(sample.step), sample.time_s),
        Row(REGIME, float(sample.regime)),
        Row(PRESSING_FORCE, sample.pressing_force_n),
    )
    return packed(sample, scalars, sample.memory, sample.residuals, sample.events, marks)


def to_bytes(sample: BodySample, marks: tuple[Row, ...] = ()) -> bytes:
    """Return the bytes of the sample as a step message."""
    if sample.events:
        return encoded(to_step(sample, marks))
    return moving_bytes(
        sample, SCALARS, (sample.step, sample.regime, sample.pressing_force_n), sample.memory, sample.residuals, marks
    )


def to_message(sample: BodySample) -> JointState:
    """Return the sample as a message of the middleware."""
    return joint_state(to_step(sample))


def from_message(message: AnyStep, step_s: float | None = None) -> BodySample:
    """Return the sample of a message.

    Raises
    ------
    MessageError
        If the message is no body sample.
    """
    content = table(message)
    return BodySample(
        *joint_columns(message, content, step_s),
        int(content.scalar(REGIME, 0.0)),
        content.scalar(PRESSING_FORCE),
        content.memory(),
        content.residuals(),
        content.events(),
    )


def pressing_force_bytes(time_s: float, frame: str, force_n: float) -> bytes:
    """Return the bytes of `pressing_force_message`."""
    return stamped_bytes(time_s, frame, (force_n, 0.0, 0.0, 0.0, 0.0, 0.0))


def pressing_force_message(
    time_s: float, frame: str, force_n: float, message: WrenchStamped | None = None
) -> WrenchStamped:
    """Return the pressing force as a wrench on the tool, along x of the tool's frame."""
    wrench = message or WrenchStamped()
    set_stamp(wrench.header, time_s)
    wrench.header.frame_id = frame
    wrench.wrench.force.x = force_n
    return wrench

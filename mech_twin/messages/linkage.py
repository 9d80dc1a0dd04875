# SPDX-License-Identifier: Apache-2.0
"""LinkageSample <-> sensor_msgs/JointState on ``step/linkage``."""

from __future__ import annotations

from functools import lru_cache

from sensor_msgs.msg import JointState

from mech_twin.messages.joint_state_cdr import AnyStep, StepMessage, encoded, joint_state, received_message
from mech_twin.messages.step_bytes import moving_bytes
from mech_twin.messages.step_message import COMMAND, REGIME, STEP, Row, packed
from mech_twin.messages.step_table import arranged, joint_columns, table
from mech_twin.samples import LinkageSample

SCALARS = (STEP, REGIME, COMMAND)


def to_step(sample: LinkageSample, marks: tuple[Row, ...] = ()) -> StepMessage:
    """Return the sample as a step message, with the rows the publishing node adds."""
    scalars = (
        Row(STEP, float(sample.step), sample.time_s),
        Row(REGIME, float(sample.regime)),
        Row(COMMAND, sample.command),
    )
    return packed(sample, scalars, sample.memory, sample.residuals, sample.events, marks)


def to_bytes(sample: LinkageSample, marks: tuple[Row, ...] = ()) -> bytes:
    """Return the bytes of the sample as a step message."""
    if sample.events:
        return encoded(to_step(sample, marks))
    return moving_bytes(
        sample, SCALARS, (sample.step, sample.regime, sample.command), sample.memory, sample.residuals, marks
    )


def to_message(sample: LinkageSample) -> JointState:
    """Return the sample as a message of the middleware."""
    return joint_state(to_step(sample))


@lru_cache(maxsize=8)
def received(raw: bytes, step_s: float, joints: tuple[str, ...]) -> LinkageSample:
    """Return the sample of a received step message, its joints in this order.

    Several nodes of one process hear the same bytes: whoever is not the first gets the sample that was made of them.

    Raises
    ------
    CdrError
        If it is no JointState.
    MessageError
        If it is no linkage sample, or a joint is missing.
    """
    sample: LinkageSample = arranged(from_message(received_message(raw), step_s), joints)
    return sample


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

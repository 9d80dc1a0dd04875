# SPDX-License-Identifier: Apache-2.0
"""Plain joint states for people and other tools: the joints of a sample, or the efforts of a force sample, and no more.

What the roles exchange are the step messages; from these nothing is read back.
"""

from __future__ import annotations

from collections.abc import Sequence

from mech_twin.messages import force
from mech_twin.messages.joint_state_cdr import Header, StepMessage, stamp_of
from mech_twin.samples import BodySample, Event, ForceSample, LinkageSample, Load, MotorSample


def joints_message(sample: LinkageSample | MotorSample | BodySample) -> StepMessage:
    """Return position, velocity and effort of every joint of a sample."""
    header = Header(stamp_of(sample.time_s))
    return StepMessage(header, sample.joints, sample.position, sample.velocity, sample.effort)


def efforts_message(sample: ForceSample) -> StepMessage:
    """Return pin reactions and derived quantities as efforts; positions and velocities, which they have none, are 0."""
    names = force.effort_names(sample.pins, sample.quantities.names)
    zeros = (0.0,) * len(names)
    return StepMessage(Header(stamp_of(sample.time_s)), names, zeros, zeros, tuple(force.efforts(sample)))


def largest_reaction(sample: ForceSample) -> float:
    """Return the magnitude of the greatest pin reaction, by which force samples are compared in a decimated stream."""
    return max(map(force.wrench_size, sample.wrenches), default=0.0)


def has_impact(happenings: Sequence[Event] | Sequence[Load]) -> bool:
    """Return whether one of these events, or of the loads they brought, has an impulse."""
    if not happenings:
        return False
    return any((each.impulse_ns if isinstance(each, Event) else each.impulse_nms) != 0.0 for each in happenings)

# SPDX-License-Identifier: Apache-2.0
"""Impacts as messages, and a blow's strain gauge: its numbers on ``blow/gauge``, its curve on ``blow/wave``.

Both have the stamp of the blow.  The curve is a trajectory of one joint, ``gauge``: position is the strain, effort the
force (N), compression positive; each point has its time since first contact, rounded to the nanosecond.

An event is a geometry_msgs/Vector3Stamped on ``impacts``: x velocity before (m/s), y after (m/s), z impulse (N s).

The stamp is the event's time rounded to the nanosecond.  The exact time is in the step message of the role that the
event belongs to.
"""

from collections.abc import Iterator

from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mech_twin.capabilities.blow_gauge import GAUGE_UNITS, BlowGauge
from mech_twin.messages.cdr import Header, Stamp, StepMessage, encoded, stamp_of, stamped_bytes
from mech_twin.messages.step_message import set_stamp
from mech_twin.samples import Event

JOINT = "gauge"


def to_bytes(event: Event, stamp: Stamp | None = None) -> bytes:
    """Return an event as CDR, under its own time unless a stamp is given; ``frame_id`` is ``contact/kind``."""
    numbers = (event.pre_velocity_m_per_s, event.post_velocity_m_per_s, event.impulse_ns)
    return stamped_bytes(stamp or stamp_of(event.time_s), f"{event.contact}/{event.kind}", numbers=numbers)


def numbers_bytes(gauge: BlowGauge, event: Event) -> bytes:
    """Return the numbers of a blow as CDR of named efforts; positions and velocities are 0."""
    numbers = gauge.numbers(event)
    zeros = (0.0,) * len(numbers)
    return encoded(StepMessage(Header(stamp_of(event.time_s)), tuple(GAUGE_UNITS), zeros, zeros, numbers))


def curve_message(gauge: BlowGauge, event: Event) -> JointTrajectory:
    """Return the strain and force curve of a blow as a trajectory."""
    curve = gauge.curve(event)
    message = JointTrajectory(joint_names=[JOINT])
    set_stamp(message.header, event.time_s)
    pairs = zip(curve.strain.tolist(), curve.force_n.tolist(), strict=True)
    for i, (strain, force) in enumerate(pairs, start=1):
        point = JointTrajectoryPoint(positions=[strain], effort=[force])
        point.time_from_start.sec, point.time_from_start.nanosec = stamp_of(i * curve.span_s)
        message.points.append(point)
    return message


def gauged_blows(gauge: BlowGauge | None, events: tuple[Event, ...]) -> Iterator[tuple[BlowGauge, Event]]:
    """Yield the gauge and each event that it measures."""
    if gauge is not None:
        yield from ((gauge, event) for event in events if gauge.has_reading(event))

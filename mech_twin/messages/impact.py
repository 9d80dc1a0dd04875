# SPDX-License-Identifier: Apache-2.0
"""Event -> geometry_msgs/Vector3Stamped on ``impacts``: x velocity before (m/s), y after (m/s), z impulse (N s).

The stamp is the event's time rounded to the nanosecond.  The exact time is in the step message of the role that the
event belongs to.
"""

from __future__ import annotations

from geometry_msgs.msg import Vector3Stamped

from mech_twin.messages.cdr import stamped_bytes
from mech_twin.messages.step_message import set_stamp
from mech_twin.samples import Event


def to_bytes(event: Event) -> bytes:
    """Return `to_message` as CDR bytes."""
    numbers = (event.pre_velocity_m_per_s, event.post_velocity_m_per_s, event.impulse_ns)
    return stamped_bytes(event.time_s, f"{event.contact}/{event.kind}", numbers=numbers)


def to_message(event: Event) -> Vector3Stamped:
    """Return an event as a message; ``frame_id`` is ``contact/kind``."""
    message = Vector3Stamped()
    set_stamp(message.header, event.time_s)
    message.header.frame_id = f"{event.contact}/{event.kind}"
    message.vector.x = event.pre_velocity_m_per_s
    message.vector.y = event.post_velocity_m_per_s
    message.vector.z = event.impulse_ns
    return message

# SPDX-License-Identifier: Apache-2.0
"""What is gathered of the body's motion in one cycle of its excitation: lift, spring force, returns, contact."""

from __future__ import annotations

import math

from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.samples import Event

COUNTED_ABOVE_M_PER_S = 1e-3  # slower returns to the collar are the tail of a chatter series and not counted
RETURNS = frozenset(("touchdown", "settled", "impact"))


class BodyCycle:
    """The body from one blow to the next.

    Parameters
    ----------
    start_s : float
        Time of the blow that begins it.
    resting_since_s : float or None
        Since when the body has been resting on its collar; None in flight.
    """

    def __init__(self, start_s: float, resting_since_s: float | None) -> None:
        self.start_s = start_s
        self.resting_since_s = resting_since_s
        self.lift_m = self.spring_force_n = self.return_speed_m_per_s = self.contact_s = 0.0
        self.settled_s = math.nan
        self.impacts = 0

    def take_position(self, lift_m: float, spring_force_n: float) -> None:
        """Take the lift at the tool and the spring's force at one step into account."""
        self.lift_m, self.spring_force_n = max(self.lift_m, lift_m), max(self.spring_force_n, spring_force_n)

    def take_event(self, event: Event) -> None:
        """Take an event at the collar into account."""
        if event.kind in RETURNS:
            speed = abs(event.pre_velocity_m_per_s)
            self.return_speed_m_per_s = max(self.return_speed_m_per_s, speed)
            self.impacts += speed > COUNTED_ABOVE_M_PER_S
        if event.kind == "settled":
            self.settled_s = self.resting_since_s = event.time_s
        if event.kind == "lift_off" and self.resting_since_s is not None:
            self.contact_s += event.time_s - max(self.resting_since_s, self.start_s)
            self.resting_since_s = None

    def contact_share(self, end_s: float) -> float:
        """Return the part of the cycle, ended by a blow, in which the body rests on its collar."""
        resting = 0.0 if self.resting_since_s is None else end_s - max(self.resting_since_s, self.start_s)
        return (self.contact_s + resting) / (end_s - self.start_s)

    def next(self, blow: Event) -> BodyCycle:
        """Return the cycle that a blow begins; the body rests on if the blow does not throw it up."""
        thrown = bool(blow.post) and EventSide(*blow.post).body.velocity > 0.0
        return BodyCycle(blow.time_s, None if thrown else self.resting_since_s)

    def metrics(self, end_s: float, gap_at_blow_m: float) -> dict[str, float]:
        """Return the metrics of the cycle, ended by a blow; the rest goes on into the next."""
        duration = end_s - self.start_s
        found = {
            "body_cycle_rate_hz": 1.0 / duration,
            "gap_at_blow_m": gap_at_blow_m,
            "largest_lift_at_tool_m": self.lift_m,
            "largest_spring_force_n": self.spring_force_n,
            "largest_return_speed_m_per_s": self.return_speed_m_per_s,
            "contact_share": self.contact_share(end_s),
            "impacts_above_1_mm_per_s": float(self.impacts),
        }
        if not math.isnan(self.settled_s):
            found["settled_at_fraction"] = (self.settled_s - self.start_s) / duration
        return found

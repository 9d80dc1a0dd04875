# SPDX-License-Identifier: Apache-2.0
"""The impact mass told from now on, not from its last event.

Its memory holds the motion at the last event: an impact, a change of the force, a change of what acts.  There the gap
is 0 exactly and what is uncertain is the instant, so gap and velocity at the anchor cannot carry a covariance through
an impact; and two frames of one motion with anchors at different instants have differences that mean nothing.  Told
from now on, gap and velocity are those of the mass, whatever has happened before.
"""

from __future__ import annotations

from mech_twin.capabilities.anchored_motion import AnchoredMotion
from mech_twin.machines.impact_mass.mass_row import anchor_at

GAP, ORIGIN = "linkage.memory.anchor_gap_m", "linkage.memory.origin_step_1"
ANCHORED_MOTION = AnchoredMotion(
    later={
        GAP: ("linkage.mass.position", -1.0),
        "linkage.memory.anchor_velocity_m_per_s": ("linkage.mass.velocity", 1.0),
        ORIGIN: (ORIGIN, 1.0),
    },
    origin=ORIGIN,
    tau="linkage.memory.anchor_tau_s",
    not_below_zero=(GAP,),  # the mass cannot be beyond the stop
    anchor_at=anchor_at,
)

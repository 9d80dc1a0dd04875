# SPDX-License-Identifier: Apache-2.0
"""Features of one turn of a driven joint of a page for monitoring, and faults of its struck rods."""

from __future__ import annotations

from mech_twin.capabilities.crank_features import crank_features
from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, event_share, event_value
from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key
from mech_twin.capabilities.gauge_features import gauge_features
from mech_twin.machines.page.parameters import Page

LESS = (-0.6, -0.5, -0.4, -0.3, -0.2, -0.1, -0.05)


def features(page: Page) -> CycleFeatures:
    """Return the features of a turn of the first turning joint that a drive leads.

    Raises
    ------
    StudyError
        If no drive turns a joint, by which cycles could be counted.
    """
    turning = ((n, d.joint) for n, d in page.drives.items() if d.joint and page.joints[d.joint].kind == "revolute")
    drive, joint = next(turning, ("", ""))
    if not joint:
        raise StudyError("this page has no drive of a turning joint, which cycles could be counted by; expected one")
    impact = (
        event_share("impact_share", "event.impact.time", "when in the turn the first impact comes"),
        event_value(
            "impact_speed_m_per_s", "m/s", "event.impact.pre_velocity", "speed of the hardest impact", "largest"
        ),
        event_value("impulse_ns", "N.s", "event.impact.impulse", "impulse of a turn", "sum"),
    )
    rods = any(contact.rod is not None for contact in page.contacts.values())
    return CycleFeatures(
        CycleReference(f"linkage.{joint}.position"),
        (
            *crank_features(f"linkage.{joint}.position", f"motor.{drive}.effort"),
            *(impact if any(contact.rigid for contact in page.contacts.values()) else ()),
            *(gauge_features("impact", "rod") if rods else ()),
        ),
    )


def faults(page: Page) -> tuple[MachineFault, ...]:
    """Return the faults of the rods: face, foot, wall."""
    found = []
    for name, contact in page.contacts.items():
        if contact.rod is None:
            continue
        rod, key = contact.rod, f"contacts.{name}.rod"
        if rod.face.kind == "linear":
            found.append(
                share_of_key(f"{name}_face_worn", "the struck face is softer", f"{key}.face.stiffness_n_per_m", LESS)
            )
        if rod.foot.length_m > 0.0:
            play = (1e-4, 2e-4, 5e-4)
            found.append(added_to_key(f"{name}_foot_worn", "the foot has play", f"{key}.foot_gap_m", "m", play))
        if rod.wall.kind == "loading":
            found.append(share_of_key(f"{name}_wall_soft", "the wall is softer", f"{key}.wall.stiffness_n_per_m", LESS))
        if rod.wall.kind == "yielding":
            found.append(
                share_of_key(f"{name}_wall_weak", "the wall gives way sooner", f"{key}.wall.threshold_n", LESS)
            )
    return tuple(found)

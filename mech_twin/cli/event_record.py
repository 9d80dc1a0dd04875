"""Conversion of an event to JSON."""

from __future__ import annotations

from typing import Any

from mech_twin.samples import Event


def event_record(event: Event) -> dict[str, Any]:
    """Return an event as a JSON object."""
    return {
        "time_s": event.time_s,
        "kind": event.kind,
        "contact": event.contact,
        "pre_velocity_m_per_s": event.pre_velocity_m_per_s,
        "post_velocity_m_per_s": event.post_velocity_m_per_s,
        "impulse_ns": event.impulse_ns,
        "period": event.period,
    }

# SPDX-License-Identifier: Apache-2.0
"""Events as lines of a log."""

from __future__ import annotations

from mech_twin.samples import Event

LEAST_SPEED_M_PER_S = 1e-3  # slower impacts are not logged: they are the end of a series of bounces
ROUNDING_M_PER_S = 1e-9  # a slower contact is at rest except for rounding


def is_logged(event: Event) -> bool:
    """Return whether an event is logged: a change of state, or an impact above a minimum speed."""
    speed = max(abs(event.pre_velocity_m_per_s), abs(event.post_velocity_m_per_s))
    return event.impulse_ns == 0.0 or speed >= LEAST_SPEED_M_PER_S


def event_line(event: Event) -> str:
    """Return the event as text: kind, contact, velocities before and after, impulse, cycle."""
    words = [f"{event.time_s:.6f} s  {event.kind} ({event.contact})"]
    if max(abs(event.pre_velocity_m_per_s), abs(event.post_velocity_m_per_s)) > ROUNDING_M_PER_S:
        words.append(f"{event.pre_velocity_m_per_s:+.4g} -> {event.post_velocity_m_per_s:+.4g} m/s")
    if event.impulse_ns != 0.0:
        words.append(f"{event.impulse_ns:.4g} N s")
    return "  ".join([*words, f"cycle {event.period}"])

# SPDX-License-Identifier: Apache-2.0
"""Errors of a coupling step of a page, naming its elements."""

from __future__ import annotations

from collections import Counter

from mech_twin.engine.compiled_roles import failed
from mech_twin.engine.errors import MotionError
from mech_twin.engine.hybrid.laws import Array
from mech_twin.engine.hybrid.loop import TOO_MANY
from mech_twin.engine.sample_vectors import EventLayout

FAILURES = (
    "more events in a coupling step than are followed", "no step is short enough for the motion",
    "more steps in a coupling step than are taken: a loop near a dead point, or a rate too stiff",
    "contacts contradict each other", "more events than the log takes",
    "", "", "", "", "a loop comes to a dead point, where its closures no longer determine the joints",
)  # fmt: skip


def failure_of(page: str, status: int, begin_s: float, events: EventLayout, log: Array) -> MotionError:
    """Return the error for a failed step, naming the page and the elements with most of its events.

    Parameters
    ----------
    page : str
        Name of the page.
    status : int
        Status returned by the kernel.
    begin_s : float
        Start of the step (s).
    events : EventLayout
        Layout of ``log``.
    log : ndarray
        Events of the step; a full table is replaced by one of twice its length and 8 rows more.
    """
    error = f"{page}: {failed(FAILURES, status, begin_s)}"
    filled = (len(log) - 8) // 2 - 2 * len(events.contacts) - 2
    if status != TOO_MANY or filled <= 0:
        return MotionError(error)
    counts = Counter(event.contact for event in events.events(log[:filled]))
    most = ", ".join(name for name, _ in counts.most_common(3))
    return MotionError(
        f"{error}, most of {most}; give a contact that stays pressed while another strikes restitution 0"
    )

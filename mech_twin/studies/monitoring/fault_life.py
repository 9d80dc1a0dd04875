# SPDX-License-Identifier: Apache-2.0
r"""Life of a fault on the panel, as a pure state machine: next state from the present one and the newest cycle.

::

    cleared --seen--> pending --seen for `debounce` cycles--> active --not seen for `clear` cycles--> latched
       ^                 |                                       |  \--acknowledged before-->  cleared
       |<---not seen-----+                                       |<--------- seen again --------+
       |<--------------------------- acknowledged ----------------------------------------------+

A latched fault is gone but not acknowledged.  A shelved one changes its state without announcements until its time.
The states are those of an alarm in ISA-18.2 (normal, unacknowledged, acknowledged, returned unacknowledged, shelved).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

State = Literal["cleared", "pending", "active", "latched"]


class LifeRules(NamedTuple):
    """Cycles that a fault must be seen to be active, and must not be seen to be gone; time between announcements."""

    debounce: int = 3
    clear: int = 10
    announce_every_s: float = 600.0


class FaultLife(NamedTuple):
    """A fault and its history.

    Attributes
    ----------
    name : str
        Of the fault, or of the group.
    state : str
        ``cleared``, ``pending``, ``active`` or ``latched``.
    since_s : float
        Stamp at which it came into this state.
    cycles : int
        Consecutive cycles that speak for the next state.
    is_acknowledged : bool
        Whether it was acknowledged since it became active.
    shelved_until_s : float
        Stamp until which it is not announced.
    """

    name: str
    state: State = "cleared"
    since_s: float = 0.0
    cycles: int = 0
    is_acknowledged: bool = False
    shelved_until_s: float = float("-inf")

    def is_announced(self, time_s: float) -> bool:
        """Return whether the operator is to see it: active or latched, not shelved."""
        return self.state in ("active", "latched") and time_s >= self.shelved_until_s


def after_cycle(life: FaultLife, seen: bool, time_s: float, rules: LifeRules) -> FaultLife:
    """Return the fault after a cycle that ended at ``time_s`` in which it was seen or not."""
    step = {"cleared": _after_cleared, "pending": _after_pending, "active": _after_active, "latched": _after_latched}
    return step[life.state](life, seen, time_s, rules)


def _after_cleared(life: FaultLife, seen: bool, time_s: float, rules: LifeRules) -> FaultLife:
    return _moved(life, "pending" if rules.debounce > 1 else "active", time_s, 1) if seen else life


def _after_pending(life: FaultLife, seen: bool, time_s: float, rules: LifeRules) -> FaultLife:
    if not seen:
        return _moved(life, "cleared", time_s)
    if life.cycles + 1 < rules.debounce:
        return life._replace(cycles=life.cycles + 1)
    return _moved(life, "active", time_s)._replace(is_acknowledged=False)


def _after_active(life: FaultLife, seen: bool, time_s: float, rules: LifeRules) -> FaultLife:
    if seen:
        return life._replace(cycles=0)
    if life.cycles + 1 < rules.clear:
        return life._replace(cycles=life.cycles + 1)
    return _moved(life, "cleared" if life.is_acknowledged else "latched", time_s)


def _after_latched(life: FaultLife, seen: bool, time_s: float, rules: LifeRules) -> FaultLife:
    return _moved(life, "active", time_s)._replace(is_acknowledged=False) if seen else life


def acknowledged(life: FaultLife, time_s: float) -> FaultLife:
    """Return the fault after acknowledgement: a latched one is cleared, an active one stays active."""
    if life.state == "latched":
        return _moved(life, "cleared", time_s)
    return life._replace(is_acknowledged=True) if life.state == "active" else life


def shelved(life: FaultLife, until_s: float) -> FaultLife:
    """Return the fault that is not announced until a stamp."""
    return life._replace(shelved_until_s=until_s)


def _moved(life: FaultLife, state: State, time_s: float, cycles: int = 0) -> FaultLife:
    return life._replace(state=state, since_s=time_s, cycles=cycles)

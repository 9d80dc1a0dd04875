# SPDX-License-Identifier: Apache-2.0
r"""State machine of one fault on the panel: from its state and whether it is observed to its next state.

::

    cleared --seen--> pending --seen for `debounce` cycles--> active --not seen for `clear` cycles--> latched
       ^                 |                                       |  \--acknowledged before-->  cleared
       |<---not seen-----+                                       |<--------- seen again --------+
       |<--------------------------- acknowledged ----------------------------------------------+

A latched fault has gone but is not acknowledged.  A shelved one changes state, but is not announced until a stamp.
The states are those of an alarm in ISA-18.2 (normal, unacknowledged, acknowledged, returned unacknowledged, shelved).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

State = Literal["cleared", "pending", "active", "latched"]


class LifeRules(NamedTuple):
    """Cycles with the fault until it is active, cycles without until it clears; least time between announcements."""

    debounce: int = 3
    clear: int = 10
    announce_every_s: float = 600.0


class FaultLife(NamedTuple):
    """A fault and its state.

    Attributes
    ----------
    name : str
        Name of the fault, or of the group of faults.
    state : str
        ``cleared``, ``pending``, ``active`` or ``latched``.
    since_s : float
        Stamp at which it entered this state.
    cycles : int
        Consecutive cycles counted towards the next state.
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
        """Return whether it is shown to the operator: active or latched, not shelved."""
        return self.state in ("active", "latched") and time_s >= self.shelved_until_s


def after_cycle(life: FaultLife, seen: bool, time_s: float, rules: LifeRules) -> FaultLife:
    """Return the fault after a cycle that ended at ``time_s``; ``seen`` is whether it was observed in it."""
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
    """Return the fault shelved until a stamp (s)."""
    return life._replace(shelved_until_s=until_s)


def _moved(life: FaultLife, state: State, time_s: float, cycles: int = 0) -> FaultLife:
    return life._replace(state=state, since_s=time_s, cycles=cycles)

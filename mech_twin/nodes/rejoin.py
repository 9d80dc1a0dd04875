# SPDX-License-Identifier: Apache-2.0
"""A linkage that starts asks its peers where the run is: the state of that question.  Knows no ROS, reads no clock.

See ``docs/decisions/0008-a-restarted-node-asks-its-peers.md``.
"""

from __future__ import annotations

import math

from mech_twin.parameters.load import Description
from mech_twin.samples import LinkageSample

ASK_AGAIN_S = 0.3
NOBODY_LIMIT_S = 1.0


class RejoinRequest:
    """The question of a starting linkage, and what was answered.

    Parameters
    ----------
    peer_limit_s : float
        Longest wait for the answers where a peer that can give them is there.

    Attributes
    ----------
    open : bool
        Whether answers are still waited for.
    linkage : LinkageSample, optional
        The sample to go on from, if somebody had one.
    description : Description, optional
        The configuration that was in force, if somebody had one.
    """

    def __init__(self, peer_limit_s: float) -> None:
        self.open = True
        self.linkage: LinkageSample | None = None
        self.description: Description | None = None
        self._peer_limit_s = peer_limit_s
        self._answered: set[str] = set()
        self._begun_s: float | None = None
        self._asked_s = -math.inf

    def due(self, now_s: float) -> bool:
        """Return whether to ask now, for the first time or again."""
        if now_s - self._asked_s <= ASK_AGAIN_S:
            return False
        self._asked_s = now_s
        return True

    def settled(self, now_s: float, somebody_answers: bool) -> bool:
        """Return whether everything is answered, or nobody will answer."""
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        limit_s = self._peer_limit_s if somebody_answers else NOBODY_LIMIT_S
        return self._answered == {"linkage", "description"} or now_s - self._begun_s > limit_s

    def answer_linkage(self, sample: LinkageSample | None) -> None:
        """Take the last sample a peer has; None if it has none."""
        if self.open:
            self.linkage = sample
            self._answered.add("linkage")

    def answer_description(self, description: Description | None) -> None:
        """Take the configuration a peer has; None if it has none."""
        if self.open:
            self.description = description
            self._answered.add("description")

    def close(self) -> None:
        """Accept no further answers."""
        self.open = False

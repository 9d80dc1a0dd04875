# SPDX-License-Identifier: Apache-2.0
"""How many publish a topic at once, where the middleware still knows a killed one for a while."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

FORGOTTEN_S = 30.0  # middlewares forget a silent participant after 10 s to 20 s
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of rmw: the endpoint is discovered before the name of its node, or outlives it


class LivingPublishers:
    """The publishers of one topic, by node name and endpoint.

    A killed node that was started again has two endpoints until the first is forgotten, of one name or one of them of
    none: they count as one, until both are known for longer than that.
    """

    def __init__(self) -> None:
        self._since_s: dict[tuple[str, bytes], float] = {}

    def living(self, known: Iterable[tuple[str, bytes]], now_s: float) -> int:
        """Return how many live for certain, of the node names and endpoints that are known now."""
        self._since_s = {each: self._since_s.get(each, now_s) for each in known}
        lasting = Counter(name for (name, _), since_s in self._since_s.items() if now_s - since_s > FORGOTTEN_S)
        names = {name for name, _ in self._since_s}
        named = {name for name in names if not name.endswith(UNKNOWN)}
        certain = sum(max(1, lasting[name]) for name in named) + sum(lasting[name] for name in names - named)
        return max(certain, min(1, len(names)))

# SPDX-License-Identifier: Apache-2.0
"""The one executor of a process: serves its nodes until something holds."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Protocol, runtime_checkable

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

LONGEST_WAIT_S = 0.1
SHORTEST_WAIT_S = 1e-4


@runtime_checkable
class Ticking(Protocol):
    """A node that has something to do between messages."""

    def tick(self) -> float:
        """Do what is due; return how long nothing more will be."""
        ...


class Spinner:
    """A context in which nodes are served.

    One executor for as long as the nodes live: what a second one would find waiting it does not hear of.  Its own
    ``spin()`` is never called: in these wheels it does not end on a signal.
    """

    def __init__(self, nodes: Iterable[Node] = ()) -> None:
        self.nodes: list[Node] = []
        self._executor = EventsExecutor()
        for node in nodes:
            self.add(node)

    def add(self, node: Node) -> None:
        """Serve one more node."""
        self.nodes.append(node)
        self._executor.add_node(node)

    def remove(self, node: Node) -> None:
        """Serve a node no longer."""
        self.nodes.remove(node)
        self._executor.remove_node(node)

    def until(self, predicate: Callable[[], bool]) -> None:
        """Serve the nodes until the predicate holds or rclpy is shut down."""
        ticking = [node for node in self.nodes if isinstance(node, Ticking)]
        running, spin_once = rclpy.get_default_context().ok, self._executor.spin_once
        while running() and not predicate():
            wait_s = LONGEST_WAIT_S
            for node in ticking:
                wait_s = min(wait_s, node.tick())
            spin_once(timeout_sec=max(wait_s, SHORTEST_WAIT_S))

    def __enter__(self) -> Spinner:
        gc.freeze()  # what is loaded by now stays; to search it for garbage again and again halts a run for 0.15 s
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for node in list(self.nodes):
            self.remove(node)
        self._executor.shutdown()
        gc.unfreeze()

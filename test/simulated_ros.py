# SPDX-License-Identifier: Apache-2.0
"""Nodes as they are, on a middleware and a clock that a seed decides: what is late, doubled, overtaken or gone.

Nothing of a node is replaced but what it gets from rclpy: publishers, subscriptions, timers and the steady clock.  A
seed and its number of schedules give the same run again.
"""

from __future__ import annotations

import heapq
import inspect
import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.signals import SignalHandlerOptions

from mech_twin.nodes.exchange.direct_exchange import HandOver

LONG, DOUBLED, OVERTAKES = 0.03, 0.03, 0.05  # shares of messages
SHORT_S, LONG_S = 1e-3, 1.5


class Ended:
    """What a node made and has let go, in words that rclpy uses."""

    alive = True

    @property
    def handle(self) -> Any:
        return self

    def destroy(self) -> None:
        self.alive = False


class Publisher(Ended):
    def __init__(self, network: Network, node: Node, kind: Any, topic: str, latched: bool) -> None:
        self.network, self.node, self.kind, self.topic, self.latched = network, node, kind, topic, latched
        self.last: Any = None
        self.sent = 0

    def get_subscription_count(self) -> int:
        return sum(each.alive for each in self.network.subscriptions.get(self.topic, ()))

    def publish(self, message: Any) -> None:
        if self.alive:
            self.last = message
            self.sent += 1
            self.network.publish(self, message)


class Subscription(Ended):
    def __init__(self, network: Network, node: Node, kind: Any, topic: str, call: Any, raw: bool) -> None:
        self.network, self.node, self.kind, self.topic, self.call, self.raw = network, node, kind, topic, call, raw
        self.latest_s: dict[int, float] = {}
        try:
            inspect.signature(call).bind(object())  # as rclpy asks
        except TypeError:
            self.with_info = True
        else:
            self.with_info = False

    def get_publisher_count(self) -> int:
        return sum(each.alive for each in self.network.publishers.get(self.topic, ()))

    def take(self, message: Any, number: int) -> None:
        if not self.alive:
            return
        if isinstance(message, bytes) and not self.raw:
            message = deserialize_message(message, self.kind)
        elif self.raw and not isinstance(message, bytes):
            message = serialize_message(message)
        if self.with_info:
            self.call(message, {"publication_sequence_number": number})
        else:
            self.call(message)


class Timer(Ended):
    def __init__(self, network: Network, node: Node, period_s: float, call: Callable[[], None]) -> None:
        self.network, self.node, self.period_s, self.call = network, node, period_s, call
        self.running = True
        self._arm()

    def _arm(self) -> None:
        self.network.at(self.network.now_s + self.period_s, self._due)

    def _due(self) -> None:
        if self.alive and self.running:
            self._arm()
            self.call()

    def is_canceled(self) -> bool:
        return not self.running

    def cancel(self) -> None:
        self.running = False

    def reset(self) -> None:
        if not self.running:
            self.running = True
            self._arm()


class Network:
    """Topics, the events that are to come, and the steps that are handed over."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.now_s = 1000.0
        self.hand_over = HandOver()
        self.publishers: dict[str, list[Publisher]] = {}
        self.subscriptions: dict[str, list[Subscription]] = {}
        self._made: dict[Node, list[Ended]] = {}
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = count()

    def at(self, time_s: float, call: Callable[[], None]) -> None:
        """Do something at a time."""
        heapq.heappush(self._events, (time_s, next(self._numbers), call))

    def publish(self, publisher: Publisher, message: Any) -> None:
        """Send a message on its way to each subscription, once or twice, soon or late."""
        for subscription in self.subscriptions.get(publisher.topic, ()):
            for _ in range(1 + (self.random.random() < DOUBLED)):
                self._send(publisher, subscription, message)

    def _send(self, publisher: Publisher, subscription: Subscription, message: Any) -> None:
        longest_s = LONG_S if self.random.random() < LONG else SHORT_S
        due_s = self.now_s + self.random.random() * longest_s
        if self.random.random() >= OVERTAKES:
            due_s = max(due_s, subscription.latest_s.get(id(publisher), 0.0))
            subscription.latest_s[id(publisher)] = due_s
        number = publisher.sent
        self.at(due_s, lambda: subscription.take(message, number))

    def turn(self) -> None:
        """Let happen what is next: a step that is handed over, or the earliest event."""
        waiting = self.hand_over.waiting
        if waiting and (self.random.random() < 0.5 or self._events[0][0] > self.now_s):
            self.hand_over.deliver()
            return
        time_s, _, call = heapq.heappop(self._events)
        self.now_s = max(self.now_s, time_s)
        call()

    def end(self, node: Any) -> None:
        """Take a node away without a word; what its process held open, the kernel closes."""
        node.get_logger().set_level(LoggingSeverity.UNSET)  # the level outlives the node, by its name
        node.close()
        node.leave()
        for made in self._made.pop(node, ()):
            made.destroy()
        for table in (self.publishers, self.subscriptions):
            for topic, known in table.items():
                table[topic] = [each for each in known if each.alive]  # type: ignore[assignment]
        node.destroy_node()

    # -- what rclpy gives a node ---------------------------------------------------------------------------------------

    def create_publisher(self, node: Node, kind: Any, topic: str, qos: Any, **_: Any) -> Publisher:
        latched = getattr(qos, "durability", None) == DurabilityPolicy.TRANSIENT_LOCAL
        made = Publisher(self, node, kind, node.resolve_topic_name(topic), latched)
        self.publishers.setdefault(made.topic, []).append(made)
        self._made.setdefault(node, []).append(made)
        return made

    def create_subscription(
        self, node: Node, kind: Any, topic: str, call: Any, qos: Any, *, raw: bool = False, **_: Any
    ) -> Subscription:
        made = Subscription(self, node, kind, node.resolve_topic_name(topic), call, raw)
        self.subscriptions.setdefault(made.topic, []).append(made)
        self._made.setdefault(node, []).append(made)
        if getattr(qos, "durability", None) == DurabilityPolicy.TRANSIENT_LOCAL:
            for publisher in self.publishers.get(made.topic, ()):
                if publisher.latched and publisher.last is not None:
                    self._send(publisher, made, publisher.last)
        return made

    def create_timer(self, node: Node, period_s: float, call: Callable[[], None], **_: Any) -> Timer:
        made = Timer(self, node, period_s, call)
        self._made.setdefault(node, []).append(made)
        return made

    def create_service(self, node: Node, *_: Any, **__: Any) -> SimpleNamespace:
        """Return a service that nobody calls."""
        return SimpleNamespace(send_response=None)

    def count_publishers(self, node: Node, topic: str) -> int:
        return len(self.publishers.get(node.resolve_topic_name(topic), ()))


@contextmanager
def simulated_ros(seed: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Network]:
    """Provide a middleware and a clock that a seed decides, to all nodes made meanwhile."""
    network = Network(seed)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    with monkeypatch.context() as patch:
        for name in ("create_publisher", "create_subscription", "create_timer", "create_service", "count_publishers"):
            made = getattr(network, name)
            patch.setattr(Node, name, lambda node, *args, made=made, **named: made(node, *args, **named))
        patch.setattr(time, "monotonic", lambda: network.now_s)
        try:
            yield network
        finally:
            for node in [*network._made]:
                network.end(node)
            rclpy.try_shutdown()

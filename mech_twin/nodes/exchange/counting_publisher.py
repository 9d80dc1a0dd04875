# SPDX-License-Identifier: Apache-2.0
"""A publisher that counts what it sent and knows who must listen."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message

from mech_twin.messages.peak_hold import PeakHoldWindow
from mech_twin.messages.stream_window import StreamWindow
from mech_twin.messages.topics import Topic
from mech_twin.nodes.exchange.hand_over import HandedBytes, HandedStep, StepChannel
from mech_twin.samples import Sample


class CountingPublisher:
    """One topic a node publishes.

    A message that nobody listens to is counted and not handed to the middleware, except where it is kept for who comes
    later.  What is not kept is handed as bytes to listeners served by the same executor, and published for others only.

    Parameters
    ----------
    node : Node
        The publishing node.
    topic : Topic
        What is published.
    listeners : int
        Subscribers that must be matched before the first message, so that none is missed.
    on_incompatible : callable, optional
        Told when a subscriber asks for a quality of service that is not offered.
    """

    exclusive = False  # whether nobody else may publish on the topic

    def __init__(
        self, node: Node, topic: Topic, listeners: int, on_incompatible: Callable[[Any], None] | None = None
    ) -> None:
        self.name = topic.name
        self.listeners = listeners
        self.sent = 0
        self._kept = topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        callbacks = PublisherEventCallbacks(incompatible_qos=on_incompatible)
        self._publisher = node.create_publisher(topic.type, topic.name, topic.qos, event_callbacks=callbacks)
        self._count: Callable[[], int] = self._publisher.handle.get_subscription_count
        self._channel = StepChannel()

    @property
    def matched(self) -> bool:
        """Whether all expected subscribers are there."""
        return self._count() >= self.listeners

    @property
    def heard(self) -> bool:
        """Whether somebody listens, or what is sent is kept for who comes later."""
        return self._kept or self._count() > 0

    def send(self, message: Any) -> None:
        """Publish a message, or the bytes of one."""
        self.sent += 1
        self._pass_on(message)

    def send_made(self, make: Callable[[], Any]) -> None:
        """Publish what a call returns, which is made only if somebody listens."""
        self.sent += 1
        if self.heard:
            self._pass_on(make())

    def _pass_on(self, message: Any) -> None:
        if self._kept:
            self._publisher.publish(message)
        elif isinstance(message, bytes):
            self._channel.send(HandedBytes(message), self._count, self._publisher.publish)
        elif self.heard:
            self._channel.send(HandedBytes(serialize_message(message)), self._count, self._publisher.publish)

    def join(self, channel: StepChannel) -> None:
        """Send to the listeners of a channel by hand from now on."""
        channel.senders += 1
        self._channel = channel

    def leave(self) -> None:
        """Send to nobody by hand."""
        self._channel.left()
        self._channel = StepChannel()

    def flush(self) -> None:
        """Publish what is held back, where anything is."""

    def withdraw(self, node: Node) -> None:
        """Leave the topic to others."""
        node.destroy_publisher(self._publisher)


class StepPublisher(CountingPublisher):
    """A topic of step messages: objects for listeners served by the same executor, bytes for those elsewhere."""

    exclusive = True

    def send(self, message: HandedStep) -> None:
        """Hand a step over, and publish its bytes where somebody elsewhere listens."""
        self.sent += 1
        self._channel.send(message, self._count, self._publisher.publish)


class JointStatePublisher(CountingPublisher):
    """A decimated topic of joint states; see `StreamWindow` for which samples go out.

    Parameters
    ----------
    window : int
        Steps per message where nothing strikes.
    message : callable
        Returns the bytes of the joint state of a sample.
    """

    exclusive = True

    def __init__(
        self,
        node: Node,
        topic: Topic,
        listeners: int,
        window: int,
        message: Callable[[Any], bytes],
        on_incompatible: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__(node, topic, listeners, on_incompatible)
        self._window = StreamWindow[Any](window)
        self._message = message

    def offer(self, sample: Sample, impact: bool, magnitude: float = 0.0) -> None:
        """Take the sample of a step into account, and publish what goes out."""
        self._send_all(self._window.offer(sample.step, sample, magnitude, impact))

    def flush(self) -> None:
        """Publish what the window holds so far."""
        self._send_all(self._window.rest())

    def _send_all(self, due: Iterable[Any]) -> None:
        for sample in due:
            self.send_made(partial(self._message, sample))


class PeakHoldPublisher(CountingPublisher):
    """A decimated topic: of each window the message of greatest magnitude goes out, so that spikes survive.

    Parameters
    ----------
    window : int
        Steps per message.
    message : callable
        Returns the message of what was offered.
    """

    def __init__(
        self,
        node: Node,
        topic: Topic,
        listeners: int,
        window: int,
        message: Callable[[Any], Any],
        on_incompatible: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__(node, topic, listeners, on_incompatible)
        self._window = PeakHoldWindow[Any](window)
        self._message = message

    def offer(self, magnitude: float, sample: Any) -> None:
        """Take one step into account; the message of its sample goes out if it turns out to be the extreme."""
        kept = self._window.offer(magnitude, sample)
        if kept is not None:
            self.send_made(lambda: self._message(kept))

    def flush(self) -> None:
        """Publish what the window holds so far."""
        kept = self._window.rest()
        if kept is not None:
            self.send_made(lambda: self._message(kept))

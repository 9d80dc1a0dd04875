# SPDX-License-Identifier: Apache-2.0
"""A replayed topic's publisher: counts, and gives listeners the time to take what they must not miss."""

from __future__ import annotations

import time

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher

from mech_twin.nodes.replay_source import PlayedTopic

ACKNOWLEDGED_LIMIT_S = 0.1
IMPATIENCE_S = 1.0


class ReplayPublisher:
    """One topic going out.

    Parameters
    ----------
    node : Node
        The publishing node.
    topic : PlayedTopic
        Its name, type and recorded quality of service.
    """

    def __init__(self, node: Node, topic: PlayedTopic) -> None:
        self.topic = topic
        self.published = 0
        self.refused = 0
        self._node = node
        self._under_way = 0
        self._impatient_until_s = 0.0
        self._publisher = self._made()

    def matched(self, listeners: int) -> bool:
        """Whether everybody known to listen is connected, and at least so many."""
        known = self._node.count_subscribers(self.topic.name)
        return bool(self._publisher.get_subscription_count() >= max(listeners, known))

    def send(self, raw: bytes) -> None:
        """Publish; at half the history's depth wait for listeners, whose messages would be overwritten."""
        try:
            self._publisher.publish(raw)
        except RuntimeError as error:  # what rmw raises, such as on a full keep-all history
            self.refused += 1
            self._node.get_logger().warning(f"{self.topic.name}: not published: {error}", throttle_duration_sec=1.0)
            return
        self.published += 1
        self._under_way += 1
        if self._under_way * 2 >= max(self.topic.qos.depth, 1):
            self._under_way = 0
            if time.monotonic() >= self._impatient_until_s and not self.arrived(ACKNOWLEDGED_LIMIT_S):
                self._impatient_until_s = time.monotonic() + IMPATIENCE_S

    def arrived(self, limit_s: float) -> bool:
        """Wait within a limit for what was published to arrive; return whether it has."""
        return bool(self._publisher.wait_for_all_acked(Duration(seconds=max(0.0, limit_s))))

    def forget(self) -> None:
        """Drop what is held for late listeners."""
        self._node.destroy_publisher(self._publisher)
        self._publisher = self._made()

    def _made(self) -> Publisher:
        return self._node.create_publisher(self.topic.kind, self.topic.name, self.topic.qos)

# SPDX-License-Identifier: Apache-2.0
"""Refuses to start beside a living publisher of the same step messages.

A name on the graph alone proves nothing: what was killed stays there for the lease of the middleware (20 s).  So a
publisher counts as living if a step message of it arrives, or a diagnostics status of its node; a node of the twin
sends one each second, and a run that waits repeats its step ten times a second.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from types import TracebackType

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental.events_executor import EventsExecutor
from sensor_msgs.msg import JointState

from mech_twin.messages.topics import DATA, DIAGNOSTICS
from mech_twin.nodes.errors import NameInUseError

DISCOVERY_S = 3.0  # usually a tenth of a second, sometimes 2.6 s
PROOF_S = 1.5  # more than the window of the diagnostics
TURN_S = 0.02


class NameGuard:
    """Listens from the moment it is made; what its process builds meanwhile is no time lost.

    Parameters
    ----------
    topics : sequence of str
        Full names of the topics of step messages this process is going to publish.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = tuple(topics)
        self._born_s = time.monotonic()
        self._heard: str | None = None
        # its own name, whatever the namespace and name rules of the process are
        self._node = rclpy.create_node("name_guard", use_global_arguments=False, enable_rosout=False)
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        for name in self._topics:
            self._node.create_subscription(JointState, name, partial(self._on_step, name), DATA, raw=True)
        self._node.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, DATA)

    def check(self, own_publishers: int = 0) -> None:
        """Wait until nobody has been found for long enough; nodes of this process must not be served meanwhile.

        Parameters
        ----------
        own_publishers : int
            How many publishers each topic has in this process by now.

        Raises
        ------
        NameInUseError
            If somebody lives on one of the topics.
        """
        self._serve_until(self._born_s + DISCOVERY_S)
        if any(self._node.count_publishers(name) > own_publishers for name in self._topics):
            self._serve_until(time.monotonic() + PROOF_S)
        if self._heard is not None:
            raise NameInUseError(
                f"{self._heard} is published already, by a run or a replay that is alive; "
                "use another ROS_DOMAIN_ID or --namespace"
            )

    def _serve_until(self, end_s: float) -> None:
        while self._heard is None and rclpy.ok() and time.monotonic() < end_s:
            self._executor.spin_once(timeout_sec=TURN_S)

    def _on_step(self, name: str, raw: bytes) -> None:
        self._heard = self._heard or name

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        alive = {status.name for status in message.status}
        for name in self._topics:
            for endpoint in self._node.get_publishers_info_by_topic(name):
                if f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}" in alive:
                    self._heard = self._heard or name

    def __enter__(self) -> NameGuard:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        self._node.destroy_node()

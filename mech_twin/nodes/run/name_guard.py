# SPDX-License-Identifier: Apache-2.0
"""Prevents a start while another live node publishes the same step messages.

A name in the ROS graph alone proves nothing: a killed node stays there for the lease of the middleware (20 s).  So a
publisher counts as alive if one of its step messages arrives, or a diagnostics status of its node.  A node of the twin
sends a status every second, and a waiting run repeats its step ten times a second.

Of several processes that start at the same time, none publishes yet.  So each claims its topics for its lifetime.  On
one host the kernel keeps the claims: they are visible at once, and end with the process in any case.  Across hosts each
process publishes its claim with its starting time, and stops if it receives an older claim to one of its topics.
"""

import os
import secrets
import time
from collections.abc import Sequence
from functools import partial

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental.events_executor import EventsExecutor
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.messages.topics import DATA, DIAGNOSTICS, EVERY_LATCHED, LATCHED
from mech_twin.nodes.exchange.peers import HostClaims, other_publishers
from mech_twin.nodes.run.domain import DISCOVERY, THIS_HOST, NameInUseError
from mech_twin.process.closing import Closing

DISCOVERY_S = 3.5  # usually 0.1 s; if that fails, discovery takes until the next announcement, sent every 3 s
ON_THIS_HOST_S = 0.7  # the same if only publishers of users' own programs on this host can be undiscovered
PROOF_S = 1.5  # longer than the window of the diagnostics
TURN_S = 0.02
CLAIMS = "/_mech_twin/claims"  # starting time and full topic names; hidden from the usual lists
LONGEST_CLAIM = 10_000


def discovery_s() -> float:
    """Return the longest time (s) in which a publisher without a claim on this host may stay undiscovered."""
    alone = os.environ.get(DISCOVERY) == THIS_HOST and not os.environ.get("ROS_STATIC_PEERS")
    return ON_THIS_HOST_S if alone else DISCOVERY_S


class NameGuard(Closing):
    """Listens from its creation until it has checked, and claims its topics until it is closed.

    Its process can build nodes in the meantime.

    Parameters
    ----------
    topics : sequence of str
        Full names of the topics of step messages this process is going to publish.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = tuple(topics)
        self._born_s = time.monotonic()
        self._on_host = HostClaims(self._topics)
        self._conflict = self._on_host.holder
        # all processes of a host share the steady clock; between two hosts the order of claims is arbitrary
        self._claim = f"{time.monotonic_ns():020d}-{secrets.token_hex(8)}"
        # a fixed name, unaffected by the remapping rules of the process
        self._node = rclpy.create_node(
            f"_name_guard_{secrets.token_hex(4)}",
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._claims = self._node.create_publisher(String, CLAIMS, LATCHED)
        self._claims.publish(String(data=" ".join((self._claim, *self._topics))))
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        listen = self._node.create_subscription
        self._listening = [
            *(listen(JointState, name, partial(self._on_step, name), DATA, raw=True) for name in self._topics),
            listen(DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, DATA),
            listen(String, CLAIMS, self._on_claim, EVERY_LATCHED),
        ]

    def check(self, own_publishers: int = 0) -> None:
        """Wait until no other publisher is found within the discovery time; do not serve nodes of this process then.

        Parameters
        ----------
        own_publishers : int
            Present number of publishers of each topic in this process.

        Raises
        ------
        NameInUseError
            If another publisher on one of the topics is alive, or claimed it earlier.
        """
        self._serve_until(self._born_s + discovery_s())
        if any(self._node.count_publishers(name) > own_publishers for name in self._topics):
            self._serve_until(time.monotonic() + PROOF_S)
        if self._conflict:
            raise NameInUseError(f"{self._conflict}; use another ROS_DOMAIN_ID or --namespace")
        self._listen_no_more()

    def _listen_no_more(self) -> None:
        """Stop listening but keep the claim: an idle executor delayed the first step of the run by 0.1 s."""
        if not self._listening:
            return
        while self._listening:
            self._node.destroy_subscription(self._listening.pop())
        self._executor.remove_node(self._node)
        self._executor.shutdown()

    def _serve_until(self, end_s: float) -> None:
        while not self._conflict and rclpy.ok() and time.monotonic() < end_s:
            self._executor.spin_once(timeout_sec=TURN_S)

    def _on_step(self, name: str, raw: bytes) -> None:
        self._conflict = self._conflict or _published(name)

    def _on_claim(self, message: String) -> None:
        claim, *topics = message.data[:LONGEST_CLAIM].split(" ")
        taken = next((name for name in self._topics if name in topics), None)
        if taken is not None and claim < self._claim:
            self._conflict = self._conflict or f"{taken} is claimed by an earlier start, {self._claimants()}"

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        alive = {status.name for status in message.status}
        for name in self._topics:
            if other_publishers(self._node, name) & alive:
                self._conflict = self._conflict or _published(name)

    def _claimants(self) -> str:
        """Return the other nodes that publish claims; the middleware does not reveal which one sent a message."""
        others = sorted(other_publishers(self._node, CLAIMS))
        return f"of node {' or '.join(others)}" if others else "of a node that has gone"

    def close(self) -> None:
        """Release the claims."""
        self._listen_no_more()
        self._node.destroy_node()
        self._on_host.close()


def _published(name: str) -> str:
    return f"{name} is published already, by a run or a replay that is alive"

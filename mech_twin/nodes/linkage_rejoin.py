# SPDX-License-Identifier: Apache-2.0
"""The linkage's part in coming back and in letting others come back, on the topics ``rejoin`` and ``rejoin/*``."""

from __future__ import annotations

from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.messages import body as body_messages
from mech_twin.messages import linkage as linkage_messages
from mech_twin.messages.step_message import MessageError
from mech_twin.messages.topics import REJOIN, REJOIN_BODY, REJOIN_DESCRIPTION, REJOIN_LINKAGE, REJOIN_MOTOR
from mech_twin.nodes.rejoin import RejoinRequest
from mech_twin.nodes.role_node import RoleNode
from mech_twin.parameters.load import description
from mech_twin.samples import BodySample


class LinkageRejoin:
    """Asks the peers where the run is, and answers a motor or a body that asks.

    Parameters
    ----------
    node : RoleNode
        The linkage's node.
    """

    def __init__(self, node: RoleNode) -> None:
        self.request = RejoinRequest(node.options.discovery_limit_s)
        self.last_motor: JointState | bytes = JointState()
        self.last_body: BodySample | None = None
        self._node = node
        self._ask = node.output(REJOIN, recorded=False)
        self._body = node.output(REJOIN_BODY, recorded=False)
        self._motor = node.output(REJOIN_MOTOR, recorded=False)
        node.subscribe(REJOIN, self._on_request)
        node.subscribe(REJOIN_LINKAGE, self._on_linkage)
        node.subscribe(REJOIN_DESCRIPTION, self._on_description)

    def settled(self, now_s: float) -> bool:
        """Ask where the run is; return whether that is answered, or nobody will."""
        if self.request.due(now_s):
            self._ask.send(String(data="linkage"))
        return self.request.settled(now_s, self._node.count_publishers(REJOIN_LINKAGE.name) > 0)

    def _on_linkage(self, message: JointState) -> None:
        if not self.request.open:
            return
        try:
            self.request.answer_linkage(linkage_messages.from_message(message) if message.name else None)
        except MessageError as error:
            self._node.statistics.count(REJOIN_LINKAGE.name, "malformed", str(error))

    def _on_description(self, message: String) -> None:
        if not self.request.open:
            return
        try:
            described = description(message.data) if message.data else None
        except ConfigurationError as error:
            self._node.statistics.count(REJOIN_DESCRIPTION.name, "malformed", str(error))
            return
        if described is None or described.machine == self._node.machine.name:
            self.request.answer_description(described)

    def _on_request(self, message: String) -> None:
        if message.data == "body" and self.last_body is not None:
            self._body.send(body_messages.to_message(self.last_body))
        elif message.data == "motor" and not self.request.open:
            self._motor.send(self.last_motor)

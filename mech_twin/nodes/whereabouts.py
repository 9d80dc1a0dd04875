"""Where everybody was: the linkage asks when it begins, and tells a motor or a body that comes back."""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.messages import body as body_messages
from mech_twin.messages import linkage as linkage_messages
from mech_twin.messages.rows import MessageError
from mech_twin.messages.topics import (
    RECALL,
    RECALLED_BODY,
    RECALLED_DESCRIPTION,
    RECALLED_LINKAGE,
    RECALLED_MOTOR,
)
from mech_twin.nodes.role_node import ASK_AGAIN_S, RoleNode
from mech_twin.parameters.load import Description, description
from mech_twin.samples import BodySample, LinkageSample

RECALL_LIMIT_S = 1.0
ANSWERS = 2


class Whereabouts:
    """The linkage's part in coming back and letting others come back.

    Parameters
    ----------
    node : RoleNode
        The linkage's node.
    """

    def __init__(self, node: RoleNode) -> None:
        self.asking = True
        self.last_motor: JointState | bytes = JointState()
        self.last_body: BodySample | None = None
        self._node = node
        self._answers: dict[str, Any] = {}
        self._begun: float | None = None
        self._asked = 0.0
        self._recall = node.outlet(RECALL)
        self._recalled_body = node.outlet(RECALLED_BODY)
        self._recalled_motor = node.outlet(RECALLED_MOTOR)
        for outlet in (self._recall, self._recalled_body, self._recalled_motor):
            outlet.listeners = 0
        node.hear(RECALL, self._on_recall)
        node.hear(RECALLED_LINKAGE, self._on_linkage)
        node.hear(RECALLED_DESCRIPTION, self._on_description)

    @property
    def linkage(self) -> LinkageSample | None:
        """The sample to go on from, if somebody had one."""
        return self._answers.get("linkage")

    @property
    def described(self) -> Description | None:
        """The configuration that was in force, if somebody had one."""
        return self._answers.get("description")

    def known(self, now: float) -> bool:
        """Ask where the linkage was; return whether that is answered, or nobody will."""
        self._begun = now if self._begun is None else self._begun
        if now - self._asked > ASK_AGAIN_S:
            self._asked = now
            self._recall.send(String(data="linkage"))
        somebody_knows = self._node.count_publishers(RECALLED_LINKAGE.name) > 0
        limit = self._node.options.discovery_limit_s if somebody_knows else RECALL_LIMIT_S
        return len(self._answers) == ANSWERS or now - self._begun > limit

    def begin(self) -> None:
        """Stop asking; say so where the run goes on from a known step."""
        self.asking = False
        if self.linkage is not None:
            self._node.get_logger().info(f"going on at step {self.linkage.step}")

    def _on_linkage(self, message: JointState) -> None:
        if not self.asking:
            return
        try:
            self._answers["linkage"] = linkage_messages.from_message(message) if message.name else None
        except MessageError as error:
            self._node.ledger.count(RECALLED_LINKAGE.name, "malformed", str(error))

    def _on_description(self, message: String) -> None:
        if not self.asking:
            return
        try:
            described = description(message.data) if message.data else None
        except ConfigurationError as error:
            self._node.ledger.count(RECALLED_DESCRIPTION.name, "malformed", str(error))
            return
        if described is None or described.machine == self._node.machine.name:
            self._answers["description"] = described

    def _on_recall(self, message: String) -> None:
        if message.data == "body" and self.last_body is not None:
            self._recalled_body.send(body_messages.to_message(self.last_body))
        elif message.data == "motor" and not self.asking:
            self._recalled_motor.send(self.last_motor)

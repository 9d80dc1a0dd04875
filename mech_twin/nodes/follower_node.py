"""A role node that answers a step message with a step message: motor, force analysis and body."""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import JointState

from mech_twin.messages.rows import MessageError, revision
from mech_twin.messages.topics import Topic
from mech_twin.nodes.ledger import Sequence
from mech_twin.nodes.role_node import RETRY_S, RoleNode


class FollowerNode(RoleNode):
    """Answers each step once; a step asked again (a peer came back) is answered again with the same sample."""

    def listen(self, topic: Topic) -> None:
        """Subscribe to the step message that is answered."""
        self._sequence = Sequence(topic.name, self.ledger)
        self._topic = topic
        self._last_question: Any = None
        self._held: JointState | None = None
        self.follow_description()
        self.create_subscription(topic.type, topic.name, self._on_question, topic.qos)
        self._patience = self.create_timer(RETRY_S, self._retry)
        self._patience.cancel()

    def decoded(self, message: JointState) -> Any:
        """Return the sample asked about."""
        raise NotImplementedError

    def answer(self, question: Any) -> bool:
        """Answer a new step; return False if that is not possible yet."""
        raise NotImplementedError

    def repeat(self) -> None:
        """Send the last answer again."""
        raise NotImplementedError

    def _retry(self) -> None:
        held = self._held
        if held is not None and self.matched:
            self._patience.cancel()
            self._on_question(held)

    def _hold(self, message: JointState) -> None:
        self._held = message
        self._patience.reset()

    def _on_question(self, message: JointState) -> None:
        self._held = None
        if not self.matched and self._sequence.last is None:
            self._hold(message)
            return
        if not self.at_revision(revision(message), lambda: self._on_question(message)):
            return
        try:
            sample = self.decoded(message)
        except MessageError as error:
            self.ledger.count(self._topic.name, "malformed", str(error))
            return
        if sample.step == self._sequence.last:
            self._on_same_step(sample)
            return
        if self._sequence.last is not None and sample.step < self._sequence.last:
            self._sequence.accepts(sample.step)
            return
        if not self.answer(sample):
            self._hold(message)
            return
        self._sequence.accepts(sample.step)
        self._last_question = sample
        self.time_s = sample.time_s
        self.health.state = "running"

    def _on_same_step(self, sample: Any) -> None:
        if sample == self._last_question:
            self.ledger.count(self._topic.name, "repeated", f"step {sample.step} asked again")
            self.repeat()
        else:
            self.ledger.count(self._topic.name, "foreign", f"another sample of step {sample.step}")

"""A role node that answers a step message with a step message: motor, force analysis and body."""

from __future__ import annotations

import time
from typing import Any

from sensor_msgs.msg import JointState

from mech_twin.messages.rows import MessageError, revision
from mech_twin.messages.topics import Topic
from mech_twin.nodes.ledger import Sequence
from mech_twin.nodes.role_node import RETRY_S, RoleNode


class FollowerNode(RoleNode):
    """Answers each step once; a step asked again (a peer came back) is answered again with the same sample."""

    def listen(self, topic: Topic) -> None:
        """Subscribe to the step message that is answered, once those who need the answers are there."""
        self._sequence = Sequence(topic.name, self.ledger)
        self._topic = topic
        self._last_question: Any = None
        self._held: JointState | None = None
        self._born = time.monotonic()
        self._listening = False
        self.follow_description()
        self._patience = self.create_timer(RETRY_S, self._retry)

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
        if not self._listening:
            self._listen_when_heard()
        elif self._held is not None:
            self._on_question(self._held)
        else:
            self._patience.cancel()

    def _listen_when_heard(self) -> None:
        """Subscribe; a linkage that sees the subscription may count on the answers being heard."""
        if self.matched or time.monotonic() - self._born > self.options.discovery_limit_s:
            self._listening = True
            self.create_subscription(self._topic.type, self._topic.name, self._on_question, self._topic.qos)

    def _hold(self, message: JointState) -> None:
        self._held = message
        self._patience.reset()

    def _on_question(self, message: JointState) -> None:
        self._held = None
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

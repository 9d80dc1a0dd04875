"""A role node that answers a step message with a step message: motor, force analysis and body."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.messages.rows import MessageError, revision
from mech_twin.messages.topics import RECALL, REWIND, Topic
from mech_twin.nodes.role_node import RETRY_S, RoleNode

REMEMBERED_STEPS = 4


class Exchange(NamedTuple):
    """A question and its answer; the question is None where the answer was recalled from a peer."""

    question: Any
    answer: Any


class FollowerNode(RoleNode):
    """Answers each step once; a step asked again (a peer came back) is answered again with the same sample."""

    def listen(self, topic: Topic) -> None:
        """Subscribe to the step message that is answered, once those who need the answers are there."""
        self._topic = topic
        self._exchanges: dict[int, Exchange] = {}
        self.last_message: JointState | None = None
        self._held: JointState | None = None
        self._born = time.monotonic()
        self._listening = False
        self.follow_description()
        self.create_subscription(String, RECALL.name, self._on_recall, RECALL.qos)
        self._patience = self.create_timer(RETRY_S, self._retry)

    # -- what a follower is -----------------------------------------------------------------------------------------

    def decoded(self, message: JointState) -> Any:
        """Return the sample asked about."""
        raise NotImplementedError

    def answer(self, question: Any, previous: Any) -> Any:
        """Return the answer to a new step, or None if it cannot be given yet; ``previous`` is the last step's."""
        raise NotImplementedError

    def send(self, answer: Any) -> None:
        """Publish an answer."""
        raise NotImplementedError

    def recall(self, who: str) -> None:
        """Tell a peer that came back where it was."""

    # -- questions --------------------------------------------------------------------------------------------------

    @property
    def last_step(self) -> int | None:
        """The newest step answered."""
        return max(self._exchanges) if self._exchanges else None

    def remember(self, step: int, exchange: Exchange) -> None:
        """Keep an exchange, and forget old ones."""
        self._exchanges[step] = exchange
        for old in [known for known in self._exchanges if known <= step - REMEMBERED_STEPS]:
            del self._exchanges[old]

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

    def _on_question(self, message: JointState) -> None:
        self._held = None
        if not self.at_revision(revision(message), lambda: self._on_question(message)):
            return
        try:
            question = self.decoded(message)
        except MessageError as error:
            self.ledger.count(self._topic.name, "malformed", str(error))
            return
        last = self.last_step
        if last is not None and question.step <= last:
            self._on_old_step(question, last)
        else:
            self._on_new_step(question, message, last)

    def _on_new_step(self, question: Any, message: JointState, last: int | None) -> None:
        previous = self._exchanges.get(question.step - 1)
        answer = self.answer(question, None if previous is None else previous.answer)
        if answer is None:
            self._held = message
            self._patience.reset()
            return
        if last is not None and question.step > last + 1:
            self.ledger.count(
                self._topic.name, "missing", f"step {question.step} after {last}", question.step - last - 1
            )
        self.remember(question.step, Exchange(question, answer))
        self.last_message = message
        self.time_s = question.time_s
        self.health.state = "running"
        self.on_sample(answer)
        self.send(answer)

    def _on_old_step(self, question: Any, last: int) -> None:
        known = self._exchanges.get(question.step)
        if known is None:
            self.ledger.count(self._topic.name, "late", f"step {question.step} after {last}")
        elif known.question is None or known.question == question:
            self.ledger.count(self._topic.name, "repeated", f"step {question.step} asked again")
            self.send(known.answer)
        else:
            self.ledger.count(self._topic.name, "foreign", f"another sample of step {question.step}")

    def _on_recall(self, message: String) -> None:
        word, _, number = message.data.partition(" ")
        if word == REWIND and number.isdigit():
            for step in [step for step in self._exchanges if step > int(number)]:
                del self._exchanges[step]
        else:
            self.recall(word)

"""A role node that answers a step message with a step message: motor, force analysis and body."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

from std_msgs.msg import String

from mech_twin.messages.rows import MessageError, revision, source
from mech_twin.messages.topics import RECALL, Topic
from mech_twin.messages.wire import StepMessage
from mech_twin.nodes.role_node import ASK_AGAIN_S, RETRY_S, RoleNode
from mech_twin.nodes.voice import Voice

REMEMBERED_STEPS = 4


class Exchange(NamedTuple):
    """A question and its answer; the question is None where the answer was recalled from a peer."""

    question: Any
    answer: Any


class FollowerNode(RoleNode):
    """Answers each step once; a step asked again (a peer came back) is answered again with the same sample."""

    def listen(self, topic: Topic, asker: str) -> None:
        """Subscribe to the step message of the asking node, once those who need the answers are there."""
        self._topic = topic
        self._asker = asker
        self._voice = Voice()
        self._heard = time.monotonic()
        self._exchanges: dict[int, Exchange] = {}
        self.last_message: StepMessage | None = None
        self._held: tuple[Any, StepMessage] | None = None
        self._born = time.monotonic()
        self._listening = False
        self.follow_description()
        self.hear(RECALL, self._on_recall)
        self._patience = self.every(RETRY_S, self._retry)

    # -- what a follower is -----------------------------------------------------------------------------------------

    def decoded(self, message: StepMessage) -> Any:
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
            self._answer(*self._held)
        else:
            self._patience.cancel()

    def _listen_when_heard(self) -> None:
        """Subscribe; a linkage that sees the subscription may count on the answers being heard."""
        if self.matched or time.monotonic() - self._born > self.options.discovery_limit_s:
            self._listening = True
            self.hear_steps(self._topic, self._on_question)

    def _on_question(self, message: StepMessage) -> None:
        try:
            question = self.decoded(message)
        except MessageError as error:
            self.ledger.count(self._topic.name, "malformed", str(error))
            return
        if not self._speaks(question.step, source(message)):
            reason = f"step {question.step} from another publisher than the one that is followed"
            self.ledger.count(self._topic.name, "foreign", reason)
        elif self.at_revision(revision(message), lambda: self._answer(question, message)):
            self._answer(question, message)

    def _answer(self, question: Any, message: StepMessage) -> None:
        self._held = None
        last = self.last_step
        if last is not None and question.step <= last:
            self._on_old_step(question, last)
        else:
            self._on_new_step(question, message, last)

    def _speaks(self, step: int, who: float) -> bool:
        """Return whether this publisher is the one to answer; a new one is, once the one before has fallen silent."""
        now = time.monotonic()
        if not self._voice.speaks(who):
            if self._voice.known and now - self._heard <= self._silence_s:
                return False
            self._voice.follow(who)
            self._go_back_to(step)
        self._heard = now
        return True

    @property
    def _silence_s(self) -> float:
        """After how long nothing heard means that who asks is gone; one that holds asks again sooner than that."""
        return self.options.peer_timeout_s + ASK_AGAIN_S

    def _go_back_to(self, step: int) -> None:
        """Forget what came after this step: whoever asks now goes on from there, or begins a run of its own."""
        if step not in self._exchanges and step - 1 not in self._exchanges and step <= (self.last_step or 0):
            self._exchanges.clear()
        for later in [known for known in self._exchanges if known > step]:
            del self._exchanges[later]

    def attend(self, now: float) -> None:
        """Say so when nothing has been asked for longer than a peer may be silent."""
        silent = now - self._heard
        if self._voice.known and silent > self._silence_s and not self.health.state.startswith("waiting"):
            self.health.state = f"waiting for {self._asker}"
            self.ledger.count(self._topic.name, "silent", f"nothing for {silent:.1f} s after step {self.last_step}")
            self.report()

    def woken(self) -> None:
        """Measure silence from now on."""
        self._heard = time.monotonic()

    def _on_new_step(self, question: Any, message: StepMessage, last: int | None) -> None:
        previous = self._exchanges.get(question.step - 1)
        answer = self.answer(question, None if previous is None else previous.answer)
        if answer is None:
            self._held = (question, message)
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
            self.health.state = "running"
            self.send(known.answer)
        else:
            self.ledger.count(self._topic.name, "foreign", f"another sample of step {question.step}")

    def _on_recall(self, message: String) -> None:
        self.recall(message.data)

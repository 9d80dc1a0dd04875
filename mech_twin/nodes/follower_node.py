# SPDX-License-Identifier: Apache-2.0
"""A role node that answers a step message with a step message: motor, force analysis and body."""

from __future__ import annotations

import time
from typing import Any

from std_msgs.msg import String

from mech_twin.messages.joint_state_cdr import StepMessage
from mech_twin.messages.step_marks import ConfigurationMark, configuration_mark, source
from mech_twin.messages.step_message import MessageError
from mech_twin.messages.topics import DESCRIPTION, EVERY_LATCHED, REJOIN, Topic
from mech_twin.nodes.description_store import DescriptionStore
from mech_twin.nodes.exchange_memory import ExchangeMemory
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.peer_wait import ASK_AGAIN_S
from mech_twin.nodes.role_node import RETRY_S, RoleNode
from mech_twin.nodes.source_lock import Admission, SourceLock
from mech_twin.parameters.load import description
from mech_twin.quantity import Parameters


class FollowerNode(RoleNode):
    """Answers each step once; a step asked again (a peer came back) is answered again with the same sample.

    Parameters
    ----------
    questions : Topic
        Step messages that are answered.
    asker : str
        Node that publishes them.  See `TwinNode` for the other arguments.
    """

    def __init__(
        self,
        role: str,
        machine_name: str,
        parameters: Parameters | None,
        options: RunOptions | None,
        questions: Topic,
        asker: str,
    ) -> None:
        super().__init__(role, machine_name, parameters, options)
        self.exchanges: ExchangeMemory[Any, Any] = ExchangeMemory()
        self.last_message: StepMessage | None = None
        self._questions, self._asker = questions, asker
        self._lock = SourceLock()
        self._descriptions = DescriptionStore()
        self._born_s = self._heard_s = time.monotonic()
        self._listening = False
        self._unanswered: tuple[Any, StepMessage] | None = None
        # keeps all: with a depth of 1, another publisher's latched description would displace the linkage's
        self.subscribe(DESCRIPTION, self._on_description, qos=EVERY_LATCHED)
        self.subscribe(REJOIN, self._on_rejoin)
        self._retry_timer = self.every(RETRY_S, self._retry)

    @property
    def last_question(self) -> Any:
        """The newest sample answered; None before the first, and where it is known by its answer only."""
        last = self.exchanges.last_step
        exchange = None if last is None else self.exchanges.get(last)
        return None if exchange is None else exchange.question

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

    def show(self, question: Any, answer: Any) -> None:
        """Publish what a new answer means to people and other tools, each topic at its own rate."""

    def tell_peer(self, peer: str) -> None:
        """Tell a peer that came back where it was."""

    # -- questions --------------------------------------------------------------------------------------------------

    def _retry(self) -> None:
        if not self._listening:
            self._listen_when_heard()
        elif self._unanswered is not None:
            self._answer(*self._unanswered)
        else:
            self._retry_timer.cancel()

    def _listen_when_heard(self) -> None:
        """Subscribe; a linkage that sees the subscription may count on the answers being heard."""
        if self.matched or time.monotonic() - self._born_s > self.options.discovery_limit_s:
            self._listening = True
            self.subscribe_steps(self._questions, self._on_question)

    def _on_question(self, message: StepMessage) -> None:
        try:
            question = self.decoded(message)
        except MessageError as error:
            self.statistics.count(self._questions.name, "malformed", str(error))
            return
        if not self._is_followed(question.step, source(message)):
            reason = f"step {question.step} from another publisher than the one that is followed"
            self.statistics.count(self._questions.name, "unknown_source", reason)
        else:
            self._answer(question, message)

    def _is_followed(self, step: int, who: float) -> bool:
        """Return whether this publisher is the one to answer; a new one is, once the one before has fallen silent."""
        now = time.monotonic()
        if who == self._lock.source:
            self._heard_s = now
            return True
        admission = self._lock.admit(who, vacant=not self._lock.locked or now - self._heard_s > self._silence_limit_s)
        if admission is Admission.REFUSED:
            return False
        if admission is Admission.NEWLY_FOLLOWED:
            self.exchanges.return_to(step)
        self._heard_s = now
        return True

    @property
    def _silence_limit_s(self) -> float:
        """After how long nothing heard means that who asks is gone; one that waits asks again sooner than that."""
        return self.options.peer_timeout_s + ASK_AGAIN_S

    def _answer_later(self, question: Any, message: StepMessage) -> None:
        self._unanswered = (question, message)
        self._retry_timer.reset()

    def _answer(self, question: Any, message: StepMessage) -> None:
        if not self._is_configured(configuration_mark(message)):  # its description is on its way
            self._answer_later(question, message)
            return
        self._unanswered = None
        last = self.exchanges.last_step
        if last is not None and question.step <= last:
            self._on_old_step(question, last)
        else:
            self._on_new_step(question, message, last)

    def _on_new_step(self, question: Any, message: StepMessage, last: int | None) -> None:
        previous = self.exchanges.get(question.step - 1)
        answer = self.answer(question, None if previous is None else previous.answer)
        if answer is None:
            self._answer_later(question, message)
            return
        if last is not None and question.step > last + 1:
            gap = question.step - last - 1
            self.statistics.count(self._questions.name, "missing", f"step {question.step} after {last}", gap)
        self.exchanges.remember(question.step, question, answer)
        self.last_message = message
        self.time_s = question.time_s
        self.diagnostics.state = "running"
        self.send(answer)
        self.on_sample(answer)
        self.show(question, answer)

    def _on_old_step(self, question: Any, last: int) -> None:
        known = self.exchanges.get(question.step)
        if known is None:
            self.statistics.count(self._questions.name, "late", f"step {question.step} after {last}")
        elif known.question is None or known.question == question:
            self.statistics.count(self._questions.name, "repeated", f"step {question.step} asked again")
            self.diagnostics.state = "running"
            self.send(known.answer)
        else:
            self.statistics.count(self._questions.name, "conflicting", f"another sample of step {question.step}")

    # -- peers ------------------------------------------------------------------------------------------------------

    def check_peers(self, now_s: float) -> None:
        """Say so when nothing has been asked for longer than a peer may be silent."""
        silent_s = now_s - self._heard_s
        if not self._lock.locked or silent_s <= self._silence_limit_s or self.diagnostics.state.startswith("waiting"):
            return
        self.diagnostics.state = f"waiting for {self._asker}"
        reason = f"nothing for {silent_s:.1f} s after step {self.exchanges.last_step}"
        self.statistics.count(self._questions.name, "timeout", reason)
        self.report()

    def resumed(self) -> None:
        """Measure silence from now on."""
        self._heard_s = time.monotonic()

    def _on_rejoin(self, message: String) -> None:
        self.tell_peer(message.data)

    def _on_description(self, message: String) -> None:
        """Keep a configuration; it is adopted when a question of the linkage that is followed names it."""
        try:
            described = description(message.data)
        except ValueError as error:
            self.statistics.count(DESCRIPTION.name, "malformed", str(error))
            return
        if described.machine != self.machine.name:
            self.statistics.count(DESCRIPTION.name, "unknown_source", f"machine {described.machine}")
            return
        if self.revision > 0 and described.source != self.described_by:
            reason = f"revision {described.revision} of another node than the one that is followed"
            self.statistics.count(DESCRIPTION.name, "unknown_source", reason)
        self._descriptions.add(described, message.data)
        if self._unanswered is not None:
            self._answer(*self._unanswered)

    def _is_configured(self, wanted: ConfigurationMark) -> bool:
        """Adopt the configuration a question was computed with; return False while its description is not there."""
        if wanted.revision == 0 or (wanted.source == self.described_by and wanted.revision <= self.revision):
            return True
        found = self._descriptions.find(wanted)
        if found is None:
            return False
        self.use(found.content.parameters)
        self.revision, self.described_by = found.mark
        self.description = found.text
        return True

# SPDX-License-Identifier: Apache-2.0
"""A role node that answers a step message with a step message: motor, force analysis and body.

It adopts the configuration named in its questions, and answers a repeated step with the same sample.
"""

import time
from typing import Any, Generic, NamedTuple, TypeVar

from std_msgs.msg import String

from mech_twin.declarations.quantity import Parameters
from mech_twin.messages.cdr import StepMessage
from mech_twin.messages.step_message import ConfigurationMark, StepCodec
from mech_twin.messages.step_message import linkage as linkage_messages
from mech_twin.messages.topics import DESCRIPTION, EVERY_LATCHED, REJOIN, Topic
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.exchange.direct_exchange import HandedStep, Step
from mech_twin.nodes.exchange.peers import ASK_AGAIN_S, Admission, SourceLock
from mech_twin.nodes.roles.role_node import RETRY_S, RoleNode
from mech_twin.parameters.description import Description, description

REMEMBERED_SOURCES = 8


class StoredDescription(NamedTuple):
    """A configuration, decoded and as received."""

    content: Description
    text: str


class DescriptionStore:
    """The newest configuration of each of the last `REMEMBERED_SOURCES` sources."""

    def __init__(self) -> None:
        self._by_source: dict[float, StoredDescription] = {}

    def add(self, content: Description, text: str) -> None:
        """Store a description, unless its source has published a later revision."""
        known = self._by_source.pop(content.source, None)
        offered = StoredDescription(content, text)
        newest = known if known is not None and known.content.revision > content.revision else offered
        self._by_source[content.source] = newest
        while len(self._by_source) > REMEMBERED_SOURCES:
            del self._by_source[next(iter(self._by_source))]

    def find(self, wanted: ConfigurationMark) -> StoredDescription | None:
        """Return the configuration named in a question, or a later one of the same source; None if not yet received."""
        known = self._by_source.get(wanted.source)
        return known if known is not None and known.content.revision >= wanted.revision else None


REMEMBERED_STEPS = 4

Question = TypeVar("Question")
Answer = TypeVar("Answer")


class Exchange(NamedTuple, Generic[Question, Answer]):
    """A question and its answer; the question is None if the answer came from a peer after a restart."""

    question: Question | None
    answer: Answer


class ExchangeMemory(Generic[Question, Answer]):
    """Questions and answers of the newest few steps; ``last_step`` is the last one answered."""

    def __init__(self) -> None:
        self._exchanges: dict[int, Exchange[Question, Answer]] = {}
        self.last_step: int | None = None

    def get(self, step: int) -> Exchange[Question, Answer] | None:
        """Return the exchange at a step, if it is stored."""
        return self._exchanges.get(step)

    def remember(self, step: int, question: Question | None, answer: Answer) -> None:
        """Store an exchange, and drop old ones."""
        self._exchanges[step] = Exchange(question, answer)
        for old in [known for known in self._exchanges if known <= step - REMEMBERED_STEPS]:
            del self._exchanges[old]
        self.last_step = max(self._exchanges) if self.last_step is None or step < self.last_step else step

    def return_to(self, step: int) -> None:
        """Drop the exchanges after this step: the run continues from there, or a new one starts."""
        if step not in self._exchanges and step - 1 not in self._exchanges and step <= (self.last_step or 0):
            self._exchanges.clear()
        for later in [known for known in self._exchanges if known > step]:
            del self._exchanges[later]
        self.last_step = max(self._exchanges, default=None)


class FollowerNode(RoleNode):
    """Answers each step once; a repeated question (a peer was restarted) is answered with the same sample.

    Parameters
    ----------
    codec : StepCodec
        Messages of the answers.
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
        codec: StepCodec[Any],
        questions: Topic,
        asker: str,
    ) -> None:
        super().__init__(role, machine_name, parameters, options)
        self._codec = codec
        self._out = self.step_output(codec.steps, 1)
        self._states = self.joint_state_output(codec.joint_states, codec.shown)
        self.exchanges: ExchangeMemory[Any, Any] = ExchangeMemory()
        self.last_message: Step | None = None
        self._questions, self._asker = questions, asker
        self._lock = SourceLock()
        self._descriptions = DescriptionStore()
        self._linkages: set[float] = set()  # source numbers of those whose configurations were adopted
        self._born_s = self._received_s = time.monotonic()
        self._listening = False
        self._unanswered: tuple[Any, Step] | None = None
        # keeps all: with a depth of 1, another publisher's latched description would displace the linkage's
        self.subscribe(DESCRIPTION, self._on_description, qos=EVERY_LATCHED)
        self.subscribe(REJOIN, lambda message: self.tell_peer(message.data))
        self._retry_timer = self.every(RETRY_S, self._retry)

    @property
    def last_question(self) -> Any:
        """The newest sample answered; None before the first, and if only its answer is known."""
        last = self.exchanges.last_step
        exchange = None if last is None else self.exchanges.get(last)
        return None if exchange is None else exchange.question

    # -- to be defined by a subclass --------------------------------------------------------------------------------

    def decoded(self, message: StepMessage) -> Any:
        """Return the sample of a question, of the linkage if a subclass says nothing else."""
        return linkage_messages.received(message.raw, self.machine.coupling_step_s, self.machine.linkage.joints)

    def answer(self, question: Any, previous: Any) -> Any:
        """Return the answer to a new step, or None if not possible yet; ``previous`` is the last step's answer."""
        raise NotImplementedError

    def show(self, question: Any, answer: Any) -> None:
        """Publish the topics derived from a new answer, for people and other tools, each at its own rate."""

    def tell_peer(self, peer: str) -> None:
        """Send a restarted peer its last state."""

    # -- questions --------------------------------------------------------------------------------------------------

    def _retry(self) -> None:
        if not self._listening:
            self._listen_when_matched()
        elif self._unanswered is not None:
            self._answer(*self._unanswered)
        else:
            self._retry_timer.cancel()

    def _listen_when_matched(self) -> None:
        """Subscribe once the answers' subscribers are matched: the linkage relies on receiving the answers."""
        if self.matched or time.monotonic() - self._born_s > self.options.discovery_limit_s:
            self._listening = True
            self.subscribe_steps(self._questions, self.decoded, self._on_question)

    def _on_question(self, question: Any, message: Step) -> None:
        if not self._is_followed(question.step, message.source):
            reason = f"step {question.step} from another publisher than the one that is followed"
            self.statistics.count(self._questions.name, "unknown_source", reason)
        else:
            self._answer(question, message)

    def _is_followed(self, step: int, who: float) -> bool:
        """Return whether this publisher is followed; a new one is once the one before has fallen silent."""
        now = time.monotonic()
        if who == self._lock.source:
            self._received_s = now
            return True
        admission = self._lock.admit(
            who, vacant=not self._lock.locked or now - self._received_s > self._silence_limit_s
        )
        if admission is Admission.REFUSED:
            return False
        if admission is Admission.NEWLY_FOLLOWED:
            self.exchanges.return_to(step)
        self._received_s = now
        return True

    @property
    def _silence_limit_s(self) -> float:
        """Silence (s) after which the asking linkage counts as gone; a waiting one repeats its question sooner."""
        return self.options.peer_timeout_s + ASK_AGAIN_S

    def _answer_later(self, question: Any, message: Step) -> None:
        self._unanswered = (question, message)
        if self._retry_timer.is_canceled():  # a timer reset in its own callback kept the executor busy for seconds
            self._retry_timer.reset()

    def _answer(self, question: Any, message: Step) -> None:
        if not self._is_configured(message.configuration, question.step):  # its description has not arrived yet
            self._answer_later(question, message)
            return
        self._unanswered = None
        last = self.exchanges.last_step
        if last is not None and question.step <= last:
            self._on_old_step(question, last)
        else:
            self._on_new_step(question, message, last)

    def _on_new_step(self, question: Any, message: Step, last: int | None) -> None:
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

    def send(self, answer: Any) -> None:
        """Publish an answer."""
        self._out.send(HandedStep(answer, self.marks, self._codec.to_bytes))

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
        """Warn when there was no question for longer than a peer may be silent."""
        silent_s = now_s - self._received_s
        if not self._lock.locked or silent_s <= self._silence_limit_s or self.diagnostics.state.startswith("waiting"):
            return
        self.diagnostics.state = f"waiting for {self._asker}"
        reason = f"nothing for {silent_s:.1f} s after step {self.exchanges.last_step}"
        self.statistics.count(self._questions.name, "timeout", reason)
        self.report()

    def resumed(self) -> None:
        """Restart the measurement of silence."""
        self._received_s = time.monotonic()

    def _on_description(self, message: String) -> None:
        """Store a configuration; it is adopted when a question of the followed linkage names it."""
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

    def _is_configured(self, wanted: ConfigurationMark, step: int) -> bool:
        """Adopt the configuration a question was computed with; return False while its description is missing.

        That of a new linkage tells a body that the run may begin anew, for the force analysis that asks it is the same.
        """
        if wanted.revision == 0 or (wanted.source == self.described_by and wanted.revision <= self.revision):
            return True
        found = self._descriptions.find(wanted)
        if found is None:
            return False
        if found.content.source not in self._linkages:
            self._linkages.add(found.content.source)
            self.exchanges.return_to(step)
        self.use(found.content.parameters)
        self.revision, self.described_by = found.content.revision, found.content.source
        self.description = found.text
        return True

# SPDX-License-Identifier: Apache-2.0
"""The last steps a follower answered, so that one asked again is answered with the same sample.  Knows no ROS."""

from __future__ import annotations

from typing import Generic, NamedTuple, TypeVar

REMEMBERED_STEPS = 4

Question = TypeVar("Question")
Answer = TypeVar("Answer")


class Exchange(NamedTuple, Generic[Question, Answer]):
    """A question and its answer; the question is None where the answer came from a peer when the node rejoined."""

    question: Question | None
    answer: Answer


class ExchangeMemory(Generic[Question, Answer]):
    """The newest few steps, with what was asked and answered."""

    def __init__(self) -> None:
        self._exchanges: dict[int, Exchange[Question, Answer]] = {}
        self._last: int | None = None

    @property
    def last_step(self) -> int | None:
        """The newest step answered."""
        return self._last

    def get(self, step: int) -> Exchange[Question, Answer] | None:
        """Return what was exchanged at a step, if it is remembered."""
        return self._exchanges.get(step)

    def remember(self, step: int, question: Question | None, answer: Answer) -> None:
        """Keep an exchange, and forget old ones."""
        self._exchanges[step] = Exchange(question, answer)
        if self._last == step - 1:
            self._exchanges.pop(step - REMEMBERED_STEPS, None)
        else:
            for old in [known for known in self._exchanges if known <= step - REMEMBERED_STEPS]:
                del self._exchanges[old]
        self._last = max(self._exchanges) if self._last is None or step < self._last else step

    def return_to(self, step: int) -> None:
        """Forget what came after this step: whoever asks now goes on from there, or begins a run of its own."""
        if step not in self._exchanges and step - 1 not in self._exchanges and step <= (self.last_step or 0):
            self._exchanges.clear()
        for later in [known for known in self._exchanges if known > step]:
            del self._exchanges[later]
        self._last = max(self._exchanges, default=None)

# SPDX-License-Identifier: Apache-2.0
"""The answers to one step: the run goes on when every peer has given one.  Knows no ROS."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.samples import BodySample, ForceSample, MotorSample

Answer = MotorSample | ForceSample | BodySample


class AnswerFault(NamedTuple):
    """Why an answer is not used: a kind of `topic_statistics.KINDS`, and words for a person."""

    kind: str
    reason: str


class SteppingBarrier:
    """Answers of the peers to one step.

    Parameters
    ----------
    names : tuple of str
        Peers that must answer.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        self._answers: dict[str, Answer] = {}
        self._previous: dict[str, Answer] = {}

    @property
    def complete(self) -> bool:
        """Whether every peer has answered."""
        return len(self._answers) == len(self.names)

    @property
    def motor(self) -> MotorSample:
        """The motor's answer.

        Raises
        ------
        KeyError
            If it has not answered.
        """
        answer = self._answers["motor"]
        assert isinstance(answer, MotorSample)
        return answer

    @property
    def body(self) -> BodySample | None:
        """The body's answer, None where there is none."""
        answer = self._answers.get("body")
        return answer if isinstance(answer, BodySample) else None

    def missing(self) -> tuple[str, ...]:
        """Return who has not answered."""
        return tuple(name for name in self.names if name not in self._answers)

    def expect_next(self) -> None:
        """Begin a new step."""
        self._previous, self._answers = self._answers, {}

    def take(self, peer: str, sample: Answer, step: int) -> AnswerFault | None:
        """Keep a peer's answer to this step; anything else is not kept, and the reason is returned."""
        fault = self._fault(peer, sample, step)
        if fault is None:
            self._answers[peer] = sample
        return fault

    def _fault(self, peer: str, sample: Answer, step: int) -> AnswerFault | None:
        known = self._answers.get(peer) if sample.step == step else None
        if known is None and sample.step == step - 1:
            known = self._previous.get(peer)
        if known is not None and known == sample:
            return AnswerFault("repeated", f"step {sample.step}")
        if known is not None:
            return AnswerFault("conflicting", f"another answer to step {sample.step}")
        if sample.step != step:
            return AnswerFault("late" if sample.step < step else "early", f"step {sample.step} at step {step}")
        return None

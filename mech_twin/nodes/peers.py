"""What the linkage has heard from its peers at the current step.  Knows no ROS."""

from __future__ import annotations

from typing import Any

from mech_twin.nodes.ledger import Ledger
from mech_twin.samples import BodySample, MotorSample


class Peers:
    """Answers of the peers to one step.

    Parameters
    ----------
    names : tuple of str
        Peers that must answer.
    ledger : Ledger
        Where everything that is not the expected answer is counted.
    """

    def __init__(self, names: tuple[str, ...], ledger: Ledger) -> None:
        self.holds = 0
        self.held_s = 0.0
        self._names = names
        self._ledger = ledger
        self._answers: dict[str, Any] = {}
        self._previous: dict[str, Any] = {}

    @property
    def complete(self) -> bool:
        """Whether every peer has answered."""
        return len(self._answers) == len(self._names)

    @property
    def motor(self) -> MotorSample:
        """The motor's answer."""
        answer: MotorSample = self._answers["motor"]
        return answer

    @property
    def body(self) -> BodySample | None:
        """The body's answer."""
        return self._answers.get("body")

    def missing(self) -> str:
        """Return who has not answered."""
        return ", ".join(name for name in self._names if name not in self._answers)

    def expect_next(self) -> None:
        """Begin a new step."""
        self._previous, self._answers = self._answers, {}

    def take(self, peer: str, topic: str, sample: Any, step: int) -> bool:
        """Return whether this is the peer's answer to the step; anything else is counted and not used."""
        kind = self._fault(peer, sample, step)
        if kind is not None:
            self._ledger.count(topic, *kind)
            return False
        self._answers[peer] = sample
        return True

    def _fault(self, peer: str, sample: Any, step: int) -> tuple[str, str] | None:
        known = self._answers.get(peer) if sample.step == step else None
        if known is None and sample.step == step - 1:
            known = self._previous.get(peer)
        if known is not None:
            same = known == sample
            return ("repeated", f"step {sample.step}") if same else ("foreign", f"another answer to step {sample.step}")
        if sample.step != step:
            return ("late" if sample.step < step else "early", f"step {sample.step} at step {step}")
        return None

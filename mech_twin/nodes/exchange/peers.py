# SPDX-License-Identifier: Apache-2.0
"""Peers of a node: the followed publisher of a topic, answers to a step, lost peers, other publishers of the clock.

One publisher of a topic is followed at a time, another only when the first is gone.  Each node signs its step messages
with a source number (row ``~source``).  A message without one comes from a user's own program; all of those are one
source, `ANONYMOUS`.  A run continues when every peer has answered a step.  A missing answer is requested again, until
the peer counts as gone.  Two clocks on one topic would make time jump for its subscribers.
"""

import errno
import hashlib
import secrets
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from enum import Enum
from typing import Any

import rclpy
from rclpy.node import Node

from mech_twin.messages.step_message import ANONYMOUS
from mech_twin.messages.topics import CLOCK
from mech_twin.nodes.exchange.counting import StepFault
from mech_twin.samples import BodySample, ForceSample, MotorSample

SOURCE_BITS = 48  # a float64 holds it exactly


def new_source() -> float:
    """Return a unique source number."""
    return float(1 + secrets.randbits(SOURCE_BITS))


class Admission(Enum):
    """Decision of a lock on a message's source."""

    FOLLOWED = "followed"
    NEWLY_FOLLOWED = "newly followed"
    REFUSED = "refused"


class SourceLock:
    """The source number that is followed on a topic, if any."""

    def __init__(self) -> None:
        self.source: float | None = None

    @property
    def locked(self) -> bool:
        """Whether a source is followed."""
        return self.source is not None

    def admit(self, source: float, vacant: bool) -> Admission:
        """Return whether a message of this source counts; if ``vacant``, its source becomes the followed one."""
        if source == self.source:
            return Admission.FOLLOWED
        if not vacant:
            return Admission.REFUSED
        self.source = source
        return Admission.NEWLY_FOLLOWED


class HeardSource:
    """The publisher that a passive listener follows until it falls silent; signed ones have priority.

    Parameters
    ----------
    silence_s : float
        Time without a message after which it counts as gone.
    clock : callable
        Steady time in seconds.
    """

    def __init__(self, silence_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._silence_s = silence_s
        self._clock = clock
        self._lock = SourceLock()
        self._received_s = clock()

    def admit(self, source: float, alone: Callable[[], bool]) -> Admission:
        """Return whether a message of this source counts.

        ``alone`` returns whether there is no other publisher; it is called for an unsigned message while no publisher
        is followed.
        """
        now_s = self._clock()
        if source == self._lock.source:
            self._received_s = now_s
            return Admission.FOLLOWED
        if self._lock.locked:
            unsigned = self._lock.source == ANONYMOUS and source != ANONYMOUS
            vacant = unsigned or now_s - self._received_s > self._silence_s
        else:
            vacant = source != ANONYMOUS or alone()
        admission = self._lock.admit(source, vacant)
        if admission is not Admission.REFUSED:
            self._received_s = now_s
        return admission


Answer = MotorSample | ForceSample | BodySample


class SteppingBarrier:
    """Collects the answers of the peers to one step.

    Parameters
    ----------
    names : tuple of str
        Peers that must answer.

    Attributes
    ----------
    answers : dict
        The answer of each peer that has given it.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        self.answers: dict[str, Any] = {}
        self._previous: dict[str, Answer] = {}

    @property
    def complete(self) -> bool:
        """Whether every peer has answered."""
        return len(self.answers) == len(self.names)

    def missing(self) -> tuple[str, ...]:
        """Return the peers that have not answered."""
        return tuple(name for name in self.names if name not in self.answers)

    def expect_next(self) -> None:
        """Start a new step."""
        self._previous, self.answers = self.answers, {}

    def take(self, peer: str, sample: Answer, step: int) -> StepFault | None:
        """Store a peer's answer to this step; for any other message return the reason why it is not used."""
        fault = self._fault(peer, sample, step)
        if fault is None:
            self.answers[peer] = sample
        return fault

    def _fault(self, peer: str, sample: Answer, step: int) -> StepFault | None:
        known = self.answers.get(peer) if sample.step == step else None
        if known is None and sample.step == step - 1:
            known = self._previous.get(peer)
        if known is not None and known == sample:
            return StepFault("repeated", f"step {sample.step}")
        if known is not None:
            return StepFault("conflicting", f"another answer to step {sample.step}")
        if sample.step != step:
            return StepFault("late" if sample.step < step else "early", f"step {sample.step} at step {step}")
        return None


ASK_AGAIN_S = 0.3
ASK_AGAIN_WAITING_S = 0.1


class PeerWait:
    """The time since the last step, and the total time of waiting for peers.

    Parameters
    ----------
    timeout_s : float
        Time without an answer after which a peer counts as gone.
    now_s : float
        Steady time of the beginning.
    """

    def __init__(self, timeout_s: float, now_s: float) -> None:
        self.count = 0
        self._timeout_s = timeout_s
        self._step_at_s = now_s
        self._asked_at_s = now_s
        self._since_s: float | None = None
        self._ended_s = 0.0

    @property
    def waiting(self) -> bool:
        """Whether the run waits for a peer that is gone."""
        return self._since_s is not None

    def silence_s(self, now_s: float) -> float:
        """Return the time since the last step (s)."""
        return now_s - self._step_at_s

    def total_s(self, now_s: float) -> float:
        """Return the total time of waiting (s), the present wait included."""
        return self._ended_s + (0.0 if self._since_s is None else now_s - self._since_s)

    def due(self, now_s: float) -> bool:
        """Return whether missing answers are to be requested again."""
        patience_s = ASK_AGAIN_WAITING_S if self.waiting else ASK_AGAIN_S
        return now_s - max(self._step_at_s, self._asked_at_s) > patience_s

    def ask(self, now_s: float) -> bool:
        """Register a repeated request; return whether the peer counts as gone from now on."""
        self._asked_at_s = now_s
        if self.waiting or self.silence_s(now_s) <= self._timeout_s:
            return False
        self._since_s = now_s
        self.count += 1
        return True

    def stepped(self, now_s: float) -> None:
        """Register a step, which ends a wait."""
        self._ended_s = self.total_s(now_s)
        self._since_s = None
        self._step_at_s = now_s

    def resumed(self, now_s: float) -> None:
        """Restart time measurement after this process was suspended."""
        self._step_at_s = now_s


def other_clocks(node: Node) -> str:
    """Return a warning that names other publishers of a node's clock and the remedy; empty if there is none."""
    topic = node.resolve_topic_name(CLOCK.name)
    others = other_publishers(node, topic)
    if not others or len(node.get_publishers_info_by_topic(topic)) == len(others):  # this node does not publish it
        return ""
    names = ", ".join(sorted(others))
    return f"{topic} is published by {names} as well: with --namespace a replay has a clock of its own"


def other_publishers(node: Node, topic: str) -> set[str]:
    """Return the full names of the other nodes that publish a topic, as the node resolves its name."""
    ends = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return {f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in ends} - {node.get_fully_qualified_name()}


FORGOTTEN_S = 30.0  # the middleware drops a silent participant after 10 s to 20 s
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of rmw: an endpoint can be known before, and longer than, its node's name


class LivingPublishers:
    """The publishers of one topic, by node name and endpoint.

    A restarted node has two endpoints until the killed one's is forgotten, both with its name or one without a name.
    They count as one, unless both are known for longer than that.
    """

    def __init__(self) -> None:
        self._since_s: dict[tuple[str, bytes], float] = {}

    def living(self, known: Iterable[tuple[str, bytes]], now_s: float) -> int:
        """Return the number of publishers that are certainly alive among the known node names and endpoints."""
        self._since_s = {each: self._since_s.get(each, now_s) for each in known}
        lasting = Counter(name for (name, _), since_s in self._since_s.items() if now_s - since_s > FORGOTTEN_S)
        names = {name for name, _ in self._since_s}
        named = {name for name in names if not name.endswith(UNKNOWN)}
        certain = sum(max(1, lasting[name]) for name in named) + sum(lasting[name] for name in names - named)
        return max(certain, min(1, len(names)))


ANSWER_S = 0.02


class HostClaims:
    """Names claimed on this host: abstract Unix sockets, which the kernel gives to one process at a time.

    Parameters
    ----------
    names : iterable of str
        Names to claim; all or none.

    Attributes
    ----------
    holder : str
        Name and holder, if another process holds one of them; else empty.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.holder = ""
        self._held = ExitStack()
        domain = rclpy.get_default_context().get_domain_id()
        for name in sorted(names):  # in the same order in all processes, so that one of them gets all names
            address = b"\0mech_twin/" + hashlib.sha256(f"{domain} {name}".encode()).digest()
            try:
                held = self._held.enter_context(socket.socket(socket.AF_UNIX))
                held.bind(address)
                held.listen()
            except OSError as error:
                self.close()
                if error.errno != errno.EADDRINUSE:
                    raise
                self.holder = f"{name} is claimed by an earlier start{_holder(address)}"
                return

    def close(self) -> None:
        """Release the names."""
        self._held.close()


def _holder(address: bytes) -> str:
    """Return a description of the process that listens at an address."""
    with suppress(OSError), socket.socket(socket.AF_UNIX) as asked:
        asked.settimeout(ANSWER_S)
        asked.connect(address)
        process, _, _ = struct.unpack("3i", asked.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
        return f", process {process}"
    return ""

# SPDX-License-Identifier: Apache-2.0
"""Nodes served by one executor hand each other steps as objects, in the order they were sent.  Knows no ROS.

Each listener keeps its subscription.  A step is handed to it while only nodes here publish on the topic; else it gets
the bytes like everybody.  Bytes are published where a subscription is not served by hand.  What a listener was handed
and is published for others comes back by its subscription too: as bytes it is known to expect, and drops.

Order survives each change of the way: nothing is handed while bytes sent before are expected, and bytes that arrive
while a handed step waits are taken after it.

What senders here sign is known here.  Bytes that bear a sender's number and that no sender here published are a copy
by somebody else: their signature is not believed, and they count as unsigned.  So do those of a sender elsewhere that
another publisher sent (`PublisherNumbers`).
"""

from __future__ import annotations

import math
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from mech_twin.engine.sample_vectors import row_of
from mech_twin.messages.cdr import StepMessage
from mech_twin.messages.step_message import ANONYMOUS, REVISION, ConfigurationMark, Row, configuration_mark

SOURCES = 64  # of a topic that are remembered


class PublisherNumbers:
    """The publisher of each source heard on one topic: the first that signed with it.

    Parameters
    ----------
    silence_s : float
        Time after which that publisher counts as gone, and another number of the source as its successor's.
    clock : callable
        Steady time in seconds.
    """

    def __init__(self, silence_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._silence_s, self._clock = silence_s, clock
        self._newest: OrderedDict[float, tuple[int, float]] = OrderedDict()  # its number, and when it came

    def is_own(self, source: float, number: int | None, alone: Callable[[], bool]) -> bool:
        """Return whether a message comes from the publisher of the source it bears.

        Parameters
        ----------
        source : float
            What it is signed with.
        number : int or None
            What the middleware numbers it with; None where it does not, and then every message is believed.
        alone : callable
            Whether nobody else publishes the topic: a gap is then a loss.  Asked where the number does not go on.
        """
        if number is None:
            return True
        now_s, known = self._clock(), self._newest.get(source)
        if known is not None and number != known[0] + 1 and now_s - known[1] <= self._silence_s and not alone():
            return False
        self._newest[source] = number, now_s
        self._newest.move_to_end(source)
        if len(self._newest) > SOURCES:
            self._newest.popitem(last=False)
        return True


REMEMBERED = 1 << 15  # messages of a topic: half a minute of steps of 1 ms, longer than any listener is behind


class HandedStep:
    """A sample as its node publishes it; bytes are made where somebody asks for them, and once.

    Parameters
    ----------
    sample : LinkageSample, MotorSample, ForceSample or BodySample
        The sample.
    marks : tuple of Row
        What the node adds; its signature last.
    encode : callable
        Returns the bytes of sample and marks.
    """

    def __init__(self, sample: Any, marks: tuple[Row, ...], encode: Callable[[Any, tuple[Row, ...]], bytes]) -> None:
        self.sample = sample
        self._marks = marks
        self._encode = encode
        self._raw = b""

    @property
    def source(self) -> float:
        """The number the publishing node signs with."""
        return self._marks[-1].position

    @property
    def configuration(self) -> ConfigurationMark:
        """The configuration the sample was computed with."""
        row = self._marks[-2] if len(self._marks) > 1 else None
        known = row is not None and row.name == REVISION
        return ConfigurationMark(int(row.position), row.velocity) if row is not None and known else ConfigurationMark()

    @property
    def raw(self) -> bytes:
        """The bytes of the step message."""
        if not self._raw:
            self._raw = self._encode(self.sample, self._marks)
        return self._raw

    @property
    def finite(self) -> bool:
        """Whether the sum of all numbers is finite; where it is not, a decoder of bytes has to look at each."""
        more = self.sample[-1]
        return math.isfinite(sum(row_of(self.sample).tolist()) + (_numbers_of(more) if more else 0.0))


class HandedBytes:
    """A message of which only bytes are wanted."""

    finite = True  # nobody asks it for numbers

    def __init__(self, raw: bytes) -> None:
        self.raw = raw


Handed = HandedStep | HandedBytes


class HeardBytes(NamedTuple):
    """A message as the subscription received it, and which of its publisher's it is; None where nobody knows."""

    raw: bytes
    number: int | None


class ReceivedStep:
    """A step that came as bytes.

    Parameters
    ----------
    message : StepMessage
        What came.
    source : float
        The number of its publisher as far as it is believed, 0 without any; see `Listener.believed`.
    """

    def __init__(self, message: StepMessage, source: float) -> None:
        self._message = message
        self.source = source

    @property
    def configuration(self) -> ConfigurationMark:
        """The configuration the sample was computed with; revision 0 if the message does not say."""
        return configuration_mark(self._message)

    @property
    def raw(self) -> bytes:
        """The bytes as they came."""
        return self._message.raw


Step = HandedStep | ReceivedStep


def _numbers_of(part: Iterable[Any]) -> float:
    """Return the sum of all numbers in nested tuples; words count nothing."""
    total = 0.0
    for entry in part:
        if isinstance(entry, (int, float)):
            total += entry
        elif isinstance(entry, tuple):
            total += _numbers_of(entry)
    return total


class Listener:
    """A subscription.

    Parameters
    ----------
    topic : str
        Full name.
    take : callable
        Called with a step that is handed over.
    receive : callable
        Called with the `HeardBytes` of a step.
    patient : bool
        Whether its steps may come some at a time, later than those of others.
    silence_s : float
        Time after which a publisher elsewhere counts as gone.

    Attributes
    ----------
    publishers : callable
        Returns how many publishers its subscription is matched with, those of this process included.
    """

    def __init__(
        self,
        topic: str,
        take: Callable[[Any], None],
        receive: Callable[[HeardBytes], None],
        patient: bool = False,
        silence_s: float = 0.5,
    ) -> None:
        self.topic, self.patient = topic, patient
        self.publishers: Callable[[], int] = int
        self._take, self._receive = take, receive
        self._waiting: Waiting | None = None
        self._queued = 0
        self._expected: deque[tuple[bytes, bool]] = deque()  # whether it was handed over as well
        self._only_bytes = 0
        self._channel: StepChannel | None = None
        self._numbers = PublisherNumbers(silence_s)

    def believed(self, source: float, heard: HeardBytes) -> float:
        """Return the number that signs bytes as heard; 0 where it is that of a sender who did not send them."""
        if source == ANONYMOUS:
            return source
        if self._channel is not None and self._channel.signs(source):
            return source if self._channel.published(heard.raw) else ANONYMOUS
        return source if self._numbers.is_own(source, heard.number, lambda: self.publishers() <= 1) else ANONYMOUS

    def hear(self, raw: bytes, info: Mapping[str, Any]) -> None:
        """Take bytes that the subscription received, and what rclpy knows of them, unless the step was handed over."""
        if self._was_handed(raw):
            return
        heard = HeardBytes(raw, info["publication_sequence_number"])
        if self._queued and self._waiting is not None:
            self._queued += 1
            self._waiting.append((self, self._receive, heard))
        else:
            self._receive(heard)

    def queue(self, step: Handed, senders: int) -> bool:
        """Put a step on its way by hand, if only these senders publish and no bytes of them are expected."""
        if self._waiting is None or self._only_bytes or self.publishers() > senders:
            return False
        self._queued += 1
        self._waiting.append((self, self._take, step))
        return True

    def expect(self, raw: bytes, handed: bool) -> None:
        """Take note of bytes that are on their way."""
        self._expected.append((raw, handed))
        self._only_bytes += not handed

    def taken(self) -> None:
        """Take note that one of the queued steps is delivered."""
        self._queued -= 1

    def joined(self, waiting: Waiting | None, channel: StepChannel | None) -> None:
        """Queue steps there from now on, and know what the senders of a channel sent."""
        self._waiting, self._queued, self._channel = waiting, 0, channel
        self._expected.clear()
        self._only_bytes = 0

    def _was_handed(self, raw: bytes) -> bool:
        """Return whether these bytes are expected and were handed over; those expected before them are lost."""
        if not any(known == raw for known, _ in self._expected):
            return False
        while True:
            known, handed = self._expected.popleft()
            self._only_bytes -= not handed
            if known == raw:
                return handed


Waiting = deque[tuple[Listener, Callable[[Any], None], Any]]


class StepChannel:
    """The listeners and senders of one executor on one topic."""

    def __init__(self) -> None:
        self.listeners: list[Listener] = []
        self.senders = 0
        self._sources: set[float] = set()
        self._published: OrderedDict[int, None] = OrderedDict()  # hashes of the newest bytes

    def left(self) -> None:
        """Take note that a sender sends nothing here any more; what it publishes from now on is not known here."""
        self.senders -= 1
        self._sources.clear()

    def signs(self, source: float) -> bool:
        """Return whether a sender here signs with this number."""
        return source in self._sources

    def published(self, raw: bytes) -> bool:
        """Return whether a sender here published these bytes."""
        return hash(raw) in self._published

    def send(self, step: Handed, subscriptions: Callable[[], int], publish: Callable[[bytes], None]) -> None:
        """Hand a step over, and publish its bytes where a subscription is not served by hand.

        Parameters
        ----------
        step : Handed
            What is sent.
        subscriptions : callable
            Returns how many subscriptions the publisher is matched with, those of this process included.
        publish : callable
            Sends bytes to all of them.
        """
        senders = self.senders if step.finite else -1
        handed = [listener.queue(step, senders) for listener in self.listeners]
        if isinstance(step, HandedStep):
            self._sources.add(step.source)
        if subscriptions() > sum(handed):
            if self.listeners:
                self._remember(step.raw)
            for listener, by_hand in zip(self.listeners, handed, strict=True):
                listener.expect(step.raw, by_hand)
            publish(step.raw)

    def _remember(self, raw: bytes) -> None:
        number = hash(raw)
        self._published[number] = None
        self._published.move_to_end(number)
        if len(self._published) > REMEMBERED:
            self._published.popitem(last=False)


class HandOver:
    """The channels of one executor, and the steps on their way: at once, or ``later`` to who is patient."""

    def __init__(self) -> None:
        self.waiting: Waiting = deque()
        self.later: Waiting = deque()
        self._channels: dict[str, StepChannel] = {}

    @property
    def used(self) -> bool:
        """Whether anybody hands over to anybody."""
        return any(channel.senders and channel.listeners for channel in self._channels.values())

    def channel(self, topic: str) -> StepChannel:
        """Return the channel of a topic by its full name."""
        return self._channels.setdefault(topic, StepChannel())

    def listen(self, listener: Listener) -> None:
        """Hand steps of its topic to a listener from now on."""
        channel = self.channel(listener.topic)
        listener.joined(self._queue(listener), channel)
        channel.listeners.append(listener)

    def leave(self, listener: Listener) -> None:
        """Hand a listener nothing more, what is on its way included."""
        self.channel(listener.topic).listeners.remove(listener)
        listener.joined(None, None)
        queue = self._queue(listener)
        others = [entry for entry in queue if entry[0] is not listener]
        queue.clear()
        queue.extend(others)

    def deliver(self) -> None:
        """Deliver the step that has waited longest."""
        _deliver(self.waiting)

    def deliver_later(self) -> None:
        """Deliver all that waits for who is patient: what is done many times in a row is done faster."""
        later = self.later
        while later:
            _deliver(later)

    def _queue(self, listener: Listener) -> Waiting:
        return self.later if listener.patient else self.waiting


def _deliver(queue: Waiting) -> None:
    listener, call, step = queue.popleft()
    listener.taken()
    call(step)

# SPDX-License-Identifier: Apache-2.0
"""Direct exchange of steps as objects between nodes of one executor, in the order they were sent.  Uses no ROS.

Each listener keeps its subscription.  A step is passed to it directly while only nodes of this executor publish on the
topic; otherwise it gets the bytes.  Bytes are published if a subscription is not served directly.  They then arrive at
the subscriptions of direct listeners too, which expect and drop them.

The order is kept at each change between the two ways.  Nothing is passed directly while bytes sent before are expected,
and bytes that arrive while a direct step waits are taken after it.

Bytes with the source number of a sender of this executor, but not published by one, are a copy by another publisher:
they count as unsigned.  So do those of a remote sender that another publisher sent (`PublisherNumbers`).
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

SOURCES = 64  # remembered per topic


class PublisherNumbers:
    """The publisher of each source number on one topic: the first that signed with it.

    Parameters
    ----------
    silence_s : float
        Silence (s) after which that publisher counts as gone, and another publisher of the source as its successor.
    clock : callable
        Steady time in seconds.
    """

    def __init__(self, silence_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._silence_s, self._clock = silence_s, clock
        self._newest: OrderedDict[float, tuple[int, float]] = OrderedDict()  # sequence number and time of arrival (s)

    def is_own(self, source: float, number: int | None, alone: Callable[[], bool]) -> bool:
        """Return whether a message comes from the publisher of the source number in it.

        Parameters
        ----------
        source : float
            Source number in the message.
        number : int or None
            Sequence number of the middleware; None if it gives none, and then every message is accepted.
        alone : callable
            Whether there is no other publisher: a gap is then a loss.  Called if the sequence is interrupted.
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


REMEMBERED = 1 << 15  # messages per topic: 33 s at steps of 1 ms, more than any listener lags


class HandedStep:
    """A sample as its node publishes it; it is encoded on first request, once.

    Parameters
    ----------
    sample : LinkageSample, MotorSample, ForceSample or BodySample
        The sample.
    marks : tuple of Row
        Rows that the node adds; its signature last.
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
        """Source number of the publishing node."""
        return self._marks[-1].position

    @property
    def configuration(self) -> ConfigurationMark:
        """The configuration that the sample was computed with; see `ConfigurationMark`."""
        row = self._marks[-2] if len(self._marks) > 1 else None
        known = row is not None and row.name == REVISION
        return ConfigurationMark(int(row.position), row.velocity) if row is not None and known else ConfigurationMark()

    @property
    def raw(self) -> bytes:
        """The serialized step message."""
        if not self._raw:
            self._raw = self._encode(self.sample, self._marks)
        return self._raw

    @property
    def finite(self) -> bool:
        """Whether the sum of all numbers is finite; if not, the decoder must check each number."""
        more = self.sample[-1]
        return math.isfinite(sum(row_of(self.sample).tolist()) + (_numbers_of(more) if more else 0.0))


class HandedBytes:
    """A message of which only the bytes are used."""

    finite = True  # not checked: no listener reads its numbers

    def __init__(self, raw: bytes) -> None:
        self.raw = raw


Handed = HandedStep | HandedBytes


class ReceivedBytes(NamedTuple):
    """A message as received, and its publisher's sequence number (None: unknown)."""

    raw: bytes
    number: int | None


class ReceivedStep:
    """A step received as bytes.

    Parameters
    ----------
    message : StepMessage
        The message.
    source : float
        Accepted source number of its publisher, 0 without any; see `Listener.believed`.
    """

    def __init__(self, message: StepMessage, source: float) -> None:
        self._message = message
        self.source = source

    @property
    def configuration(self) -> ConfigurationMark:
        """The configuration that the sample was computed with; revision 0 if the message has no such row."""
        return configuration_mark(self._message)

    @property
    def raw(self) -> bytes:
        """The bytes as received."""
        return self._message.raw


Step = HandedStep | ReceivedStep


def _numbers_of(part: Iterable[Any]) -> float:
    """Return the sum of all numbers in nested tuples; text counts as 0."""
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
        Called with a step passed directly.
    receive : callable
        Called with the `ReceivedBytes` of a step.
    patient : bool
        Whether its steps may be delivered in batches, later than those of others.
    silence_s : float
        Silence (s) after which a remote publisher counts as gone.

    Attributes
    ----------
    publishers : callable
        Returns the number of matched publishers, those of this process included.
    """

    def __init__(
        self,
        topic: str,
        take: Callable[[Any], None],
        receive: Callable[[ReceivedBytes], None],
        patient: bool = False,
        silence_s: float = 0.5,
    ) -> None:
        self.topic, self.patient = topic, patient
        self.publishers: Callable[[], int] = int
        self._take, self._receive = take, receive
        self._waiting: Waiting | None = None
        self._queued = 0
        self._expected: deque[tuple[bytes, bool]] = deque()  # bytes; whether the object was passed too
        self._only_bytes = 0
        self._channel: StepChannel | None = None
        self._numbers = PublisherNumbers(silence_s)

    def believed(self, source: float, received: ReceivedBytes) -> float:
        """Return the source number of received bytes, 0 if it belongs to a sender that did not send them."""
        if source == ANONYMOUS:
            return source
        if self._channel is not None and self._channel.signs(source):
            return source if self._channel.published(received.raw) else ANONYMOUS
        return source if self._numbers.is_own(source, received.number, lambda: self.publishers() <= 1) else ANONYMOUS

    def hear(self, raw: bytes, info: Mapping[str, Any]) -> None:
        """Process bytes received by the subscription with rclpy's message info, unless the step came directly."""
        if self._was_handed(raw):
            return
        received = ReceivedBytes(raw, info["publication_sequence_number"])
        if self._queued:
            self._enqueue(self._receive, received)
            return
        try:
            self._receive(received)
        except Exception as error:
            if self._waiting is None:
                raise
            self._enqueue(_raised, error)  # outside the executor, which would print a trace of its own

    def _enqueue(self, call: Callable[[Any], None], what: Any) -> None:
        assert self._waiting is not None
        self._queued += 1
        self._waiting.append((self, call, what))

    def queue(self, step: Handed, senders: int) -> bool:
        """Queue a step for direct delivery if only these senders publish and none of their bytes are expected."""
        if self._waiting is None or self._only_bytes or self.publishers() > senders:
            return False
        self._enqueue(self._take, step)
        return True

    def expect(self, raw: bytes, handed: bool) -> None:
        """Register bytes that have been published and will arrive."""
        self._expected.append((raw, handed))
        self._only_bytes += not handed

    def taken(self) -> None:
        """Register the delivery of a queued step."""
        self._queued -= 1

    def joined(self, waiting: Waiting | None, channel: StepChannel | None) -> None:
        """Queue steps in this list from now on, and recognise the messages of a channel's senders."""
        self._waiting, self._queued, self._channel = waiting, 0, channel
        self._expected.clear()
        self._only_bytes = 0

    def _was_handed(self, raw: bytes) -> bool:
        """Return whether these bytes are expected and came directly before; bytes expected earlier are lost."""
        if not any(known == raw for known, _ in self._expected):
            return False
        while True:
            known, handed = self._expected.popleft()
            self._only_bytes -= not handed
            if known == raw:
                return handed


def _raised(error: Exception) -> None:
    raise error


Waiting = deque[tuple[Listener, Callable[[Any], None], Any]]


class StepChannel:
    """The listeners and senders of one topic on one executor."""

    def __init__(self) -> None:
        self.listeners: list[Listener] = []
        self.senders = 0
        self._sources: set[float] = set()
        self._published: OrderedDict[int, None] = OrderedDict()  # hashes of the newest bytes

    def left(self) -> None:
        """Remove a sender; its later messages count as remote."""
        self.senders -= 1
        self._sources.clear()

    def signs(self, source: float) -> bool:
        """Return whether this source number belongs to a sender of this executor."""
        return source in self._sources

    def published(self, raw: bytes) -> bool:
        """Return whether a sender of this executor published these bytes."""
        return hash(raw) in self._published

    def send(self, step: Handed, subscriptions: Callable[[], int], publish: Callable[[bytes], None]) -> None:
        """Pass a step directly, and publish its bytes if a subscription is not served directly.

        Parameters
        ----------
        step : Handed
            The step.
        subscriptions : callable
            Returns the number of matched subscriptions, those of this process included.
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
    """The channels of one executor, and the queues of steps: at once, and ``later`` for patient listeners."""

    def __init__(self) -> None:
        self.waiting: Waiting = deque()
        self.later: Waiting = deque()
        self._channels: dict[str, StepChannel] = {}

    @property
    def used(self) -> bool:
        """Whether there is any direct exchange."""
        return any(channel.senders and channel.listeners for channel in self._channels.values())

    def channel(self, topic: str) -> StepChannel:
        """Return the channel of a topic by its full name."""
        return self._channels.setdefault(topic, StepChannel())

    def listen(self, listener: Listener) -> None:
        """Pass the steps of its topic directly to a listener from now on."""
        channel = self.channel(listener.topic)
        listener.joined(self._queue(listener), channel)
        channel.listeners.append(listener)

    def leave(self, listener: Listener) -> None:
        """Stop direct delivery to a listener, queued steps included."""
        self.channel(listener.topic).listeners.remove(listener)
        listener.joined(None, None)
        queue = self._queue(listener)
        others = [entry for entry in queue if entry[0] is not listener]
        queue.clear()
        queue.extend(others)

    def deliver(self) -> None:
        """Deliver the oldest queued step."""
        _deliver(self.waiting)

    def deliver_later(self) -> None:
        """Deliver all steps queued for patient listeners: a batch is faster than single steps."""
        later = self.later
        while later:
            _deliver(later)

    def _queue(self, listener: Listener) -> Waiting:
        return self.later if listener.patient else self.waiting


def _deliver(queue: Waiting) -> None:
    listener, call, step = queue.popleft()
    listener.taken()
    call(step)

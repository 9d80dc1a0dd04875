# SPDX-License-Identifier: Apache-2.0
"""Counters of a node: messages sent and faults on each topic, and the diagnostics that report them.

No loss is silent.  The largest residual of each window is compared with its limit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message

from mech_twin.engine.trajectory import ResidualWindow, broken_lines
from mech_twin.messages.step_message import set_stamp
from mech_twin.messages.topics import PeakHoldWindow, StreamWindow, Topic
from mech_twin.nodes.exchange.direct_exchange import HandedBytes, HandedStep, StepChannel
from mech_twin.samples import Named

if TYPE_CHECKING:
    from mech_twin.nodes.exchange.base_node import TwinNode

OF_STEPS = ("missing", "repeated", "late", "early", "conflicting")
KINDS = (*OF_STEPS, "malformed", "unknown_source", "timeout", "incompatible", "suspended")


class Report(NamedTuple):
    """Counts of one topic in one window."""

    topic: str
    counts: dict[str, int]
    last_reason: str


class StepFault(NamedTuple):
    """Why a step is not used or missed: a kind of `KINDS`, an explanation, and the number of steps concerned."""

    kind: str
    reason: str
    number: int = 1


class StepSequence:
    """Checks the step numbers of a topic for gaps and repetitions; holds the first and the highest number."""

    def __init__(self) -> None:
        self.first: int | None = None
        self.last: int | None = None

    def take(self, step: int) -> StepFault | None:
        """Update with a step; return its fault, if any."""
        last, self.last = self.last, step if self.last is None else max(step, self.last)
        if last is None:
            self.first = step
        if last is None or step == last + 1:
            return None
        reason = f"step {step} after {last}"
        if step > last:
            return StepFault("missing", reason, step - last - 1)
        return StepFault("repeated" if step == last else "late", reason)


class TopicStatistics:
    """Fault counts per topic and kind, since the start and since the last report."""

    def __init__(self) -> None:
        self.total: Counter[tuple[str, str]] = Counter()
        self._window: Counter[tuple[str, str]] = Counter()
        self._reasons: dict[str, str] = {}

    def count(self, topic: str, kind: str, reason: str = "", number: int = 1) -> None:
        """Count a fault of this kind on a topic."""
        if kind not in KINDS:
            raise ValueError(f"kind {kind!r} is not one of {', '.join(KINDS)}")
        self.total[topic, kind] += number
        self._window[topic, kind] += number
        if reason:
            self._reasons[topic] = reason

    def totals(self) -> dict[str, int]:
        """Return ``topic: kind`` -> count since the start."""
        return {f"{topic}: {kind}": number for (topic, kind), number in sorted(self.total.items())}

    def close_window(self) -> list[Report]:
        """Return a report for each topic with faults since the last call, and start a new window."""
        topics = sorted({topic for topic, _ in self._window})
        reports = [
            Report(topic, {k: n for (t, k), n in self._window.items() if t == topic}, self._reasons.get(topic, ""))
            for topic in topics
        ]
        self._window.clear()
        self._reasons.clear()
        return reports


HARMLESS = {"repeated"}  # a run that waits for a peer repeats its step: counted, but no warning
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class NodeDiagnostics:
    """Collects states, residuals and faults over a window, and makes a diagnostics status of them.

    Parameters
    ----------
    name : str
        Full name of the node; its namespace without the leading slash is the ``hardware_id``.
    statistics : TopicStatistics
        Fault counts of the node's topics.
    """

    def __init__(self, name: str, statistics: TopicStatistics) -> None:
        self.state = "starting"
        self.breaches = 0
        self._name = name
        self.hardware = name.strip("/").rpartition("/")[0]
        self._statistics = statistics
        self._window = ResidualWindow({})
        self._step_s: float | None = None
        self._errors: list[str] = []
        self._warnings: list[str] = []

    def limits(self, limits: Mapping[str, float], step_s: float) -> None:
        """Set the limits of the residuals, for a coupling step (s); a residual without a limit counts as broken."""
        self._window.limits = dict(limits)
        self._step_s = step_s

    def observe(self, residuals: Named) -> None:
        """Update with the residuals of one sample."""
        self._window.observe(residuals)

    def error(self, text: str) -> None:
        """Add an error to the next message."""
        self._errors.append(text)

    def warn(self, text: str) -> None:
        """Add a warning to the next message."""
        self._warnings.append(text)

    def close_window(self, extra: Mapping[str, str]) -> tuple[DiagnosticStatus, list[str]]:
        """Return the status of the window that ends now, and a log line for each topic with faults."""
        reports = [report for report in self._statistics.close_window() if set(report.counts) - HARMLESS]
        residuals = self._window.close()
        lines = [_line(report) for report in reports]
        broken = broken_lines(residuals, self._step_s)
        self.breaches += len(broken)
        waiting = self.state.startswith("waiting")
        level = ERROR if broken or self._errors else WARN if reports or waiting or self._warnings else OK
        text = "; ".join([self.state, *broken, *self._errors, *self._warnings, *lines])
        self._errors, self._warnings = [], []
        values = {f"worst {name}": f"{residual.worst:.6g}" for name, residual in residuals.items()}
        values |= {name: str(number) for name, number in self._statistics.totals().items()} | dict(extra)
        return status_message(self._name, text, values, level=level, hardware_id=self.hardware), lines


def _line(report: Report) -> str:
    counts = ", ".join(f"{number} {kind.replace('_', ' ')}" for kind, number in report.counts.items())
    return f"{report.topic}: {counts}" + (f"; last: {report.last_reason}" if report.last_reason else "")


def status_message(name: str, text: str, values: Mapping[str, str], **fields: Any) -> DiagnosticStatus:
    """Return a diagnostics status with these values; ``fields`` are its level and the ``hardware_id``."""
    listed = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticStatus(name=name, message=text, values=listed, **fields)


def array_message(time_s: float, status: DiagnosticStatus) -> DiagnosticArray:
    """Return a diagnostics message of one status, stamped with simulation time (s)."""
    message = DiagnosticArray(status=[status])
    set_stamp(message.header, time_s)
    return message


class CountingPublisher:
    """One topic a node publishes.

    Without subscribers a message is counted and not published, unless it is latched for late subscribers.  Messages
    that are not latched go directly as bytes to listeners of the same executor, and are published for others only.

    Parameters
    ----------
    node : TwinNode
        The publishing node, which counts subscribers whose quality of service does not fit.
    topic : Topic
        The topic.
    listeners : int
        Subscribers that must be matched before the first message, so that none is missed.
    """

    exclusive = False  # whether this must be the only publisher of the topic

    def __init__(self, node: TwinNode, topic: Topic, listeners: int) -> None:
        self.name = topic.name
        self.listeners = listeners
        self.sent = 0
        self._kept = topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        unfit = partial(node.on_incompatible, topic.name, "subscriber")
        callbacks = PublisherEventCallbacks(incompatible_qos=unfit)
        self._publisher = node.create_publisher(topic.type, topic.name, topic.qos, event_callbacks=callbacks)
        self._count: Callable[[], int] = self._publisher.handle.get_subscription_count
        self._channel = StepChannel()

    @property
    def matched(self) -> bool:
        """Whether all expected subscribers are matched."""
        return self._count() >= self.listeners

    @property
    def has_receivers(self) -> bool:
        """Whether there are subscribers, or messages are latched for late ones."""
        return self._kept or self._count() > 0

    def send(self, message: Any) -> None:
        """Publish a message, given as a message object or as serialized bytes."""
        self.sent += 1
        self._pass_on(message)

    def send_made(self, make: Callable[[], Any]) -> None:
        """Publish the result of a call, which is made only if there are subscribers."""
        self.sent += 1
        if self.has_receivers:
            self._pass_on(make())

    def _pass_on(self, message: Any) -> None:
        if self._kept:
            self._publisher.publish(message)
        elif isinstance(message, bytes):
            self._channel.send(HandedBytes(message), self._count, self._publisher.publish)
        elif self.has_receivers:
            self._channel.send(HandedBytes(serialize_message(message)), self._count, self._publisher.publish)

    def join(self, channel: StepChannel) -> None:
        """Send directly to the listeners of a channel from now on."""
        channel.senders += 1
        self._channel = channel

    def leave(self) -> None:
        """Send to no listener directly."""
        self._channel.left()
        self._channel = StepChannel()

    def flush(self) -> None:
        """Publish held messages, if any."""

    def withdraw(self, node: TwinNode) -> None:
        """Stop publishing on the topic."""
        node.destroy_publisher(self._publisher)


class StepPublisher(CountingPublisher):
    """A publisher of step messages: objects for listeners of the same executor, serialized bytes for all others."""

    exclusive = True

    def send(self, message: HandedStep) -> None:
        """Pass a step to listeners of this executor, and publish its bytes if there are others."""
        self.sent += 1
        self._channel.send(message, self._count, self._publisher.publish)

    @property
    def arrived(self) -> bool:
        """Whether every subscriber has acknowledged what was published."""
        return bool(self._publisher.wait_for_all_acked(Duration()))  # a longer wait would keep the interpreter's lock


class DecimatedPublisher(CountingPublisher):
    """A topic on which only some of the offered samples are published.

    Parameters
    ----------
    window : StreamWindow or PeakHoldWindow
        Selects them.
    message : callable
        Returns the message of a sample.
    """

    def __init__(
        self,
        node: TwinNode,
        topic: Topic,
        listeners: int,
        window: StreamWindow[Any] | PeakHoldWindow[Any],
        message: Callable[[Any], Any],
    ) -> None:
        super().__init__(node, topic, listeners)
        self._window, self._message = window, message
        self.exclusive = isinstance(window, StreamWindow)

    def offer(self, *step: Any) -> None:
        """Offer a sample to the window, and publish the messages it passes."""
        self._send_all(self._window.offer(*step))

    def flush(self) -> None:
        """Publish the samples that the window holds."""
        self._send_all(self._window.rest())

    def _send_all(self, due: Iterable[Any]) -> None:
        for sample in due:
            self.send_made(partial(self._message, sample))

# SPDX-License-Identifier: Apache-2.0
"""The replay node: publishes a recording on its topics again, and can be paused and moved while it runs.

Its publishers count messages, and wait for listeners that must not miss any.  A replay from start to end serves the
node, executes keys and reports progress.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from mech_twin.messages.step_message import set_stamp
from mech_twin.messages.topics import CLOCK, DATA, DIAGNOSTICS
from mech_twin.nodes.exchange.counting import array_message, status_message
from mech_twin.nodes.exchange.parameter_bridge import declare_range, offer
from mech_twin.nodes.exchange.peers import other_clocks
from mech_twin.nodes.exchange.spinner import Spinner, destroy_nodes
from mech_twin.nodes.replay import FASTEST, SLOWEST
from mech_twin.nodes.replay.source import PlayedTopic, ReplayClock, ReplaySource
from mech_twin.nodes.run.console import TerminalKeys
from mech_twin.nodes.run.domain import replay_arguments
from mech_twin.nodes.run.name_guard import NameGuard
from mech_twin.process.interruption import StopSignal
from mech_twin.recording.bag_contents import stamp_ns

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mech_twin.recording.bag_contents import BagMessage


ACKNOWLEDGED_LIMIT_S = 0.1
IMPATIENCE_S = 1.0


class ReplayPublisher:
    """Publisher of one replayed topic.

    Parameters
    ----------
    node : Node
        The publishing node.
    topic : PlayedTopic
        Its name, type and recorded quality of service.
    """

    def __init__(self, node: Node, topic: PlayedTopic) -> None:
        self.topic = topic
        self.published = 0
        self.refused = 0
        self._node = node
        self._under_way = 0
        self._impatient_until_s = 0.0
        self._publisher = self._made()

    def matched(self, listeners: int) -> bool:
        """Whether all known subscribers are matched, and at least ``listeners`` of them."""
        known = self._node.count_subscribers(self.topic.name)
        return bool(self._publisher.get_subscription_count() >= max(listeners, known))

    def send(self, raw: bytes) -> None:
        """Publish; at half the history's depth wait for listeners, as unread messages would be overwritten."""
        try:
            self._publisher.publish(raw)
        except RuntimeError as error:  # raised by rmw, for instance on a full keep-all history
            self.refused += 1
            self._node.get_logger().warning(f"{self.topic.name}: not published: {error}", throttle_duration_sec=1.0)
            return
        self.published += 1
        self._under_way += 1
        if self._under_way * 2 >= max(self.topic.qos.depth, 1):
            self._under_way = 0
            if time.monotonic() >= self._impatient_until_s and not self.arrived(ACKNOWLEDGED_LIMIT_S):
                self._impatient_until_s = time.monotonic() + IMPATIENCE_S

    def arrived(self, limit_s: float) -> bool:
        """Wait for the published messages to arrive, at most ``limit_s``; return whether they have."""
        return bool(self._publisher.wait_for_all_acked(Duration(seconds=max(0.0, limit_s))))

    def forget(self) -> None:
        """Drop the messages latched for late subscribers."""
        self._node.destroy_publisher(self._publisher)
        self._publisher = self._made()

    def _made(self) -> Publisher:
        return self._node.create_publisher(self.topic.kind, self.topic.name, self.topic.qos)


WINDOW_S = 1.0
CLOCK_EVERY_NS = 10_000_000
AT_ONCE = 64
SETTLE_S, MATCH_LIMIT_S, LISTENER_LIMIT_S = 0.3, 2.0, 10.0


class ReplayOptions(NamedTuple):
    """Options of a replay: rate, loop, own ``/clock``; ``listeners``: subscribers each topic must have at the start."""

    rate: float = 1.0
    loop: bool = False
    clock: bool = False
    listeners: int = 0


class ReplayNode(Node):
    """Publishes a bag.

    Parameters
    ----------
    source : ReplaySource
        The messages to replay.
    options : ReplayOptions
        Options of the replay.
    """

    def __init__(self, source: ReplaySource, options: ReplayOptions) -> None:
        super().__init__("replay")
        self.interrupt: Callable[[], None] = lambda: None  # of `Ticking`: no message makes another one due earlier
        self.done = False
        self.loops = 0
        self._source = source
        self._options = options
        self._born = time.monotonic()
        self._begun = False
        self._place = ReplayClock(source.first_ns, options.rate, self._born)
        if options.clock:
            source.without_clock()
        self.outputs = {name: ReplayPublisher(self, topic) for name, topic in source.topics.items()}
        self._clock_out = self.create_publisher(Clock, CLOCK.name, CLOCK.qos) if options.clock else None
        self._diagnostics_out = self.create_publisher(DIAGNOSTICS.type, DIAGNOSTICS.name, DATA)
        self._begin_ns = source.first_ns
        self._last_ns: dict[str, int] = {}
        self._messages: Iterator[BagMessage] = iter(())
        self._following: BagMessage | None = None
        self._declare()
        offer(self, Trigger, "~/pause", lambda _: (True, self.pause()))
        offer(self, Trigger, "~/resume", lambda _: (True, self.resume()))
        offer(self, Trigger, "~/next_impact", lambda _: self.go_to_next_impact())
        self.create_timer(WINDOW_S, self.report)

    # -- position --------------------------------------------------------------------------------------------------

    @property
    def position_ns(self) -> int:
        """Log time reached (ns), never beyond a message still to be published."""
        if not self._begun:
            return self._begin_ns
        due = min(self._place.position_ns(time.monotonic()), self._source.last_ns)
        return due if self._following is None else min(due, self._following.log_time_ns)

    @property
    def position_s(self) -> float:
        """Position in seconds from the beginning of the bag."""
        return self._source.seconds(self.position_ns)

    @property
    def paused(self) -> bool:
        """Whether it is paused."""
        return self._place.paused

    @property
    def rate(self) -> float:
        """Recorded seconds per second."""
        return float(self.get_parameter("rate").value)

    # -- playback ---------------------------------------------------------------------------------------------------

    def tick(self) -> float:
        """Publish due messages, a limited number; return the time to the next one (s)."""
        if not self._begun:
            if not self._listeners_are_there():
                return 0.02
            self._begun = True
            self._place.jump(self._begin_ns, time.monotonic())
            self._take_position(self._begin_ns)
        for _ in range(AT_ONCE):
            message = self._following
            if message is None:
                return self._at_end()
            wait = self._place.wait_s(message.log_time_ns, time.monotonic())
            if wait > 0.0:
                return min(wait, self._tell_time())
            self._place.give_way(message.log_time_ns, time.monotonic())
            self._play(message)
            self._following = next(self._messages, None)
        self._tell_time()
        return 0.0

    def finish(self, limit_s: float) -> None:
        """Wait until the published messages have arrived, at most ``limit_s``."""
        end = time.monotonic() + limit_s
        for output in self.outputs.values():
            output.arrived(end - time.monotonic())

    def _at_end(self) -> float:
        wait = self._place.wait_s(self._source.last_ns, time.monotonic())
        to_clock = self._tell_time()
        if wait > 0.0:
            return min(wait, to_clock)
        if self._options.loop:
            self.loops += 1
            self._jump(self._source.first_ns, f"loop {self.loops + 1}")
        else:
            self.done = True
        return 0.0

    def _play(self, message: BagMessage) -> None:
        if message.topic == CLOCK.name:
            self._announce_if_back(message)
        self.outputs[message.topic].send(message.raw)

    def _listeners_are_there(self) -> bool:
        waited = time.monotonic() - self._born
        wanted = self._options.listeners
        if waited > (LISTENER_LIMIT_S if wanted else MATCH_LIMIT_S):
            if wanted:
                self.get_logger().warning(f"not every topic has {wanted} subscribers; beginning without")
            return True
        return waited > SETTLE_S and all(output.matched(wanted) for output in self.outputs.values())

    # -- jumps ------------------------------------------------------------------------------------------------------

    def _jump(self, to_ns: int, why: str) -> None:
        """Jump to a log time (ns), announcing it before anything is published there."""
        if not self._begun:
            self._begin_ns = to_ns
            return
        here, there = self.position_s, self._source.seconds(to_ns)
        direction = "back" if to_ns < self.position_ns else "forward"
        self._announce(f"time jumps {direction} from {here:.6f} s to {there:.6f} s ({why})", direction == "back")
        self._place.jump(to_ns, time.monotonic())
        self._take_position(to_ns)

    def _take_position(self, log_time_ns: int) -> None:
        self._last_ns.clear()
        for name, held in self._source.latched_at(log_time_ns).items():
            if not held:
                self.outputs[name].forget()
            for message in held:
                self._play(message)
        self._messages = self._source.messages(log_time_ns)
        self._following = next(self._messages, None)
        self._tell_time()

    def _tell_time(self) -> float:
        """Publish the clock if it is due; return the time to the next one (s), infinite without a clock."""
        if self._clock_out is None:
            return math.inf
        now_ns = self.position_ns
        last = self._last_ns.get("", -CLOCK_EVERY_NS)
        if now_ns - last >= CLOCK_EVERY_NS:
            self._last_ns[""] = last = now_ns
            message = DIAGNOSTICS.type()
            set_stamp(message.header, now_ns * 1e-9)
            self._clock_out.publish(Clock(clock=message.header.stamp))
        return self._place.wait_s(last + CLOCK_EVERY_NS, time.monotonic())

    def _announce_if_back(self, message: BagMessage) -> None:
        """Announce a recorded clock that runs backwards by itself."""
        stamp = stamp_ns(message.type_name, message.raw)
        if stamp is None:
            return
        last = self._last_ns.get(message.topic, stamp)
        if stamp < last:
            self._announce(f"the recorded clock jumps back from {last * 1e-9:.6f} s to {stamp * 1e-9:.6f} s", True)
        self._last_ns[message.topic] = stamp

    # -- control ----------------------------------------------------------------------------------------------------

    def pause(self) -> str:
        """Pause."""
        self._place.pause(time.monotonic())
        return f"paused at {self.position_s:.6f} s"

    def resume(self) -> str:
        """Continue."""
        self._place.resume(time.monotonic())
        return f"going on at {self.position_s:.6f} s"

    def go_to_next_impact(self) -> tuple[bool, str]:
        """Jump to the next impact; return whether there is one, and a line on it."""
        found = self._source.next_impact_ns(self.position_ns)
        if found is None:
            return False, f"no impact after {self.position_s:.6f} s"
        self._jump(found, "next impact")
        return True, f"impact at {self._source.seconds(found):.6f} s"

    def _declare(self) -> None:
        first, last = (self._source.seconds(end) for end in (self._source.first_ns, self._source.last_ns))
        declare_range(self, "rate", self._options.rate, "recorded seconds per second [1]", SLOWEST, FASTEST)
        declare_range(self, "seek_s", first, "go to this time from the beginning of the bag [s]", first, last)
        self.add_on_set_parameters_callback(self._judge)
        self.add_post_set_parameters_callback(self._apply)

    def _judge(self, changes: list[Parameter]) -> SetParametersResult:
        for change in changes:
            if isinstance(change.value, float) and not math.isfinite(change.value):
                return SetParametersResult(successful=False, reason=f"{change.name} {change.value}: not finite")
        return SetParametersResult(successful=True)

    def _apply(self, changes: list[Parameter]) -> None:
        for change in changes:
            if change.name == "rate":
                self._place.change_rate(change.value, time.monotonic())
            elif change.name == "seek_s":
                self._jump(self._source.log_time_ns(change.value), "seek")

    # -- diagnostics ------------------------------------------------------------------------------------------------

    def _announce(self, text: str, back: bool) -> None:
        if back:
            self.get_logger().warning(text)
        else:
            self.get_logger().info(text)  # a separate call: rclpy ties the severity to the source line
        self._send(text, DiagnosticStatus.WARN if back else DiagnosticStatus.OK)

    def report(self) -> None:
        """Publish the position and the omitted messages."""
        state = "paused" if self.paused else "replaying" if self._begun else "waiting for listeners"
        lost = self._source.malformed.total() + sum(output.refused for output in self.outputs.values())
        self._send(state, DiagnosticStatus.WARN if lost or self._source.unknown else DiagnosticStatus.OK)

    def _send(self, text: str, level: Any) -> None:
        values = {"position s": f"{self.position_s:.6f}", "rate": f"{self.rate:g}", "loops": str(self.loops)}
        for name, output in self.outputs.items():
            values |= {f"published {name}": str(output.published), f"refused {name}": str(output.refused)}
        values |= {f"malformed {name}": str(number) for name, number in self._source.malformed.items()}
        values |= {f"left out {name}": why for name, why in self._source.unknown.items()}
        status = status_message(self.get_fully_qualified_name(), text, values, level=level)
        self._diagnostics_out.publish(array_message(self.position_ns * 1e-9, status))


ARRIVAL_LIMIT_S = 1.0
FASTER = 1.25
KEYS = "space: pause or go on, n: next impact, +/-: faster or slower, q: quit"


class ReplayOutcome(NamedTuple):
    """Result of a replay: messages by topic."""

    published: dict[str, int]
    malformed: dict[str, int]
    refused: dict[str, int]
    unknown: dict[str, str]


def replayed(
    source: ReplaySource,
    options: ReplayOptions,
    progress: Callable[[ReplayNode], None],
    namespace: str | None = None,
) -> ReplayOutcome:
    """Replay a bag until its end, a signal or the key that quits.

    Parameters
    ----------
    source, options
        The recording, and the options.
    progress : callable
        Called with the node repeatedly.
    namespace : str, optional
        Namespace of the topics instead of the recorded one.

    Raises
    ------
    NameInUseError
        If a run or another replay is alive there.
    """
    names = {name: source.below(name) for name in source.topics}
    rclpy.init(args=replay_arguments(names, namespace), signal_handler_options=SignalHandlerOptions.NO)
    node: ReplayNode | None = None
    try:
        with StopSignal() as stop, TerminalKeys() as keys, ExitStack() as at_end:
            node = ReplayNode(source, options)
            steps = [node.resolve_topic_name(name) for name, topic in source.topics.items() if topic.kind is JointState]
            with stop.interrupting():
                at_end.enter_context(NameGuard(steps)).check(own_publishers=1)
            clocks = other_clocks(node)
            if clocks:
                node.get_logger().warning(clocks)
            if keys.listening:
                node.get_logger().info(KEYS)
            with Spinner([node]) as spinner:
                spinner.until(partial(_is_over, node, stop, keys, progress))
            node.finish(0.0 if stop.asked else ARRIVAL_LIMIT_S)
            published = {name: output.published for name, output in node.outputs.items()}
            refused = {name: output.refused for name, output in node.outputs.items() if output.refused}
            return ReplayOutcome(published, dict(source.malformed), refused, dict(source.unknown))
    finally:
        if node is not None:
            destroy_nodes([node])
        rclpy.try_shutdown()


def _is_over(node: ReplayNode, stop: StopSignal, keys: TerminalKeys, progress: Callable[[ReplayNode], None]) -> bool:
    """Obey the keys and report progress; return whether the replay is over."""
    for key in keys.pressed():
        obey(node, key)
    progress(node)
    return stop.asked or node.done


def obey(node: ReplayNode, key: str) -> None:
    """Execute the command of a key; other keys do nothing."""
    if key == " ":
        node.get_logger().info(node.resume() if node.paused else node.pause())
    elif key == "n":
        found, line = node.go_to_next_impact()
        if not found:
            node.get_logger().info(line)
    elif key in "+=":
        _change_rate(node, node.rate * FASTER)
    elif key in "-_":
        _change_rate(node, node.rate / FASTER)
    elif key == "q":
        node.done = True


def _change_rate(node: ReplayNode, rate: float) -> None:
    node.set_parameters([Parameter("rate", value=min(max(rate, SLOWEST), FASTEST))])
    node.get_logger().info(f"rate {node.rate:.4g}")

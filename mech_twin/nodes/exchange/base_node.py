# SPDX-License-Identifier: Apache-2.0
"""Base of every node of the twin: options, parameters, counted publishers, diagnostics, steady timers.

It does not depend on roles or machines, so that a process that only records or shows compiles no kernel.

`RunOptions` are the options of a run, the group ``run`` of the parameters; the machine has parameters of its own.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial, wraps
from typing import Any, Literal, TypeVar

from pydantic import ValidationError
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from mech_twin.declarations.quantity import LONGEST_RUN_S, Parameters, choice, quantity
from mech_twin.messages.cdr import CdrError, StepMessage, received_message
from mech_twin.messages.step_message import SOURCE, MessageError, marked
from mech_twin.messages.topics import DIAGNOSTICS, STREAM_RATE_HZ, PeakHoldWindow, StreamWindow, Topic, type_name
from mech_twin.nodes.exchange.counting import (
    CountingPublisher,
    DecimatedPublisher,
    NodeDiagnostics,
    StepPublisher,
    TopicStatistics,
    array_message,
)
from mech_twin.nodes.exchange.direct_exchange import HandOver, Listener, ReceivedBytes, ReceivedStep, Step
from mech_twin.nodes.exchange.parameter_bridge import declare_machine, declared_tree, given_parameters
from mech_twin.nodes.exchange.peers import new_source
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import RUN_GROUP, catalogue_entry, validated
from mech_twin.process.terminal_output import printable
from mech_twin.roles import own_name


class RunOptions(Parameters):
    """Pacing and length of a run, and the nodes that run with it."""

    pace: Literal["realtime", "max"] = choice("follow the wall clock, or run as fast as answers come", default="max")
    duration_s: float = quantity(
        "s", "simulated time to run; 0 runs until stopped", ge=0.0, le=LONGEST_RUN_S, default=0.0
    )
    step_count: int = quantity("1", "steps that service step takes", ge=1, le=1_000_000, default=1, live=True)
    reset_state: str = choice(
        "state to which service reset goes back, as get_state returned it; the initial one if empty",
        live=True,
        default="",
    )
    recorder: bool = choice("wait for a recorder before the first step", default=False)
    viewer: bool = choice("wait for a viewer before the first step", default=False)
    observer: bool = choice("wait for an observer of the steps", default=False)
    exclusive: bool = choice("refuse to start where somebody publishes this node's step messages", default=True)
    stream_rate_hz: float = quantity(
        "Hz",
        "messages per simulated second on decimated topics, up to one a step; more where something strikes",
        gt=0.0,
        default=STREAM_RATE_HZ,
    )
    view_rate_hz: float = quantity("Hz", "drawings per simulated second", gt=0.0, le=1000.0, default=30.0)
    peer_timeout_s: float = quantity("s", "silence after which a peer counts as gone", gt=0.0, default=0.5)
    discovery_limit_s: float = quantity("s", "longest wait for peers before the first step", gt=0.0, default=10.0)
    max_loss_s: float = quantity("s", "age at which a recorded message is on its way to the disk", gt=0.0, default=0.5)
    fsync: bool = choice("force each chunk of a recording to the disk, against loss of power", default=False)
    snapshot_s: float = quantity(
        "s",
        "record only what the last seconds before a trigger (service recorder/snapshot) or an alarm held; 0 everything",
        ge=0.0,
        le=600.0,
        default=0.0,
    )
    split_mib: float = quantity("MiB", "size at which a recording goes on in a new file", gt=0.0, default=512.0)
    split_s: float = quantity("s", "time after which it does; 0 never", ge=0.0, default=0.0)
    motor: str = choice("class in the place of the motor: MODULE:CLASS, or an entry point; none if empty", default="")
    forces: str = choice("class in the place of the force analysis, likewise", default="")
    body: str = choice("class in the place of the body, likewise", default="")


WINDOW_S = 1.0
PULSE_S = 0.1
Made = TypeVar("Made", bound=CountingPublisher)


class TwinNode(Node):
    """A node of the twin.

    Parameters
    ----------
    name : str
        Name of the node.
    machine_name : str
        Machine of the catalogue, or ``page``.  The namespace is this name, or the one that stands on the page.
    parameters : Parameters, optional
        Initial configuration; the installed file if absent.  ROS parameter overrides take precedence.
    options : RunOptions, optional
        How to run.

    Raises
    ------
    ConfigurationError
        If the parameters do not validate.
    """

    def __init__(
        self, name: str, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        called = machine_name if parameters is None else own_name(machine_name, parameters)
        super().__init__(name, namespace=f"/{called}")
        origin = f"parameters of node {name}"
        declare_machine(self, machine_name)
        entry = catalogue_entry(machine_name)
        defaults = parameters or given_parameters(self, entry)
        tree = declared_tree(self, ("", defaults), (f"{RUN_GROUP}.", options or RunOptions()))
        self.machine_name = machine_name
        self.options = _options(tree.pop(RUN_GROUP), f"{origin}, {RUN_GROUP} group")
        self.initial_parameters: Parameters = validated(entry, tree, origin)
        self.done = False
        self.quiet = False
        self.time_s = 0.0
        self.statistics = TopicStatistics()
        self.diagnostics = NodeDiagnostics(self.get_fully_qualified_name(), self.statistics)
        self.source = new_source()
        self.outputs: list[CountingPublisher] = []
        self._subscribed: list[Topic] = []
        self._of_other_types: set[tuple[int, ...]] = set()  # endpoints
        self._listeners: list[Listener] = []
        self._hand_over: HandOver | None = None
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._pulse_at: float | None = None
        self._diagnostics_out = self.output(DIAGNOSTICS)
        self.every(WINDOW_S, self.report)
        self.every(PULSE_S, self._pulse)

    # -- hooks of a subclass ----------------------------------------------------------------------------------------

    def diagnostic_values(self) -> Mapping[str, str]:
        """Return key-value pairs to add to the diagnostics status."""
        return {}

    def close(self) -> None:
        """Close the resources of this node other than its topics."""

    def settled(self) -> bool:
        """Return whether this node, about to end, waits for no further message."""
        return True

    @property
    def received(self) -> dict[str, int]:
        """Number of recorded messages by full topic name."""
        return {}

    def adopt(self, parameters: Parameters) -> None:
        """Switch to a model with other parameters, if this node has a model."""

    def resumed(self) -> None:
        """Restart time measurements after this process was suspended."""

    def check_peers(self, now_s: float) -> None:
        """Check whether a peer is missing; called ten times a second."""

    # -- time -------------------------------------------------------------------------------------------------------

    def every(self, period_s: float, call: Callable[[], None]) -> Timer:
        """Return a timer on the steady clock: jumps of the wall clock or of ``/clock`` have no effect on it."""
        return self.create_timer(period_s, call, clock=self._steady)

    def _pulse(self) -> None:
        """Detect that this process was suspended: stopped by a signal, or with more to do than it can."""
        now, before = time.monotonic(), self._pulse_at
        self._pulse_at = now
        if before is not None and now - before > self.options.peer_timeout_s + PULSE_S:
            self.statistics.count("process", "suspended", f"stopped or overloaded for {now - before:.1f} s")
            self.resumed()
        self.check_peers(now)

    # -- topics -----------------------------------------------------------------------------------------------------

    def subscribe(self, topic: Topic, call: Callable[[Any], None], **changes: Any) -> Subscription:
        """Return a new subscription; publishers of another type or quality of service are counted."""
        callbacks = SubscriptionEventCallbacks(incompatible_qos=partial(self.on_incompatible, topic.name, "publisher"))
        qos = changes.pop("qos", topic.qos)
        self._subscribed.append(topic)
        return self.create_subscription(topic.type, topic.name, call, qos, event_callbacks=callbacks, **changes)

    def subscribe_steps(
        self,
        topic: Topic,
        decode: Callable[[StepMessage], Any],
        take: Callable[[Any, Step], None],
        **changes: Any,
    ) -> None:
        """Subscribe to a topic of step messages; other messages are counted.

        Parameters
        ----------
        topic : Topic
            Topic to subscribe to.
        decode : callable
            Returns the sample of a message, or raises `MessageError`.
        take : callable
            Called with each sample and its step message.
        """

        def receive(received: ReceivedBytes) -> None:
            try:
                message = received_message(received.raw)
                sample = decode(message)
            except (CdrError, MessageError) as error:
                self.statistics.count(topic.name, "malformed", str(error))
            else:
                take(sample, ReceivedStep(message, listener.believed(marked(message, SOURCE), received)))

        listener = self.listen(topic, lambda step: take(step.sample, step), receive, **changes)

    def listen(
        self,
        topic: Topic,
        take: Callable[[Any], None],
        receive: Callable[[ReceivedBytes], None],
        patient: bool = False,
        **changes: Any,
    ) -> Listener:
        """Return a subscription: objects from nodes of the same executor, else bytes."""
        silence_s = self.options.peer_timeout_s
        listener = Listener(self.resolve_topic_name(topic.name), take, receive, patient, silence_s)
        subscription = self.subscribe(topic, with_info(listener.hear), raw=True, **changes)
        listener.publishers = subscription.handle.get_publisher_count
        self._listeners.append(listener)
        if self._hand_over is not None:
            self._hand_over.listen(listener)
        return listener

    def join(self, hand_over: HandOver) -> None:
        """Exchange steps as objects with the nodes that share this hand-over's executor."""
        self._hand_over = hand_over
        for listener in self._listeners:
            hand_over.listen(listener)
        for output in self.outputs:
            output.join(hand_over.channel(self.resolve_topic_name(output.name)))

    def leave(self) -> None:
        """Exchange steps as serialized bytes only."""
        hand_over, self._hand_over = self._hand_over, None
        if hand_over is None:
            return
        for output in self.outputs:
            output.leave()
        for listener in self._listeners:
            hand_over.leave(listener)

    def on_incompatible(self, topic: str, who: str, event: Any) -> None:
        """Count a publisher or subscriber whose quality of service does not fit."""
        policy = event.last_policy_kind.name.removeprefix("RMW_QOS_POLICY_").lower()
        self.statistics.count(topic, "incompatible", f"a {who} whose {policy} does not fit is not connected")

    def _count_other_types(self) -> None:
        """Count the publishers of other types on the node's topics: the middleware connects none, and says nothing."""
        for topic in self._subscribed:
            expected = type_name(topic)
            for end in self.get_publishers_info_by_topic(self.resolve_topic_name(topic.name)):
                endpoint = tuple(end.endpoint_gid)
                if end.topic_type != expected and endpoint not in self._of_other_types:
                    self._of_other_types.add(endpoint)
                    reason = f"{end.node_name} publishes {end.topic_type}, which is not connected; expected {expected}"
                    self.statistics.count(topic.name, "incompatible", reason)

    def output(self, topic: Topic, peers: int = 0, *, recorded: bool = True) -> CountingPublisher:
        """Return a new counted publisher; ``peers`` subscribers and the recorder must match before the first step."""
        return self._added(CountingPublisher(self, topic, peers + (recorded and self.options.recorder)))

    def step_output(self, topic: Topic, peers: int) -> StepPublisher:
        """Return the publisher of a step message, to which viewer and observer subscribe as well."""
        listeners = peers + self.options.recorder + self.options.viewer + self.options.observer
        return self._added(StepPublisher(self, topic, listeners))

    def decimated_output(
        self,
        topic: Topic,
        window: StreamWindow[Any] | PeakHoldWindow[Any],
        message: Callable[[Any], Any],
    ) -> DecimatedPublisher:
        """Return a new publisher of the messages that a window passes."""
        return self._added(DecimatedPublisher(self, topic, int(self.options.recorder), window, message))

    def _added(self, made: Made) -> Made:
        self.outputs.append(made)
        if self._hand_over is not None:
            made.join(self._hand_over.channel(self.resolve_topic_name(made.name)))
        return made

    @property
    def matched(self) -> bool:
        """Whether all required subscribers of this node are matched."""
        return all(output.matched for output in self.outputs)

    def flush(self) -> None:
        """Publish the messages still held by decimated topics."""
        for output in self.outputs:
            output.flush()

    # -- diagnostics ------------------------------------------------------------------------------------------------

    def report(self) -> None:
        """Publish the diagnostics of the window (`WINDOW_S`) that ends now."""
        if self.quiet:
            return
        self._count_other_types()
        sent = {f"sent {output.name}": str(output.sent) for output in self.outputs}
        status, lines = self.diagnostics.close_window({**sent, **self.diagnostic_values()})
        for line in lines:
            self.get_logger().warning(printable(line))
        self._diagnostics_out.send(array_message(self.time_s, status))


def with_info(hear: Callable[[bytes, Mapping[str, Any]], None]) -> Callable[..., None]:
    """Return a callback with message and info arguments, for rclpy's events executor, which passes them as one."""

    @wraps(hear)
    def call(*arguments: Any) -> None:
        raw, info = arguments if len(arguments) > 1 else arguments[0]
        hear(raw, info)

    return call


def _options(tree: Mapping[str, Any], source: str) -> RunOptions:
    try:
        return RunOptions.model_validate(tree)
    except ValidationError as error:
        raise refusal(source, error, RunOptions) from error


def sent_messages(nodes: Iterable[TwinNode]) -> dict[str, int]:
    """Return the number of messages published by the nodes, by full topic name."""
    total: dict[str, int] = {}
    for node in nodes:
        for output in node.outputs:
            name = node.resolve_topic_name(output.name)
            total[name] = total.get(name, 0) + output.sent
    return total

# SPDX-License-Identifier: Apache-2.0
"""What every node of the twin shares: options, parameters, counted publishers, diagnostics, steady timers.

Nothing here knows a role or builds a machine, so that a process that only records or shows compiles no kernel.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from pydantic import ValidationError
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from mech_twin.messages.joint_state_cdr import CdrError, StepMessage, received_message
from mech_twin.messages.topics import DIAGNOSTICS, Topic
from mech_twin.nodes.counting_publisher import CountingPublisher, JointStatePublisher, PeakHoldPublisher, StepPublisher
from mech_twin.nodes.diagnostics import NodeDiagnostics, array_message
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.parameter_bridge import declare_machine, declared_tree
from mech_twin.nodes.topic_statistics import TopicStatistics
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import RUN_GROUP, catalogue_entry, machine_parameters, validated
from mech_twin.quantity import Parameters

WINDOW_S = 1.0
PULSE_S = 0.1


class TwinNode(Node):
    """A node of the twin.

    Parameters
    ----------
    name : str
        Name of the node.
    machine_name : str
        Machine of the catalogue, and the namespace.
    parameters : Parameters, optional
        Configuration to start from; the installed file if absent.  ROS parameter overrides are laid over it.
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
        super().__init__(name, namespace=f"/{machine_name}")
        source = f"parameters of node {name}"
        declare_machine(self, machine_name)
        defaults = parameters or machine_parameters(machine_name)
        tree = declared_tree(self, ("", defaults), (f"{RUN_GROUP}.", options or RunOptions()))
        self.machine_name = machine_name
        self.options = _options(tree.pop(RUN_GROUP), source)
        self.initial_parameters: Parameters = validated(catalogue_entry(machine_name), tree, source)
        self.done = False
        self.quiet = False
        self.time_s = 0.0
        self.statistics = TopicStatistics()
        self.diagnostics = NodeDiagnostics(self.get_fully_qualified_name(), self.statistics)
        self.outputs: list[CountingPublisher] = []
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._pulse_at: float | None = None
        self._diagnostics_out = self.output(DIAGNOSTICS)
        self.every(WINDOW_S, self.report)
        self.every(PULSE_S, self._pulse)

    # -- what a node may add ----------------------------------------------------------------------------------------

    def diagnostic_values(self) -> Mapping[str, str]:
        """Return further values for the diagnostics."""
        return {}

    def close(self) -> None:
        """Let go of what this node holds open beside its topics."""

    def quiet_s(self) -> float:
        """Return for how long this node has heard nothing it must keep."""
        return float("inf")

    @property
    def received(self) -> dict[str, int]:
        """Messages recorded, by full topic name."""
        return {}

    def resumed(self) -> None:
        """Begin measuring time anew, after this process was suspended."""

    def check_peers(self, now_s: float) -> None:
        """Look whether somebody is missing; called ten times a second."""

    # -- time -------------------------------------------------------------------------------------------------------

    def every(self, period_s: float, call: Callable[[], None]) -> Timer:
        """Return a timer on the steady clock: a step of the wall clock, or somebody's ``/clock``, does not touch it."""
        return self.create_timer(period_s, call, clock=self._steady)

    def _pulse(self) -> None:
        """Notice that this process itself was suspended (by a signal, or for want of a processor)."""
        now, before = time.monotonic(), self._pulse_at
        self._pulse_at = now
        if before is not None and now - before > self.options.peer_timeout_s + PULSE_S:
            self.statistics.count("process", "suspended", f"no processor time for {now - before:.1f} s")
            self.resumed()
        self.check_peers(now)

    # -- topics -----------------------------------------------------------------------------------------------------

    def subscribe(self, topic: Topic, call: Callable[[Any], None], **changes: Any) -> Subscription:
        """Return a new subscription; a publisher whose quality of service does not fit is counted."""
        callbacks = SubscriptionEventCallbacks(incompatible_qos=partial(self._on_incompatible, topic.name, "publisher"))
        qos = changes.pop("qos", topic.qos)
        return self.create_subscription(topic.type, topic.name, call, qos, event_callbacks=callbacks, **changes)

    def subscribe_steps(self, topic: Topic, call: Callable[[StepMessage], None], **changes: Any) -> Subscription:
        """Return a new subscription to a topic of step messages; what is none is counted."""

        def receive(raw: bytes) -> None:
            try:
                message = received_message(raw)
            except CdrError as error:
                self.statistics.count(topic.name, "malformed", str(error))
            else:
                call(message)

        return self.subscribe(topic, receive, raw=True, **changes)

    def _on_incompatible(self, topic: str, who: str, event: Any) -> None:
        policy = event.last_policy_kind.name.removeprefix("RMW_QOS_POLICY_").lower()
        self.statistics.count(topic, "incompatible", f"a {who} whose {policy} does not fit is not connected")

    def output(self, topic: Topic, peers: int = 0, *, recorded: bool = True) -> CountingPublisher:
        """Return a new counted publisher; so many peers, and the recorder, must listen before the first step."""
        listeners = peers + (recorded and self.options.recorder)
        return self._added(CountingPublisher(self, topic, listeners, self._told(topic)))

    def step_output(self, topic: Topic, peers: int) -> StepPublisher:
        """Return the publisher of a step message, which a viewer and an observer listen to as well."""
        listeners = peers + self.options.recorder + self.options.viewer + self.options.observer
        made = StepPublisher(self, topic, listeners, self._told(topic))
        self._added(made)
        return made

    def peak_hold_output(self, topic: Topic, window: int, message: Callable[[Any], Any]) -> PeakHoldPublisher:
        """Return a new publisher that keeps the greatest message of each window of steps."""
        made = PeakHoldPublisher(self, topic, int(self.options.recorder), window, message, self._told(topic))
        self._added(made)
        return made

    def joint_state_output(
        self, topic: Topic, window: int, message: Callable[[Any], StepMessage]
    ) -> JointStatePublisher:
        """Return a new publisher of joint states, one a window of steps and more around impacts."""
        made = JointStatePublisher(self, topic, int(self.options.recorder), window, message, self._told(topic))
        self._added(made)
        return made

    def _added(self, made: CountingPublisher) -> CountingPublisher:
        self.outputs.append(made)
        return made

    def _told(self, topic: Topic) -> Callable[[Any], None]:
        return partial(self._on_incompatible, topic.name, "subscriber")

    @property
    def matched(self) -> bool:
        """Whether everybody who must hear this node does."""
        return all(output.matched for output in self.outputs)

    def flush(self) -> None:
        """Publish what decimated topics still hold."""
        for output in self.outputs:
            output.flush()

    # -- diagnostics ------------------------------------------------------------------------------------------------

    def report(self) -> None:
        """Publish the diagnostics of the window that ends now."""
        if self.quiet:
            return
        sent = {f"sent {output.name}": str(output.sent) for output in self.outputs}
        status, lines = self.diagnostics.close_window({**sent, **self.diagnostic_values()})
        for line in lines:
            self.get_logger().warning(line)
        self._diagnostics_out.send(array_message(self.time_s, status))


def _options(tree: Mapping[str, Any], source: str) -> RunOptions:
    try:
        return RunOptions.model_validate(tree)
    except ValidationError as error:
        raise refusal(source, error, RunOptions) from error


def sent_messages(nodes: Iterable[TwinNode]) -> dict[str, int]:
    """Return how many messages nodes have published, by full topic name."""
    total: dict[str, int] = {}
    for node in nodes:
        for output in node.outputs:
            name = node.resolve_topic_name(output.name)
            total[name] = total.get(name, 0) + output.sent
    return total

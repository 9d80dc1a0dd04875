"""What the four role nodes share: parameters, outlets, diagnostics, and following the linkage's configuration."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.engine.run import warm_up
from mech_twin.messages.rows import SOURCE, mark
from mech_twin.messages.topics import DESCRIPTION, DIAGNOSTICS, Topic
from mech_twin.messages.wire import Decoder, StepMessage, WireError
from mech_twin.nodes.health import Health, array_message
from mech_twin.nodes.ledger import Ledger
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.outlet import ExtremeOutlet, Outlet, StepOutlet
from mech_twin.nodes.parameter_bridge import declared_tree, keys
from mech_twin.nodes.voice import new_source
from mech_twin.parameters.load import RUN_GROUP, catalogue_entry, description, machine_parameters, validated
from mech_twin.quantity import Parameters
from mech_twin.roles import Machine
from mech_twin.samples import Sample

WINDOW_S = 1.0
RETRY_S = 0.02
ASK_AGAIN_S = 0.3
PULSE_S = 0.1


def _unnoticed(sample: Sample) -> None:
    """Take a sample nobody watches."""


class RoleNode(Node):
    """A node that is a shell around one role of a machine.

    Parameters
    ----------
    role : str
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
        self, role: str, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__(role, namespace=f"/{machine_name}")
        defaults = parameters or machine_parameters(machine_name)
        tree = declared_tree(self, ("", defaults), (f"{RUN_GROUP}.", options or RunOptions()))
        source = f"parameters of node {role}"
        self.options = RunOptions.model_validate(tree.pop(RUN_GROUP))
        self.machine: Machine = catalogue_entry(machine_name).build(
            validated(catalogue_entry(machine_name), tree, source)
        )
        warm_up(self.machine)
        self.revision = 0
        self.time_s = 0.0
        self.description = ""
        self.quiet = False
        self.on_sample: Callable[[Sample], None] = _unnoticed
        self.source = new_source()
        self.ledger = Ledger()
        self.outlets: list[Outlet] = []
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._pulse_at: float | None = None
        self._adopting = False
        self._awaiting_revision: tuple[int, Callable[[], None]] | None = None
        self._diagnostics = self.outlet(DIAGNOSTICS)
        self.health = Health(self.get_fully_qualified_name(), self.ledger, self.residual_limits())
        self.every(WINDOW_S, self.report)
        self.every(PULSE_S, self._pulse)
        self.add_on_set_parameters_callback(self.judge_parameters)

    # -- what a role node says about itself -------------------------------------------------------------------------

    def residual_limits(self) -> Mapping[str, float]:
        """Return the limit of each residual this node publishes."""
        return {}

    def figures(self) -> Mapping[str, str]:
        """Return further values for the diagnostics."""
        return {}

    def close(self) -> None:
        """Let go of what this node holds open beside its topics."""

    def quiet_s(self) -> float:
        """Return for how long this node has heard nothing it must keep."""
        return float("inf")

    # -- time -------------------------------------------------------------------------------------------------------

    def every(self, period_s: float, call: Callable[[], None]) -> Timer:
        """Return a timer on the steady clock: a step of the wall clock, or somebody's ``/clock``, does not touch it."""
        return self.create_timer(period_s, call, clock=self._steady)

    def _pulse(self) -> None:
        """Notice that this process itself has stood still (stopped by a signal, or starved)."""
        now, before = time.monotonic(), self._pulse_at
        self._pulse_at = now
        if before is not None and now - before > self.options.peer_timeout_s + PULSE_S:
            self.ledger.count("process", "stopped", f"stood still for {now - before:.1f} s")
            self.woken()
        self.attend(now)

    def woken(self) -> None:
        """Begin measuring time anew, after this process has stood still."""

    def attend(self, now: float) -> None:
        """Look whether somebody is missing; called ten times a second."""

    # -- inlets -----------------------------------------------------------------------------------------------------

    def hear(self, topic: Topic, call: Callable[[Any], None], **changes: Any) -> Subscription:
        """Return a new subscription; a publisher whose quality of service does not fit is counted."""
        callbacks = SubscriptionEventCallbacks(incompatible_qos=partial(self._on_incompatible, topic.name, "publisher"))
        qos = changes.pop("qos", topic.qos)
        return self.create_subscription(topic.type, topic.name, call, qos, event_callbacks=callbacks, **changes)

    def hear_steps(self, topic: Topic, call: Callable[[StepMessage], None], **changes: Any) -> Subscription:
        """Return a new subscription to a topic of step messages; what is none is counted."""
        decode = Decoder()

        def receive(raw: bytes) -> None:
            try:
                message = decode(raw)
            except WireError as error:
                self.ledger.count(topic.name, "malformed", str(error))
            else:
                call(message)

        return self.hear(topic, receive, raw=True, **changes)

    def _on_incompatible(self, topic: str, who: str, event: Any) -> None:
        policy = event.last_policy_kind.name.removeprefix("RMW_QOS_POLICY_").lower()
        self.ledger.count(topic, "incompatible", f"a {who} whose {policy} does not fit is not connected")

    # -- outlets ----------------------------------------------------------------------------------------------------

    def listeners(self, peers: int) -> int:
        """Return how many subscribers a topic must have before the first step."""
        return peers + self.options.recorder

    def outlet(self, topic: Topic, peers: int = 0) -> Outlet:
        """Return a new counted publisher."""
        told = partial(self._on_incompatible, topic.name, "subscriber")
        made = Outlet(self, topic, self.listeners(peers), told)
        self.outlets.append(made)
        return made

    def step_outlet(self, topic: Topic, peers: int) -> StepOutlet:
        """Return the publisher of a step message, which a viewer listens to as well."""
        told = partial(self._on_incompatible, topic.name, "subscriber")
        listeners = self.listeners(peers + self.options.viewer + self.options.watcher)
        made = StepOutlet(self, topic, listeners, told)
        self.outlets.append(made)
        return made

    def extreme_outlet(self, topic: Topic) -> ExtremeOutlet:
        """Return a new decimated publisher that keeps extremes."""
        told = partial(self._on_incompatible, topic.name, "subscriber")
        made = ExtremeOutlet(self, topic, self.listeners(0), self.options.stream_decimation, told)
        self.outlets.append(made)
        return made

    def signed(self, message: JointState) -> JointState:
        """Return a step message with the row that says which node it comes from."""
        return mark(message, SOURCE, self.source)

    @property
    def matched(self) -> bool:
        """Whether everybody who must hear this node does."""
        return all(outlet.matched for outlet in self.outlets)

    def flush(self) -> None:
        """Publish what decimated topics still hold."""
        for outlet in self.outlets:
            if isinstance(outlet, ExtremeOutlet):
                outlet.flush()

    # -- configuration ----------------------------------------------------------------------------------------------

    def follow_description(self) -> None:
        """Take the configuration from the linkage, which owns it."""
        self.hear(DESCRIPTION, self._on_description)

    def _on_description(self, message: String) -> None:
        try:
            described = description(message.data)
        except ValueError as error:
            self.ledger.count(DESCRIPTION.name, "malformed", str(error))
            return
        if described.machine != self.machine.name:
            self.ledger.count(DESCRIPTION.name, "foreign", f"machine {described.machine}")
            return
        self.use(described.parameters)
        self.revision = described.revision
        self.description = message.data
        if self._awaiting_revision and self._awaiting_revision[0] <= self.revision:
            resume = self._awaiting_revision[1]
            self._awaiting_revision = None
            resume()

    def use(self, parameters: Parameters) -> None:
        """Rebuild the role from new parameters, and show them as this node's own."""
        if parameters == self.machine.parameters:
            return
        before = {key.name: key.value for key in keys(self.machine.parameters)}
        self.machine = catalogue_entry(self.machine.name).build(parameters)
        changed = [
            Parameter(key.name, value=key.value)
            for key in keys(parameters)
            if key.live and key.value != before.get(key.name)
        ]
        self._adopting = True
        try:
            self.set_parameters(changed)
        finally:
            self._adopting = False

    def at_revision(self, number: int, then: Callable[[], None]) -> bool:
        """Return whether this configuration is in force; if not, ``then`` is called once it is."""
        if number <= self.revision:
            return True
        self._awaiting_revision = (number, then)
        return False

    def judge_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse a change made here: the linkage passes parameters on, so that all roles change at one step."""
        if self._adopting:
            return SetParametersResult(successful=True)
        names = ", ".join(change.name for change in changes)
        return SetParametersResult(successful=False, reason=f"{names}: set it on node linkage, which passes it on")

    # -- diagnostics ------------------------------------------------------------------------------------------------

    def report(self) -> None:
        """Publish the diagnostics of the window that ends now."""
        if self.quiet:
            return
        sent = {f"sent {outlet.name}": str(outlet.sent) for outlet in self.outlets}
        status, lines = self.health.close_window({**sent, **self.figures()})
        for line in lines:
            self.get_logger().warning(line)
        self._diagnostics.send(array_message(self.time_s, status))


def dismiss(nodes: Sequence[RoleNode]) -> None:
    """Close what is open and take the nodes down."""
    for node in nodes:
        node.close()
    for node in nodes:
        node.destroy_node()

# SPDX-License-Identifier: Apache-2.0
"""A shadow from start to end: checks its name, serves its nodes until a signal or the end of its time.

Its inputs and outputs are recorded in one bag, or the seconds around a fault (the black box).
"""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from pydantic import ValidationError
from rclpy.signals import SignalHandlerOptions

from mech_twin.capabilities.variation import varied
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.messages.topics import (
    DECISIONS,
    DIAGNOSTICS,
    ESTIMATED,
    EVERY,
    RESIDUALS,
    TWIN,
    Topic,
    shadow_topics,
    type_name,
)
from mech_twin.nodes.exchange.base_node import TwinNode, sent_messages
from mech_twin.nodes.exchange.direct_exchange import Handed, ReceivedBytes
from mech_twin.nodes.exchange.parameter_bridge import watch_parameters
from mech_twin.nodes.exchange.spinner import Spinner, destroy_nodes
from mech_twin.nodes.roles.recorder_node import REPAIR_S
from mech_twin.nodes.run.domain import ros_arguments, run_namespace
from mech_twin.nodes.run.name_guard import NameGuard
from mech_twin.nodes.shadow.advisor_node import AdvisorNode
from mech_twin.nodes.shadow.identifier_node import IdentifierNode
from mech_twin.nodes.shadow.inputs import Admitted, FollowedTopic, StampGate
from mech_twin.nodes.shadow.monitor_node import AlertOutlet, MonitorNode
from mech_twin.nodes.shadow.shadow_node import ShadowNode, ShadowSetup
from mech_twin.parameters.description import description_text
from mech_twin.parameters.live_change import live_numbers
from mech_twin.parameters.load import catalogue_entry
from mech_twin.process.interruption import StopSignal
from mech_twin.recording.bag_contents import RecentMessage, RecentMessages, stamp_ns
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.errors import BagError
from mech_twin.recording.measured_topics import SECOND_NS
from mech_twin.recording.schemas import offered_qos
from mech_twin.studies.advice import AdviceWish
from mech_twin.studies.advice_search import COMMAND
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.observer.estimate import SeenSample

TICK_S = 0.1
BEFORE_S, AFTER_S = 10.0, 5.0


class ShadowTopics(NamedTuple):
    """Topics that the shadow publishes, and those it subscribes to."""

    own: tuple[Topic, ...]
    followed: tuple[FollowedTopic, ...]


class ShadowListener(TwinNode):
    """Hears the topics of the machine and of its shadow; see `TwinNode` for the other arguments.

    The shadow passes on what it receives from the machine (`hear`), so each message is received once.

    The log time of a message is its stamp if that is accepted (`FollowedClock`) and not earlier than the newest one,
    else the newest.  Rejected stamps are counted; until one is accepted, messages are held.

    Parameters
    ----------
    topics : ShadowTopics
        Topics to hear.
    """

    def __init__(
        self,
        name: str,
        machine_name: str,
        topics: ShadowTopics,
        parameters: Parameters | None = None,
    ) -> None:
        super().__init__(name, machine_name, parameters)
        self.admission = StampGate[tuple[str, bytes]]()
        self._jumps = self._logged_ns = 0
        followed = tuple(each.topic for each in topics.followed)
        self._has_stamps = any(each.has_stamps for each in topics.followed)
        self._lags_ns = {each.topic.name: round(each.lag_s * SECOND_NS) for each in topics.followed}
        self.topics = {self.resolve_topic_name(topic.name): topic for topic in (*topics.own, DIAGNOSTICS, *followed)}
        self.described = description_text(machine_name, self.initial_parameters)
        self._kinds = {full: type_name(topic) for full, topic in self.topics.items()}
        for topic in (*topics.own, DIAGNOSTICS):
            received = partial(self.hear, self.resolve_topic_name(topic.name))
            self.listen(topic, received, received, qos=EVERY)
        self.every(TICK_S, self.tick_writer)

    def take(self, message: RecentMessage) -> None:
        """Store a message."""
        raise NotImplementedError

    def tick_writer(self) -> None:
        """Run the periodic tasks, ten times a second."""
        raise NotImplementedError

    def adopt(self, parameters: Parameters) -> None:
        """Use other parameters as description in the bags opened from now on."""
        self.described = description_text(self.machine_name, parameters)

    def opened(self, directory: Path) -> BagWriter:
        """Return a new bag with the topics declared."""
        writer = BagWriter(directory, configuration=self.described)
        for full, topic in self.topics.items():
            writer.add_topic(full, type_name(topic), offered_qos(durability="volatile", depth=topic.qos.depth))
        return writer

    @property
    def newest_s(self) -> float:
        """The machine's newest time (s); 0 if none is known."""
        return (self.admission.clock.now_ns or 0) / SECOND_NS

    def release(self) -> None:
        """Store the held messages, at the end of a shadow without a known time."""
        for found in self.admission.released():
            self._keep(found)

    def hear(self, full: str, message: Handed | ReceivedBytes) -> None:
        """Store a message of the topic of this full name."""
        now_s, raw = time.monotonic(), message.raw
        led_ns = self._led_ns(full, self._kinds[full], raw, now_s)
        for found in self.admission.take((full, raw), led_ns, now_s):
            self._keep(found)
            if found.stamp_ns is not None and not found.believed:
                reason = f"a stamp that does not go on from {found.at_ns / SECOND_NS:.3f} s, at which it is recorded"
                self.statistics.count(found.item[0], "unknown_source", reason)

    def _led_ns(self, full: str, kind: str, raw: bytes, now_s: float) -> int | None:
        """Return the machine's time (ns) in a message; for a machine without stamps that of the steady clock."""
        if full not in self._lags_ns:
            return None
        stamp = stamp_ns(kind, raw) if self._has_stamps else round(now_s * SECOND_NS)
        return None if stamp is None else stamp - self._lags_ns[full]

    def _keep(self, found: Admitted[tuple[str, bytes]]) -> None:
        topic, raw = found.item
        at_ns = found.at_ns + self._lags_ns.get(topic, 0)
        if self._jumps == self.admission.clock.jumps:
            at_ns = max(at_ns, self._logged_ns)
        self._jumps, self._logged_ns = self.admission.clock.jumps, at_ns
        self.take(RecentMessage(topic, raw, at_ns))


class ShadowRecorder(ShadowListener):
    """Writes all messages to one bag.

    Parameters
    ----------
    directory : Path
        The recording to make.
    """

    def __init__(
        self, machine_name: str, directory: Path, topics: ShadowTopics, parameters: Parameters | None = None
    ) -> None:
        super().__init__("shadow_recorder", machine_name, topics, parameters)
        self.writer = self.opened(directory)

    @property
    def received(self) -> dict[str, int]:
        """Number of messages received, by full topic name."""
        return {name: row.received for name, row in self.writer.counters.items()}

    def take(self, message: RecentMessage) -> None:
        """Write a message."""
        self.writer.write(message.topic, message.raw, message.at_ns, message.at_ns)

    def tick_writer(self) -> None:
        """Let the writer write due data to the disk, and report its state."""
        self.time_s = self.newest_s
        self.writer.tick()
        self.diagnostics.state = self.writer.state.value
        if self.writer.state is WriterState.ERROR:
            self.diagnostics.error(self.writer.error)

    def close(self) -> None:
        """Finish the recording; one in which nothing was recorded is deleted."""
        self.release()
        self.writer.close(discard_empty=True)


class BlackBox(ShadowListener):
    """Stores the last 10 s, and writes them and the next 5 s to a separate bag when a fault becomes active.

    A fault within those 5 s prolongs the bag.

    Parameters
    ----------
    directory : Path
        Folder of the bags; each is named after its fault and stamp, with a number if the name exists already.
    """

    def __init__(
        self, machine_name: str, directory: Path, topics: ShadowTopics, parameters: Parameters | None = None
    ) -> None:
        super().__init__("black_box", machine_name, topics, parameters)
        self.bags: list[Path] = []
        self.failed: list[str] = []
        self._directory = directory
        self._recent = RecentMessages(BEFORE_S)
        self._writer: BagWriter | None = None
        self._since_ns, self._until_ns = 0, 0
        self.diagnostics.state = "no fault yet"

    def trigger(self, fault: str, time_s: float) -> None:
        """Write the seconds around a fault that became active at a time (s)."""
        self._until_ns = round((time_s + AFTER_S) * SECOND_NS)
        if self._writer is not None:
            return
        words = "_".join("".join(sign if sign.isalnum() else " " for sign in fault).split())
        place = _unused(self._directory / f"{words}-{round(time_s * 1000):d}")
        try:
            self._writer = self.opened(place)
        except BagError as error:  # the shadow continues without this bag
            self.failed.append(f"no black box: {error}")
            self.diagnostics.error(self.failed[-1])
            return
        self.bags.append(place)
        self.diagnostics.state = f"writing {place}"
        self._since_ns = round((time_s - BEFORE_S) * SECOND_NS)
        for message in self._recent.kept:
            if message.at_ns >= self._since_ns:
                self._writer.write(message.topic, message.raw, message.at_ns, message.at_ns)

    def take(self, message: RecentMessage) -> None:
        """Store a message, and write it near a fault."""
        self._recent.take(message)
        if self._writer is None:
            return
        if not self._since_ns <= message.at_ns <= self._until_ns:  # over, or the machine was restarted
            self.close()
        else:
            self._writer.write(message.topic, message.raw, message.at_ns, message.at_ns)

    def tick_writer(self) -> None:
        """Let the writer write due data to the disk."""
        self.time_s = self.newest_s
        if self._writer is not None:
            self._writer.tick()

    def close(self) -> None:
        """Finish the present bag."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
            self.diagnostics.state = f"wrote {self.bags[-1]}"


def _unused(place: Path) -> Path:
    """Return a path that does not exist: the given one, or that with a number."""
    numbered = (place.with_name(f"{place.name}-{number}") for number in count(2))
    return next(each for each in chain([place], numbered) if not (each.exists() or each.is_symlink()))


class ShadowOutcome(NamedTuple):
    """Result of a shadow: last diagnostic values, messages sent by topic, bags of the black box, failed bags.

    ``silent`` are the machine's topics, if none has brought a sample.
    """

    values: dict[str, str]
    sent: dict[str, int]
    black_boxes: tuple[Path, ...] = ()
    failed_boxes: tuple[str, ...] = ()
    silent: tuple[str, ...] = ()


class FreeKeys(NamedTuple):
    """Keys that may be identified, and bounds of some of them."""

    keys: tuple[str, ...]
    bounds: dict[str, tuple[float, float]]


class Company(NamedTuple):
    """Options of the nodes beside a shadow: recording, monitor, black box, advisor, view, alert outlets, free keys."""

    record: Path | None = None
    monitor: MonitorSetup | None = None
    black_box: Path | None = None
    advice: AdviceWish | None = None
    view: str | None = None
    outlets: Sequence[AlertOutlet] = ()
    free: FreeKeys | None = None


ALONE = Company()


def followed_namespace(own_name: str, namespace: str) -> str:
    """Return the full namespace of the machine that is followed.

    Raises
    ------
    ConfigurationError
        It is not a valid ROS namespace, or is the shadow's own.
    """
    try:
        full = run_namespace(own_name, namespace)
    except ConfigurationError as error:
        raise ConfigurationError(str(error).replace("--namespace", "--from", 1)) from error
    own = f"/{own_name}/{TWIN}"
    if f"{full}/".startswith(f"{own}/"):
        raise ConfigurationError(f"--from {namespace}: expected the machine's namespace, {own} is the shadow's own")
    return full


def follow(
    machine_name: str,
    setup: ShadowSetup,
    parameters: Parameters,
    company: Company = ALONE,
    duration_s: float = 0.0,
    ready: Callable[[ShadowNode], None] = lambda node: None,
    own_name: str | None = None,
) -> ShadowOutcome:
    """Follow a machine until a signal, or for a duration.

    Parameters
    ----------
    machine_name, setup, parameters
        The model, and the setup of the shadow.
    company : Company
        Options of the nodes beside it.
    duration_s : float
        Time (s) after which it ends by itself; 0: never.
    ready : callable
        Called with the node when it has subscribed.
    own_name : str, optional
        Name below which it publishes, such as a page's own; the machine's if absent.

    Raises
    ------
    NameInUseError
        Another shadow of this machine is alive.
    """
    own = own_name or machine_name
    moved = None if own == machine_name else own
    rclpy.init(args=ros_arguments(machine_name, moved), signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[TwinNode] = []
    with StopSignal() as signal, ExitStack() as at_end, ExitStack() as starting:
        at_end.callback(rclpy.try_shutdown)
        at_end.callback(destroy_nodes, nodes)
        starting.enter_context(signal.interrupting())
        guard = at_end.enter_context(NameGuard([f"/{own}/{topic.name}" for topic in (ESTIMATED, RESIDUALS)]))
        node = ShadowNode(machine_name, setup, parameters)
        nodes.append(node)
        guard.check(own_publishers=1)
        starting.close()
        nodes += nodes_beside(machine_name, node, parameters, company)
        ready(node)
        end_s = time.monotonic() + duration_s if duration_s > 0.0 else float("inf")
        with Spinner(nodes) as spinner:
            spinner.serve(lambda: signal.asked or time.monotonic() > end_s)
            record_decisions(spinner, nodes)
        node.report()
        boxes = [each for each in nodes if isinstance(each, BlackBox)]
        bags = tuple(bag for box in boxes for bag in box.bags)
        failed = tuple(line for box in boxes for line in box.failed)
        values = {name: value for each in nodes for name, value in each.diagnostic_values().items()}
        return ShadowOutcome(values, sent_messages(nodes), bags, failed, node.silent_topics)


def record_decisions(spinner: Spinner, nodes: Sequence[TwinNode]) -> None:
    """End the trial of an advisor, and wait until the recorder has its decisions, which may be sent again."""
    recorders = [each for each in nodes if isinstance(each, ShadowRecorder)]
    advisor = next((each for each in nodes if isinstance(each, AdvisorNode)), None)
    if advisor is not None:
        advisor.close()
        name, end_s = advisor.resolve_topic_name(DECISIONS.name), time.monotonic() + REPAIR_S
        sent = sent_messages([advisor])[name]
        spinner.until(lambda: all(each.received[name] >= sent for each in recorders) or time.monotonic() > end_s)


def nodes_beside(machine_name: str, node: ShadowNode, parameters: Parameters, company: Company) -> list[TwinNode]:
    """Return recorder, monitor, black box, advisor, identifier and viewer of a shadow, connected to it."""
    machine = catalogue_entry(machine_name).build(parameters)
    topics = ShadowTopics(shadow_topics(machine.forces.pins, machine.body is not None), tuple(node.followed))
    found: list[TwinNode] = []
    monitor = advisor = identifier = None
    if company.monitor is not None:
        monitor = MonitorNode(machine_name, company.monitor, node.columns, node.origin, parameters)
        monitor.outlets = company.outlets
        node.at_sample.append(monitor.observe)
        node.at_other_time.append(monitor.live.begin_anew)
        found.append(monitor)
        if company.black_box is not None:
            box = BlackBox(machine_name, company.black_box, topics, parameters)
            monitor.on_active = lambda life: box.trigger(life.name, node.origin.clock_s(life.since_s))
            found.append(box)
    if company.advice is not None:
        advisor = advisor_beside(machine_name, node, parameters, company.advice, monitor)
        found.append(advisor)
    if company.free is not None:
        free = company.free
        identifier = IdentifierNode(machine_name, node.channels, free.keys, free.bounds, parameters)
        feed(node, identifier)
        node.at_command.append(identifier.recent.command)
        node.at_other_time.append(identifier.recent.forget)
        found.append(identifier)
    if company.view is not None:
        from mech_twin.nodes.shadow.viewer_node import ShadowViewerNode

        viewer = ShadowViewerNode(machine_name, company.view, node, monitor, advisor, identifier, parameters)
        node.on_estimate = viewer.take
        found.append(viewer)
    if company.record is not None:  # after all that may refuse: a failed start leaves no recording
        found.append(ShadowRecorder(machine_name, company.record, topics, parameters))
    node.at_message += [each.hear for each in found if isinstance(each, ShadowListener)]
    if identifier is not None:
        identifier.at_taken = [each.adopt for each in (node, *found)]  # the monitor's reference is unchanged
    watch_parameters(node, node.setup.namespace, partial(follow_setting, (node, *found)))
    return found


def follow_setting(nodes: Sequence[TwinNode], key: str, value: Any) -> None:
    """Let the model of a shadow, the first of these nodes, have a live parameter that was changed at the machine."""
    shadow = nodes[0]
    assert isinstance(shadow, ShadowNode)
    if live_numbers(shadow.model).get(key, value) == value:  # none of the model's, or no change
        return
    try:
        model = varied(shadow.model, {key: value})
    except ValidationError:
        shadow.get_logger().warning(f"the model cannot have the machine's new {key}, {value}")
        return
    shadow.get_logger().info(f"the machine's {key} is now {value}, and so is the model's")
    for each in nodes:
        each.adopt(model)
        if isinstance(each, IdentifierNode):
            each.begin_anew(model)


def feed(node: ShadowNode, beside: AdvisorNode | IdentifierNode) -> None:
    """Let a node beside a shadow observe each of its samples, at the machine's time."""

    def observe(sample: SeenSample) -> None:
        beside.time_s = node.origin.clock_s(sample.time_s)
        beside.observe(sample)

    node.at_sample.append(observe)


def advisor_beside(
    machine_name: str, node: ShadowNode, parameters: Parameters, wish: AdviceWish, monitor: MonitorNode | None
) -> AdvisorNode:
    """Return the advisor of a shadow, fed with its samples and with the faults of the monitor, if there is one."""
    advisor = AdvisorNode(machine_name, wish, node.setup.namespace, node.columns, node.origin, parameters)
    feed(node, advisor)
    node.at_other_time.append(advisor.begin_anew)
    node.at_command.append(partial(advisor.on_setting, COMMAND))
    node.is_obeyed = lambda: advisor.state.in_force
    if monitor is not None:
        advisor.has_fault = lambda: monitor.has_news
        advisor.known_changes = lambda: monitor.known_changes
    return advisor

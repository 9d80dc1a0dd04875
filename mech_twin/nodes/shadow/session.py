# SPDX-License-Identifier: Apache-2.0
"""A shadow from start to end: checks its name, serves its nodes until a signal or the end of its time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import NamedTuple

import rclpy
from rclpy.signals import SignalHandlerOptions

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.messages.topics import ESTIMATED, RESIDUALS, TWIN, shadow_topics
from mech_twin.nodes.exchange.base_node import TwinNode, sent_messages
from mech_twin.nodes.exchange.spinner import Spinner, destroy_nodes
from mech_twin.nodes.run.domain import ros_arguments, run_namespace
from mech_twin.nodes.run.name_guard import NameGuard
from mech_twin.nodes.shadow.advisor_node import AdvisorNode
from mech_twin.nodes.shadow.identifier_node import IdentifierNode
from mech_twin.nodes.shadow.monitor_node import AlertOutlet, MonitorNode
from mech_twin.nodes.shadow.recorder import BlackBox, ShadowRecorder, ShadowTopics
from mech_twin.nodes.shadow.shadow_node import ShadowNode, ShadowSetup
from mech_twin.parameters.load import catalogue_entry
from mech_twin.process.stop_signal import StopSignal
from mech_twin.studies.advice_search import COMMAND, AdviceWish
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.observer.estimate import SeenSample


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
        node.report()
        boxes = [each for each in nodes if isinstance(each, BlackBox)]
        bags = tuple(bag for box in boxes for bag in box.bags)
        failed = tuple(line for box in boxes for line in box.failed)
        values = {name: value for each in nodes for name, value in each.diagnostic_values().items()}
        return ShadowOutcome(values, sent_messages(nodes), bags, failed, node.silent_topics)


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
    if identifier is not None:
        identifier.on_taken = partial(taken_over, (node, *found))
    return found


def taken_over(nodes: Sequence[TwinNode], parameters: Parameters) -> None:
    """Switch the nodes of a shadow to a model with other parameters; the monitor's reference is unchanged."""
    for each in nodes:
        each.adopt(parameters)


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

# SPDX-License-Identifier: Apache-2.0
"""The nodes of a machine composed in one process, spun on one executor until the run is over."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import rclpy
from rclpy.signals import SignalHandlerOptions

from mech_twin.engine.assembly import FrameAssembler
from mech_twin.messages.topics import run_topics
from mech_twin.nodes.base_node import TwinNode, sent_messages
from mech_twin.nodes.body_node import BodyNode
from mech_twin.nodes.departure import destroy_nodes
from mech_twin.nodes.force_node import ForceNode
from mech_twin.nodes.linkage_node import LinkageNode
from mech_twin.nodes.motor_node import MotorNode
from mech_twin.nodes.name_guard import NameGuard
from mech_twin.nodes.namespace import ros_arguments, run_namespace
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.recorder_node import RecorderNode
from mech_twin.nodes.role_node import RoleNode
from mech_twin.nodes.run_console import attended
from mech_twin.nodes.run_metrics import RunMetrics
from mech_twin.nodes.spinner import Spinner
from mech_twin.parameters.load import catalogue_entry
from mech_twin.quantity import Parameters
from mech_twin.samples import Frame, Sample
from mech_twin.stop_signal import StopSignal

if TYPE_CHECKING:
    from mech_twin.nodes.viewer_node import ViewerNode

DRAIN_LIMIT_S = 2.0


class Outcome(NamedTuple):
    """What a run came to: its metrics, and the messages sent and recorded, by full topic name."""

    metrics: RunMetrics
    sent: dict[str, int]
    recorded: dict[str, int]


def role_nodes(machine_name: str, parameters: Parameters | None, options: RunOptions) -> Iterator[RoleNode]:
    """Yield the role nodes of a machine, the linkage last; a machine without a moving body has no body node."""
    yield MotorNode(machine_name, parameters, options)
    yield ForceNode(machine_name, parameters, options)
    if catalogue_entry(machine_name).has_body:
        yield BodyNode(machine_name, parameters, options)
    yield LinkageNode(machine_name, parameters, options)


def guarded_topics(machine_name: str, namespace: str | None) -> list[str]:
    """Return the full names of the topics of a run that nobody else may publish."""
    full = run_namespace(machine_name, namespace)
    return [f"{full}/{topic.name}" for topic in run_topics(catalogue_entry(machine_name).has_body)]


def run_in_process(
    machine_name: str,
    parameters: Parameters,
    options: RunOptions,
    directory: Path | None,
    place: str | None,
    namespace: str | None = None,
) -> Outcome:
    """Run all nodes of a machine in this process until it is over or a signal asks to stop.

    Parameters
    ----------
    machine_name, parameters, options
        What to run, and how.
    directory : Path, optional
        Recording to make.
    place : str, optional
        Address of a viewer, or an ``.rrd`` file.
    namespace : str, optional
        Where the nodes live; ``/MACHINE`` if absent.

    Raises
    ------
    NameInUseError
        If a run or a replay is alive there.
    BagError
        If the recording cannot be made there.
    """
    rclpy.init(args=ros_arguments(machine_name, namespace), signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[TwinNode] = []
    with StopSignal() as signal, ExitStack() as at_end, ExitStack() as stack:
        at_end.callback(rclpy.try_shutdown)
        at_end.callback(destroy_nodes, nodes)
        stack.enter_context(signal.interrupting())
        topics = guarded_topics(machine_name, namespace)
        guard = at_end.enter_context(NameGuard(topics)) if options.exclusive else None
        apart = options.model_copy(update={"viewer": False})  # it is handed the frames, and hears the scene only
        roles: list[RoleNode] = []
        for node in role_nodes(machine_name, parameters, apart):
            roles.append(node)
            nodes.append(node)
        if guard is not None:
            guard.check(own_publishers=1)
        stack.close()
        if directory is not None:
            nodes.append(RecorderNode(machine_name, directory, parameters, apart))
        viewer = None
        if place is not None:
            from mech_twin.nodes.viewer_node import ViewerNode  # rerun is an extra

            viewer = ViewerNode(machine_name, place, parameters, apart, on_topics=False)
            nodes.append(viewer)
        metrics = _observed(roles, viewer)
        linkage = roles[-1]
        with Spinner(nodes) as spinner:
            with attended(machine_name, metrics, directory, spinner) as quits:
                spinner.serve(lambda: signal.asked or linkage.done or quits())
            drain(nodes, spinner)
        return Outcome(metrics, sent_messages(nodes), _recorded(nodes))


def _observed(roles: Sequence[RoleNode], viewer: ViewerNode | None) -> RunMetrics:
    """Return the metrics of the run, fed - and the viewer with them - by the role nodes as they compute."""
    machine = roles[-1].machine
    assembler = FrameAssembler(machine.body is not None)
    metrics = RunMetrics(lambda: machine) if viewer is None else viewer.run_metrics
    take: Callable[[Frame], object] = metrics.observe if viewer is None else viewer.show

    def on_sample(sample: Sample) -> None:
        frame = assembler.add(sample)
        if frame is not None:
            take(frame)

    for node in roles:
        node.on_sample = on_sample
    return metrics


def drain(nodes: Sequence[TwinNode], spinner: Spinner) -> None:
    """Serve the nodes until what was sent has been recorded, and nothing more comes."""
    for node in nodes:
        node.done = True
        node.flush()
        node.report()
    end = time.monotonic() + DRAIN_LIMIT_S

    def settled() -> bool:
        recorded, sent = _recorded(nodes), sent_messages(nodes)
        late = any(recorded.get(name, number) < number for name, number in sent.items())
        return not late or time.monotonic() > end

    for node in nodes:
        node.quiet = True
    spinner.until(settled)


def _recorded(nodes: Sequence[TwinNode]) -> dict[str, int]:
    total: dict[str, int] = {}
    for node in nodes:
        total |= node.received
    return total

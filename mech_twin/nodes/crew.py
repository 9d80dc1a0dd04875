"""The nodes of a machine in one process, spun on one executor until the run is over."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import rclpy
from rclpy.signals import SignalHandlerOptions

from mech_twin.engine.assembly import FrameAssembler
from mech_twin.nodes.body_node import BodyNode
from mech_twin.nodes.force_node import ForceNode
from mech_twin.nodes.linkage_node import LinkageNode
from mech_twin.nodes.motor_node import MotorNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.recorder_node import RecorderNode
from mech_twin.nodes.role_node import RoleNode, dismiss
from mech_twin.nodes.run_figures import RunFigures
from mech_twin.nodes.spinner import Spinner
from mech_twin.nodes.stop_signal import StopSignal
from mech_twin.quantity import Parameters
from mech_twin.samples import Frame, Sample

if TYPE_CHECKING:
    from mech_twin.nodes.viewer_node import ViewerNode

DRAIN_LIMIT_S = 2.0


class Outcome(NamedTuple):
    """What a run came to: its figures, and the messages sent and recorded, by full topic name."""

    figures: RunFigures
    sent: dict[str, int]
    recorded: dict[str, int]


def role_nodes(machine_name: str, parameters: Parameters | None, options: RunOptions) -> list[RoleNode]:
    """Return the role nodes of a machine, the linkage last; a machine without a moving body has no body node."""
    nodes: list[RoleNode] = [MotorNode(machine_name, parameters, options), ForceNode(machine_name, parameters, options)]
    if nodes[0].machine.body is not None:
        nodes.append(BodyNode(machine_name, parameters, options))
    nodes.append(LinkageNode(machine_name, parameters, options))
    return nodes


def run_in_process(
    machine_name: str, parameters: Parameters, options: RunOptions, directory: Path | None, place: str | None
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

    Raises
    ------
    BagError
        If the recording cannot be made there.
    """
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[RoleNode] = []
    try:
        with StopSignal() as signal:
            if directory is not None:
                nodes.append(RecorderNode(machine_name, directory, parameters, options))
            options = options.model_copy(update={"viewer": False})  # it is handed the frames, and hears the scene only
            viewer = None
            if place is not None:
                from mech_twin.nodes.viewer_node import ViewerNode  # rerun is an extra

                viewer = ViewerNode(machine_name, place, parameters, options, on_topics=False)
                nodes.append(viewer)
            nodes += role_nodes(machine_name, parameters, options)
            figures = _watched(nodes, viewer)
            linkage = nodes[-1]
            with Spinner(nodes) as spinner:
                spinner.until(lambda: signal.asked or (isinstance(linkage, LinkageNode) and linkage.done))
                drain(nodes, spinner)
            return Outcome(figures, _sent(nodes), _recorded(nodes))
    finally:
        dismiss(nodes)
        rclpy.try_shutdown()


def _watched(nodes: Sequence[RoleNode], viewer: ViewerNode | None) -> RunFigures:
    """Return the figures of the run, fed - the viewer's stage with them - by the role nodes as they compute."""
    machine = nodes[-1].machine
    assembler = FrameAssembler(machine.body is not None)
    figures = RunFigures(machine) if viewer is None else viewer.run_figures
    take: Callable[[Frame], object] = figures.observe if viewer is None else viewer.show

    def notice(sample: Sample) -> None:
        frame = assembler.add(sample)
        if frame is not None:
            take(frame)

    for node in nodes:
        node.on_sample = notice
    return figures


def drain(nodes: Sequence[RoleNode], spinner: Spinner) -> None:
    """Serve the nodes until what was sent has been recorded, and nothing more comes."""
    for node in nodes:
        if isinstance(node, LinkageNode):
            node.done = True
        node.flush()
        node.report()
    end = time.monotonic() + DRAIN_LIMIT_S

    def settled() -> bool:
        recorded = _recorded(nodes)
        late = any(recorded.get(name, number) < number for name, number in _sent(nodes).items())
        return not late or time.monotonic() > end

    for node in nodes:
        node.quiet = True
    spinner.until(settled)


def _sent(nodes: Sequence[RoleNode]) -> dict[str, int]:
    total: dict[str, int] = {}
    for node in nodes:
        for outlet in node.outlets:
            name = node.resolve_topic_name(outlet.name)
            total[name] = total.get(name, 0) + outlet.sent
    return total


def _recorded(nodes: Sequence[RoleNode]) -> dict[str, int]:
    return next((node.received for node in nodes if isinstance(node, RecorderNode)), {})

# SPDX-License-Identifier: Apache-2.0
"""Running all nodes of a machine, in one process on one executor or in a process each, until the run is over."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import rclpy
import yaml
from rclpy.signals import SignalHandlerOptions

from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.trajectory import FrameAssembler
from mech_twin.messages.topics import FRAMES, ROBOT_DESCRIPTION, run_topics
from mech_twin.nodes.exchange.base_node import RunOptions, TwinNode, sent_messages
from mech_twin.nodes.exchange.parameter_bridge import ros_values
from mech_twin.nodes.exchange.spinner import Spinner, destroy_nodes
from mech_twin.nodes.roles.answering_nodes import BodyNode, ForceNode, MotorNode
from mech_twin.nodes.roles.frames_node import FramesNode
from mech_twin.nodes.roles.linkage_node import LinkageNode
from mech_twin.nodes.roles.recorder_node import RecorderNode
from mech_twin.nodes.roles.role_node import RoleNode
from mech_twin.nodes.roles.viewer_node import ObserverNode
from mech_twin.nodes.run.console import attended, keep_log_apart
from mech_twin.nodes.run.domain import NodeEndedError, ros_arguments, run_namespace
from mech_twin.nodes.run.executables import LaunchRequest, programs
from mech_twin.nodes.run.name_guard import NameGuard
from mech_twin.parameters.load import MACHINE_KEY, RUN_GROUP, catalogue_entry
from mech_twin.process.interruption import EXIT_CODE_BASE, SIGNALS, StopSignal
from mech_twin.roles import Machine, own_name
from mech_twin.samples import Frame, Sample, Shape
from mech_twin.studies.simulation import RunMetrics

if TYPE_CHECKING:
    from mech_twin.nodes.roles.viewer_node import ViewerNode

DRAIN_LIMIT_S = 2.0


class Outcome(NamedTuple):
    """Result of a run: its metrics, and the messages sent and recorded, by full topic name."""

    metrics: RunMetrics
    sent: dict[str, int]
    received: dict[str, int]


def role_nodes(machine_name: str, parameters: Parameters | None, options: RunOptions) -> Iterator[RoleNode]:
    """Yield the role nodes of a machine, the linkage last; a machine without a moving body has no body node."""
    yield MotorNode(machine_name, parameters, options)
    yield ForceNode(machine_name, parameters, options)
    if catalogue_entry(machine_name).has_body:
        yield BodyNode(machine_name, parameters, options)
    yield LinkageNode(machine_name, parameters, options)


def guarded_topics(machine_name: str, parameters: Parameters, namespace: str | None) -> list[str]:
    """Return the full names of the topics of a run that exclude other publishers."""
    full = run_namespace(own_name(machine_name, parameters), namespace)
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
        Namespace of the nodes; ``/MACHINE`` if absent.

    Raises
    ------
    NameInUseError
        If a run or a replay is alive there.
    BagError
        If the recording cannot be made there.
    """
    keep_log_apart()
    rclpy.init(args=ros_arguments(machine_name, namespace), signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[TwinNode] = []
    with StopSignal() as signal, ExitStack() as at_end, ExitStack() as stack:
        at_end.callback(rclpy.try_shutdown)
        at_end.callback(destroy_nodes, nodes)
        stack.enter_context(signal.interrupting())
        topics = guarded_topics(machine_name, parameters, namespace)
        guard = at_end.enter_context(NameGuard(topics)) if options.exclusive else None
        apart = options.model_copy(update={"viewer": False})  # it receives the frames directly
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
            from mech_twin.nodes.roles.viewer_node import ViewerNode  # rerun is an extra

            viewer = ViewerNode(machine_name, place, parameters, apart, on_topics=False)
            nodes.append(viewer)
        metrics, observe = _observed(roles, viewer)
        linkage = roles[-1]
        if linkage.machine.mechanism is not None:
            nodes.append(FramesNode(machine_name, parameters, apart))
        with Spinner(nodes) as spinner:
            spinner.patient.append(observe)
            with attended(machine_name, metrics, directory, spinner) as quits:
                spinner.serve(lambda: signal.asked or linkage.done or quits())
            drain(nodes, spinner)
        return Outcome(metrics, _sent(nodes), _received(nodes))


def _observed(roles: Sequence[RoleNode], viewer: ViewerNode | None) -> tuple[RunMetrics, Callable[[], None]]:
    """Return the metrics of the run, and a callable that feeds them and the viewer with the role nodes' samples.

    It is called for several steps at a time, which takes half as long as at each step.
    """
    linkage = roles[-1]
    machine = linkage.machine

    def in_force(step: int) -> Machine:
        return linkage.machine

    def drawn(frame: Frame) -> tuple[Shape, ...]:
        return in_force(frame.linkage.step).draw(frame.linkage, frame.body)

    assembler = FrameAssembler(machine.body is not None)
    metrics = RunMetrics(lambda: machine) if viewer is None else viewer.run_metrics
    metrics.machine_at = in_force
    if viewer is not None:
        viewer.draw = drawn
    take: Callable[[Frame], object] = metrics.observe if viewer is None else viewer.show

    computed: deque[Sample] = deque()

    def observe() -> None:
        while computed:
            frame = assembler.add(computed.popleft())
            if frame is not None:
                take(frame)
        if viewer is not None:
            viewer.draw_newest()

    for node in roles:
        node.on_sample = computed.append
    return metrics, observe


def drain(nodes: Sequence[TwinNode], spinner: Spinner) -> None:
    """Serve the nodes until all messages sent have been recorded, and no more arrive."""
    for node in nodes:
        node.done = True
        node.flush()
        node.report()
    end = time.monotonic() + DRAIN_LIMIT_S

    def settled() -> bool:
        received, sent = _received(nodes), _sent(nodes)
        late = any(received.get(name, number) < number for name, number in sent.items())
        return not late or time.monotonic() > end

    for node in nodes:
        node.quiet = True
    spinner.until(settled)


def _received(nodes: Sequence[TwinNode]) -> dict[str, int]:
    total: dict[str, int] = {}
    for node in nodes:
        total |= node.received
    return _without_frames(nodes, total)


def _sent(nodes: Sequence[TwinNode]) -> dict[str, int]:
    return _without_frames(nodes, sent_messages(nodes))


def _without_frames(nodes: Sequence[TwinNode], counts: dict[str, int]) -> dict[str, int]:
    """Return counts without the frames node's topics, which a recorder finds later: the run does not wait for them."""
    found = {node.resolve_topic_name(topic.name) for node in nodes for topic in (FRAMES, ROBOT_DESCRIPTION)}
    return {name: number for name, number in counts.items() if name not in found}


STOP_LIMIT_S = 10.0  # a bound for a busy computer; the processes usually end within 1 s
SETTLE_S = 0.1
ENDED_BY_SIGNAL = {EXIT_CODE_BASE + number for number in SIGNALS}
ENDED_WELL = {0, -signal.SIGALRM}  # files closed, but the middleware did not return: see `spinner`
FRAMES_NODE = "frames_node"
ROS_FILE = ("--ros-args", "--params-file")

Processes = dict[str, "subprocess.Popen[bytes]"]


def run_processes(
    machine_name: str,
    parameters: Parameters,
    options: RunOptions,
    directory: Path | None,
    place: str | None,
    namespace: str | None = None,
) -> Outcome:
    """Run every node of a machine in a process of its own; see `run_in_process` for the arguments.

    This process subscribes to the step messages for the metrics of the run.

    Raises
    ------
    NameInUseError
        If a run or a replay is alive in this namespace.
    NodeEndedError
        If a node ends with an error.
    """
    asked = options
    options = options.model_copy(update={"observer": True, "exclusive": False})
    rules = ros_arguments(machine_name, namespace)
    keep_log_apart()
    rclpy.init(args=rules, signal_handler_options=SignalHandlerOptions.NO)
    processes: Processes = {}
    with ExitStack() as at_end, StopSignal() as stop:
        guarding = ExitStack()
        try:
            with stop.interrupting():
                if asked.exclusive:
                    guarding.enter_context(NameGuard(guarded_topics(machine_name, parameters, namespace))).check()
                observer = ObserverNode(machine_name, parameters, options)
            # not earlier: up to here a signal ends the process at once, and the directory would remain
            folder = at_end.enter_context(tempfile.TemporaryDirectory(prefix="mech_twin-"))
            file = Path(folder) / "parameters.yaml"
            file.write_text(_parameter_file(machine_name, parameters, options), encoding="utf-8")
            record = "" if directory is None else str(directory)
            for name, _, arguments in programs(LaunchRequest(machine_name, record=record, view=place or "", frames="")):
                processes[name] = _started(name, [*arguments, *rules, *ROS_FILE, str(file)])

            def describe() -> None:
                """Start the frames node once the run has started: before, other processes compile."""
                metrics = observer.run_metrics
                if metrics.frames and not stop.asked:
                    look.cancel()
                    if metrics.machine.mechanism is not None:
                        processes[FRAMES_NODE] = _started(FRAMES_NODE, [*rules, *ROS_FILE, str(file)])

            look = observer.every(SETTLE_S, describe)
            with Spinner([observer]) as spinner:
                with attended(machine_name, observer.run_metrics, directory, spinner) as quits:
                    running = processes.values()
                    spinner.serve(lambda: stop.asked or any(each.poll() is not None for each in running) or quits())
                settled = time.monotonic() + SETTLE_S
                spinner.until(lambda: stop.asked or time.monotonic() > settled)
        finally:
            codes = _stopped(processes)
            guarding.close()
            rclpy.try_shutdown()
    if codes.get(FRAMES_NODE) in ENDED_BY_SIGNAL:  # of a short run, before the node had started
        del codes[FRAMES_NODE]
    if stop.asked and set(codes.values()) & ENDED_BY_SIGNAL:  # before the run had begun
        raise SystemExit(EXIT_CODE_BASE + stop.number)
    failed = ", ".join(f"{name} (exit code {code})" for name, code in codes.items() if code not in ENDED_WELL)
    if failed:
        raise NodeEndedError(f"ended with an error: {failed}")
    return Outcome(observer.run_metrics, {}, {})


def _parameter_file(machine_name: str, parameters: Parameters, options: RunOptions) -> str:
    tree = {MACHINE_KEY: machine_name, **ros_values(parameters, ""), **ros_values(options, f"{RUN_GROUP}.")}
    return yaml.safe_dump({"/**": {"ros__parameters": tree}}, sort_keys=False)


def _started(name: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    code = (
        f"from mech_twin.programs import {name}; from mech_twin.process.interruption import end_with_parent; "
        f"end_with_parent({os.getpid()}); {name}()"
    )
    command = [sys.executable, "-c", code, *arguments]
    # the child inherits blocked signals until `programs.end_by_signal` handles them: a starting interpreter would trace
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        return subprocess.Popen(command, stdout=sys.stderr.fileno())
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _stopped(processes: Processes) -> dict[str, int]:
    """End all processes at once and return their exit codes; listening ones end when no more messages arrive."""
    for process in processes.values():
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)  # each would report a SIGINT
    end = time.monotonic() + STOP_LIMIT_S
    return {name: _exit_code(process, end) for name, process in processes.items()}


def _exit_code(process: subprocess.Popen[bytes], end: float) -> int:
    try:
        return process.wait(max(0.1, end - time.monotonic()))
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()

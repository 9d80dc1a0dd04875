# SPDX-License-Identifier: Apache-2.0
"""The nodes of a machine, each in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import rclpy
import yaml
from rclpy.signals import SignalHandlerOptions

from mech_twin.configuration_tree import configuration_tree
from mech_twin.interruption import EXIT_CODE_BASE, SIGNALS
from mech_twin.nodes.composition import Outcome, guarded_topics
from mech_twin.nodes.errors import NodeEndedError
from mech_twin.nodes.name_guard import NameGuard
from mech_twin.nodes.namespace import ros_arguments
from mech_twin.nodes.observer_node import ObserverNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.run_console import attended
from mech_twin.nodes.spinner import Spinner
from mech_twin.parameters.load import MACHINE_KEY, RUN_GROUP, catalogue_entry
from mech_twin.quantity import Parameters
from mech_twin.stop_signal import StopSignal

STOP_LIMIT_S = 10.0  # a bound for a busy machine; they end within a second
SETTLE_S = 0.1
ENDED_BY_SIGNAL = {EXIT_CODE_BASE + number for number in SIGNALS}
ENDED_WELL = {0, -signal.SIGALRM}  # closed what it had open, and its middleware did not let go: see `departure`
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
    """Run every node of a machine in a process of its own; see `composition.run_in_process` for the arguments.

    This process observes the steps from outside, for the metrics of the run.

    Raises
    ------
    NameInUseError
        If a run or a replay is alive there.
    NodeEndedError
        If a node ends with an error.
    """
    asked = options
    options = options.model_copy(update={"observer": True, "exclusive": False})
    rules = ros_arguments(machine_name, namespace)
    rclpy.init(args=rules, signal_handler_options=SignalHandlerOptions.NO)
    processes: Processes = {}
    with tempfile.TemporaryDirectory(prefix="mech_twin-") as folder, StopSignal() as stop:
        file = Path(folder) / "parameters.yaml"
        file.write_text(_parameter_file(machine_name, parameters, options), encoding="utf-8")
        guarding = ExitStack()
        try:
            with stop.interrupting():
                if asked.exclusive:
                    guarding.enter_context(NameGuard(guarded_topics(machine_name, namespace))).check()
                observer = ObserverNode(machine_name, parameters, options)
            for name, arguments in _roster(catalogue_entry(machine_name).has_body, directory, place):
                processes[name] = _started(name, [*arguments, *rules, *ROS_FILE, str(file)])
            with Spinner([observer]) as spinner:
                with attended(machine_name, observer.run_metrics, directory, spinner) as quits:
                    spinner.serve(lambda: stop.asked or _any_ended(processes) or quits())
                settled = time.monotonic() + SETTLE_S
                spinner.until(lambda: stop.asked or time.monotonic() > settled)
        finally:
            codes = _stopped(processes)
            guarding.close()
            rclpy.try_shutdown()
    if stop.asked and set(codes.values()) & ENDED_BY_SIGNAL:  # before the run had begun
        raise SystemExit(max(code for code in codes.values() if code in ENDED_BY_SIGNAL))
    failed = ", ".join(f"{name} (exit code {code})" for name, code in codes.items() if code not in ENDED_WELL)
    if failed:
        raise NodeEndedError(f"ended with an error: {failed}")
    return Outcome(observer.run_metrics, {}, {})


def _roster(has_body: bool, directory: Path | None, place: str | None) -> list[tuple[str, list[str]]]:
    """Return the nodes in the order they are started, with their arguments."""
    recorder = [] if directory is None else [("recorder_node", ["--directory", str(directory)])]
    viewer = [] if place is None else [("viewer_node", ["--place", place])]
    roles = ["motor_node", "force_node", *(["body_node"] if has_body else []), "linkage_node"]
    return [*recorder, *viewer, *((name, list[str]()) for name in roles)]


def _parameter_file(machine_name: str, parameters: Parameters, options: RunOptions) -> str:
    tree = {MACHINE_KEY: machine_name, **configuration_tree(parameters), RUN_GROUP: configuration_tree(options)}
    return yaml.safe_dump({"/**": {"ros__parameters": tree}}, sort_keys=False)


def _started(name: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    code = (
        f"from mech_twin.programs import {name}; from mech_twin.parent_death import end_with_parent; "
        f"end_with_parent({os.getpid()}); {name}()"
    )
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.Popen(command, stdout=sys.stderr.fileno())


def _any_ended(processes: Processes) -> bool:
    return any(process.poll() is not None for process in processes.values())


def _stopped(processes: Processes) -> dict[str, int]:
    """End all processes at once - those that listen do so until nothing more comes - and return their exit codes."""
    for process in processes.values():
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    end = time.monotonic() + STOP_LIMIT_S
    return {name: _exit_code(process, end) for name, process in processes.items()}


def _exit_code(process: subprocess.Popen[bytes], end: float) -> int:
    try:
        return process.wait(max(0.1, end - time.monotonic()))
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()

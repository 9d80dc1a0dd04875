# SPDX-License-Identifier: Apache-2.0
"""Each node as a program of its own: ``linkage_node --ros-args --params-file config/mb10_breaker.yaml``."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.dependencies import missing_extra
from mech_twin.engine.errors import MotionError
from mech_twin.interruption import end_at_once
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.nodes.domain import settle_domain
from mech_twin.nodes.errors import NameInUseError
from mech_twin.nodes.parent_death import end_with_launch
from mech_twin.parameters.load import MACHINE_KEY, catalogue_entry
from mech_twin.stop_signal import StopSignal
from mech_twin.surroundings import lacking

if TYPE_CHECKING:
    from mech_twin.nodes.base_node import TwinNode

QUIET_S = 0.15
QUIET_LIMIT_S = 0.6
EXIT_CODE = 2


@contextmanager
def machine_of(node_name: str) -> Iterator[str]:
    """Provide the machine a node of this name is told to be of: its parameter ``machine``, as rcl resolves it.

    A file may name the node with its namespace, which is the machine's name unless it was remapped: then the machine is
    looked for under each name of the catalogue.  The node that was asked lives until the block ends: with the last node
    of a process its middleware goes too, and to bring that up again takes time and meets the others' discovery twice.

    Raises
    ------
    ConfigurationError
        If no parameter says it, or it is none of the catalogue.
    """
    import rclpy

    from mech_twin.nodes.departure import destroy_nodes
    from mech_twin.nodes.parameter_bridge import machine_override

    with ExitStack() as at_end:
        for namespace in ("", *CATALOGUE):
            node = rclpy.create_node(
                node_name, namespace=namespace, enable_rosout=False, start_parameter_services=False
            )
            at_end.callback(destroy_nodes, [node])
            told = machine_override(node)
            if told is not None and namespace in ("", told):
                yield catalogue_entry(told).name
                return
    raise ConfigurationError(
        f"parameters of node {node_name}: key '{MACHINE_KEY}' is not set; expected one of {', '.join(CATALOGUE)} "
        f"(-p {MACHINE_KEY}:=NAME, or a parameter file)"
    )


def _program(
    make: Callable[[str, argparse.Namespace], TwinNode], node_name: str, description: str, *options: str
) -> None:
    parser = argparse.ArgumentParser(description=description)
    for option in options:
        parser.add_argument(option)
    own, ros = parser.parse_known_args()
    if ros and ros[0] != "--ros-args":
        parser.error(f"unknown argument {ros[0]}; ROS arguments come after --ros-args")
    try:
        with StopSignal() as stop:
            end_with_launch()
            _serve(lambda: _told(make, node_name, own), ros, stop)
    except SystemExit as end:
        end_at_once(end.code if isinstance(end.code, int) else EXIT_CODE)
    except Exception as error:
        line = _told_line(error)
        if line is None:
            raise
        sys.stderr.write(f"{Path(sys.argv[0]).name}: {line}\n")
        raise SystemExit(EXIT_CODE) from error
    end_at_once(0)


def _told(make: Callable[[str, argparse.Namespace], TwinNode], node_name: str, own: argparse.Namespace) -> TwinNode:
    with machine_of(node_name) as machine:
        return make(machine, own)


def _told_line(error: Exception) -> str | None:
    """Return the line that tells of an error in what the program was given; None if the error is its own."""
    lack = lacking(error)
    if lack is not None:
        return lack
    from mech_twin.recording.errors import BagError

    if isinstance(error, ModuleNotFoundError):
        return missing_extra(error)
    known = (ConfigurationError, MotionError, BagError, NameInUseError)
    return " ".join(str(error).split()) if isinstance(error, known) else None


def _serve(make: Callable[[], TwinNode], ros: list[str], stop: StopSignal) -> None:
    with ExitStack() as at_end:
        with stop.interrupting():  # from here on: to load the libraries takes a second
            node = _made(make, ros, at_end)
        from mech_twin.nodes.spinner import Spinner

        with Spinner([node]) as spinner:
            spinner.serve(lambda: stop.asked or node.done)
            node.flush()
            node.report()
            end = time.monotonic() + QUIET_LIMIT_S
            spinner.until(lambda: node.quiet_s() > QUIET_S or time.monotonic() > end)


def _made(make: Callable[[], TwinNode], ros: list[str], at_end: ExitStack) -> TwinNode:
    """Return the node, alone under its name if it must be; what is to be closed is put on the stack."""
    settle_domain()
    import rclpy
    from rclpy._rclpy_pybind11 import RCLError
    from rclpy.signals import SignalHandlerOptions

    from mech_twin.nodes.departure import destroy_nodes
    from mech_twin.nodes.name_guard import NameGuard

    try:
        rclpy.init(args=[sys.argv[0], *ros], signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, rclpy.exceptions.ROSInterruptException) as error:
        raise ConfigurationError(str(error)) from error
    at_end.callback(rclpy.try_shutdown)
    node = make()
    at_end.callback(destroy_nodes, [node])
    exclusive = [node.resolve_topic_name(output.name) for output in node.outputs if output.exclusive]
    if exclusive and node.options.exclusive:
        at_end.enter_context(NameGuard(exclusive)).check(own_publishers=1)
    return node


def motor_node() -> None:
    """Run the motor node."""

    def make(machine: str, own: argparse.Namespace) -> TwinNode:
        from mech_twin.nodes.motor_node import MotorNode

        return MotorNode(machine)

    _program(make, "motor", "motor of a machine")


def linkage_node() -> None:
    """Run the linkage node."""

    def make(machine: str, own: argparse.Namespace) -> TwinNode:
        from mech_twin.nodes.linkage_node import LinkageNode

        return LinkageNode(machine)

    _program(make, "linkage", "linkage of a machine, and time authority of its run")


def force_node() -> None:
    """Run the force analysis node."""

    def make(machine: str, own: argparse.Namespace) -> TwinNode:
        from mech_twin.nodes.force_node import ForceNode

        return ForceNode(machine)

    _program(make, "force_analysis", "force analysis of a machine")


def body_node() -> None:
    """Run the body node."""

    def make(machine: str, own: argparse.Namespace) -> TwinNode:
        from mech_twin.nodes.body_node import BodyNode

        return BodyNode(machine)

    _program(make, "body", "body of a machine")


def frames_node() -> None:
    """Run the frames node."""

    def make(machine: str, own: argparse.Namespace) -> TwinNode:
        from mech_twin.nodes.frames_node import FramesNode

        return FramesNode(machine)

    _program(make, "frames", "frames of a machine for TF, and its robot description")


def recorder_node() -> None:
    """Run the recorder node."""

    def make(machine: str, own: argparse.Namespace) -> TwinNode:
        from mech_twin.nodes.recorder_node import RecorderNode

        directory = own.directory or f"recordings/{machine}-{datetime.now():%Y%m%d-%H%M%S}"
        return RecorderNode(machine, Path(directory))

    _program(make, "recorder", "recorder of a machine", "--directory")


def viewer_node() -> None:
    """Run the viewer node."""

    def make(machine: str, own: argparse.Namespace) -> TwinNode:
        from mech_twin.nodes.viewer_node import ViewerNode

        return ViewerNode(machine, own.place or f"{machine}.rrd")

    _program(make, "viewer", "viewer of a machine", "--place")

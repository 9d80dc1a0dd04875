# SPDX-License-Identifier: Apache-2.0
"""Each node as a program of its own: ``linkage_node --ros-args --params-file config/mb10_breaker.yaml``.

Also programs, parameters and names for the launch files; nothing here needs the launch library.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from datetime import datetime
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.errors import MotionError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.messages.topics import CLOCK
from mech_twin.nodes.run.domain import (
    DISCOVERY,
    THIS_HOST,
    NameInUseError,
    end_with_launch,
    run_namespace,
    settle_domain,
)
from mech_twin.parameters.load import MACHINE_KEY, PAGE, catalogue_entry, is_page, machine_parameters
from mech_twin.process.dependencies import lacking, missing_extra
from mech_twin.process.interruption import StopSignal, end_at_once
from mech_twin.process.terminal_output import printable
from mech_twin.roles import own_name

if TYPE_CHECKING:
    from mech_twin.declarations.quantity import Parameters
    from mech_twin.nodes.exchange.base_node import TwinNode

PACES = ("realtime", "max")
RANGES = ("", "LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
SWITCH = ("true", "false")
RESPAWN_DELAY_S = 0.5  # the launch library notices within this that a run is over, and does not respawn
REFUSED = 2  # exit code of a program whose arguments or parameters are invalid
LINKAGE = "linkage"


class Program(NamedTuple):
    """One node to launch: executable, node name, and arguments of the executable."""

    executable: str
    name: str
    arguments: tuple[str, ...] = ()


class LaunchRequest(NamedTuple):
    """Arguments of a launch file, as text; empty if not given."""

    machine: str
    namespace: str = ""
    pace: str = "realtime"
    duration: str = "0"
    params_file: str = ""
    use_sim_time: str = "false"
    record: str = ""
    view: str = ""
    frames: str = "true"


def programs(request: LaunchRequest) -> list[Program]:
    """Return the nodes of a machine in starting order, the linkage last: the run ends with it.

    Raises
    ------
    ConfigurationError
        If the catalogue does not contain the machine.
    """
    has_body = catalogue_entry(request.machine).has_body
    return [
        *([Program("recorder_node", "recorder", ("--directory", request.record))] if request.record else []),
        *([Program("viewer_node", "viewer", ("--place", request.view))] if request.view else []),
        *([Program("frames_node", "frames")] if request.frames == "true" else []),
        Program("motor_node", "motor"),
        Program("force_node", "force_analysis"),
        *([Program("body_node", "body")] if has_body else []),
        Program("linkage_node", LINKAGE),
    ]


def namespace(request: LaunchRequest) -> str:
    """Return the full namespace of the nodes; that of the machine's name if none is requested.

    Raises
    ------
    ConfigurationError
        If it is not a valid ROS namespace.
    """
    return run_namespace(called(request.machine), request.namespace or None)


def called(machine: str) -> str:
    """Return the name of a machine on its topics; of a page, given by its path, the one that stands on it.

    Raises
    ------
    ConfigurationError
        If it is neither a machine of the catalogue nor a page.
    """
    return own_name(machine, machine_parameters(machine)) if is_page(machine) else catalogue_entry(machine).name


def remappings(request: LaunchRequest) -> list[tuple[str, str]]:
    """Return the remapping rules besides the namespace: in a given namespace the clock is separate."""
    return [(CLOCK.name, namespace(request) + CLOCK.name)] if request.namespace else []


def parameter_files(request: LaunchRequest) -> list[str]:
    """Return the parameter file that is given, if any: a node knows the installed one.

    Raises
    ------
    ConfigurationError
        If a file is not there.
    """
    if not request.params_file:
        return []
    if not Path(request.params_file).is_file():
        raise ConfigurationError(f"params_file {request.params_file}: no such file")
    return [request.params_file]


def parameters(request: LaunchRequest) -> dict[str, str | float | bool]:
    """Return the parameters that take precedence over those of the files.

    Raises
    ------
    ConfigurationError
        If the duration is no length of time.
    """
    asked: dict[str, str | float | bool] = {
        MACHINE_KEY: request.machine,
        "run.pace": request.pace,
        "run.recorder": bool(request.record),
        "run.viewer": bool(request.view),
        "use_sim_time": request.use_sim_time == "true",
    }
    try:
        duration_s = float(request.duration)
    except ValueError:
        duration_s = math.nan
    if not 0.0 <= duration_s < math.inf:
        raise ConfigurationError(f"duration {request.duration}: expected seconds, 0 or more (0 runs until stopped)")
    return asked | {"run.duration_s": duration_s}


def ends_run(name: str, exit_code: int, respawn: bool) -> bool:
    """Return whether the end of this node ends the run.

    The run ends with the linkage's last step, with a refusal, and, unless nodes are respawned, with any error.
    """
    if exit_code == 0:
        return name == LINKAGE
    return exit_code == REFUSED or not respawn


def launch_requests(machines: str, record: str = "", view: str = "") -> list[LaunchRequest]:
    """Return a request for each of ``[NAMESPACE=]MACHINE,...``; each has its own namespace, recording and view file.

    Raises
    ------
    ConfigurationError
        If a machine is unknown, a namespace occurs twice, or the list is empty.
    """
    requests: dict[str, LaunchRequest] = {}
    for word in filter(None, (part.strip() for part in machines.split(","))):
        first, _, second = word.partition("=")
        name = second or first
        own = called(name)
        place = run_namespace(own, first if second else own).removeprefix("/")
        if place in requests:
            raise ConfigurationError(f"machines {machines}: namespace {place} stands twice; write NAMESPACE={name}")
        label = place.replace("/", "-")
        # files are separate, a viewer's address is shared
        shown = f"{view.removesuffix('.rrd')}-{label}.rrd" if view.endswith(".rrd") else view
        requests[place] = LaunchRequest(name, place, record=f"{record}/{label}" if record else "", view=shown)
    if not requests:
        raise ConfigurationError("machines: expected [NAMESPACE=]MACHINE,...")
    return list(requests.values())


def discovery(asked: str, environment: Mapping[str, str] = os.environ) -> tuple[str, str]:
    """Return the discovery range in force, and a line if it is not the requested one."""
    users = environment.get(DISCOVERY)
    if users is None:
        return asked or THIS_HOST, ""
    line = f"discovery: {DISCOVERY}={users} is set and is not overridden by {asked}" if asked not in ("", users) else ""
    return users, line


EXIT_CODE = 2


@contextmanager
def machine_of(node_name: str) -> Iterator[tuple[str, Parameters | None]]:
    """Provide the parameter ``machine`` of a node of this name, as rcl resolves it, and of a page its configuration.

    The parameter may be the path of a page; else the parameters of the node are that page.

    A parameter file may name the node with its namespace, by default the machine's name.  Hence a temporary node is
    created in the root namespace, then in the namespace of each machine of the catalogue.  These nodes live until the
    block ends: with the last node of a process the DDS participant is destroyed, and a new one has to be discovered.

    Raises
    ------
    ConfigurationError
        If the parameter is not set, or names neither a machine of the catalogue nor a page.
    """
    import rclpy

    from mech_twin.nodes.exchange.parameter_bridge import given_parameters, machine_override
    from mech_twin.nodes.exchange.spinner import destroy_nodes

    with ExitStack() as at_end:
        for namespace in ("", *CATALOGUE):
            node = rclpy.create_node(
                node_name, namespace=namespace, enable_rosout=False, start_parameter_services=False
            )
            at_end.callback(destroy_nodes, [node])
            override = machine_override(node)
            if override is not None and namespace in ("", override):
                entry, page = catalogue_entry(override), None
                if entry is PAGE:
                    page = machine_parameters(override) if is_page(override) else given_parameters(node, entry)
                yield entry.name, page
                return
    raise ConfigurationError(
        f"parameters of node {node_name}: key '{MACHINE_KEY}' is not set; expected one of {', '.join(CATALOGUE)}, "
        f"or the path of a page (-p {MACHINE_KEY}:=NAME, or a parameter file)"
    )


def _program(role: str, node_name: str, description: str, option: str = "", usual: str = "") -> None:
    """Run a node of a role class, ``module:Class``, which is loaded where a signal ends the process.

    The class gets the name of the machine, and the value of the option: the usual one, with that name and the present
    time for ``{}``, if none is given.
    """
    parser = argparse.ArgumentParser(description=description)
    if option:
        parser.add_argument(option)
    own, ros = parser.parse_known_args()
    if ros and ros[0] != "--ros-args":
        parser.error(f"unknown argument {ros[0]}; ROS arguments come after --ros-args")

    def make() -> TwinNode:
        with machine_of(node_name) as (machine, page):
            module, name = role.split(":")
            made = getattr(import_module(f"mech_twin.nodes.roles.{module}"), name)
            called = machine if page is None else own_name(machine, page)
            given = [value or usual.format(called, datetime.now()) for value in vars(own).values()]
            node: TwinNode = made(machine, *given, parameters=page)
            return node

    try:
        with StopSignal() as stop:
            end_with_launch()
            _serve(make, ros, stop)
    except SystemExit as end:
        end_at_once(end.code if isinstance(end.code, int) else EXIT_CODE)
    except Exception as error:
        line = _error_line(error)
        if line is None:
            raise
        sys.stderr.write(f"{Path(sys.argv[0]).name}: {printable(line)}\n")
        raise SystemExit(EXIT_CODE) from error
    end_at_once(0)


def _error_line(error: Exception) -> str | None:
    """Return the message of a user error in the program's input; None for an internal error."""
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
        with stop.interrupting():  # from here on: loading the libraries takes a second
            node = _made(make, ros, at_end)
        from mech_twin.nodes.exchange.spinner import Spinner

        with Spinner([node]) as spinner:
            spinner.serve(lambda: stop.asked or node.done)
            node.flush()
            node.report()
            spinner.until(node.settled)


def _made(make: Callable[[], TwinNode], ros: list[str], at_end: ExitStack) -> TwinNode:
    """Return the node, after checking for other publishers if required; what must be closed is put on the stack."""
    settle_domain()
    import rclpy
    from rclpy._rclpy_pybind11 import RCLError
    from rclpy.signals import SignalHandlerOptions

    from mech_twin.nodes.exchange.spinner import destroy_nodes
    from mech_twin.nodes.run.name_guard import NameGuard

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


motor_node = partial(_program, "answering_nodes:MotorNode", "motor", "motor of a machine")
linkage_node = partial(
    _program, "linkage_node:LinkageNode", "linkage", "linkage of a machine, and time authority of its run"
)
force_node = partial(_program, "answering_nodes:ForceNode", "force_analysis", "force analysis of a machine")
body_node = partial(_program, "answering_nodes:BodyNode", "body", "body of a machine")
frames_node = partial(
    _program, "frames_node:FramesNode", "frames", "frames of a machine for TF, and its robot description"
)
recorder_node = partial(
    _program,
    "recorder_node:RecorderNode",
    "recorder",
    "recorder of a machine",
    "--directory",
    "recordings/{}-{:%Y%m%d-%H%M%S}",
)
viewer_node = partial(_program, "viewer_node:ViewerNode", "viewer", "viewer of a machine", "--place", "{}.rrd")

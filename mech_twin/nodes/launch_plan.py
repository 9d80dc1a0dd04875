# SPDX-License-Identifier: Apache-2.0
"""What the launch files start: programs, parameters, names.  Nothing here needs the launch library."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.messages.topics import CLOCK
from mech_twin.nodes.domain import DISCOVERY, THIS_HOST
from mech_twin.nodes.namespace import run_namespace
from mech_twin.parameters.load import MACHINE_KEY, catalogue_entry, configuration_file

PACES = ("realtime", "max")
RANGES = ("", "LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
SWITCH = ("true", "false")
RESPAWN_DELAY_S = 0.5  # the launch library hears of an end within this, and does not start what is over again
REFUSED = 2  # exit code of a program that cannot run as it was told to
LINKAGE = "linkage"


class Program(NamedTuple):
    """One node: its program, its name, the program's own arguments."""

    executable: str
    name: str
    arguments: tuple[str, ...] = ()


class LaunchRequest(NamedTuple):
    """Arguments of a launch file, as text; empty where nothing is asked."""

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
    """Return the nodes of a machine in the order they are started, the linkage last: the run ends with it.

    Raises
    ------
    ConfigurationError
        If the catalogue has no such machine.
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
    """Return the full namespace of the nodes, ``/MACHINE`` if none is asked for.

    Raises
    ------
    ConfigurationError
        If it is no name of ROS.
    """
    return run_namespace(request.machine, request.namespace or None)


def remappings(request: LaunchRequest) -> list[tuple[str, str]]:
    """Return the rules beside the namespace: who is told one has a clock of its own."""
    return [(CLOCK.name, namespace(request) + CLOCK.name)] if request.namespace else []


def parameter_files(request: LaunchRequest) -> list[str]:
    """Return the parameter files, a later one laid over an earlier.

    Raises
    ------
    ConfigurationError
        If a file is not there.
    """
    installed = [str(configuration_file(catalogue_entry(request.machine).name))]
    if not request.params_file:
        return installed
    if not Path(request.params_file).is_file():
        raise ConfigurationError(f"params_file {request.params_file}: no such file")
    return [*installed, request.params_file]


def parameters(request: LaunchRequest) -> dict[str, str | float | bool]:
    """Return the parameters laid over those of the files.

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
    """Return whether the run is over because this node ended.

    It is with the linkage's last step, with a refusal, and, unless ended nodes are started again, with any error.
    """
    if exit_code == 0:
        return name == LINKAGE
    return exit_code == REFUSED or not respawn


def several(machines: str, record: str = "", view: str = "") -> list[LaunchRequest]:
    """Return a request for each of ``[NAMESPACE=]MACHINE,...``; each has its own namespace, recording and view file.

    Raises
    ------
    ConfigurationError
        If a machine is unknown, a namespace stands twice, or there is none.
    """
    requests: dict[str, LaunchRequest] = {}
    for word in filter(None, (part.strip() for part in machines.split(","))):
        first, _, second = word.partition("=")
        name = second or first
        place = run_namespace(catalogue_entry(name).name, first).removeprefix("/")
        if place in requests:
            raise ConfigurationError(f"machines {machines}: namespace {place} stands twice; write NAMESPACE={name}")
        label = place.replace("/", "-")
        requests[place] = LaunchRequest(
            name, place, record=f"{record}/{label}" if record else "", view=_own_view(view, label)
        )
    if not requests:
        raise ConfigurationError("machines: expected [NAMESPACE=]MACHINE,...")
    return list(requests.values())


def _own_view(view: str, label: str) -> str:
    """Return the view of one of several runs: files are apart, a viewer's address is shared."""
    return f"{view.removesuffix('.rrd')}-{label}.rrd" if view.endswith(".rrd") else view


def discovery(asked: str, environment: Mapping[str, str] = os.environ) -> tuple[str, str]:
    """Return the discovery range in force and, where it is not the one asked for, a line that says so."""
    users = environment.get(DISCOVERY)
    if users is None:
        return asked or THIS_HOST, ""
    line = f"discovery: {DISCOVERY}={users} is set and is not overridden by {asked}" if asked not in ("", users) else ""
    return users, line

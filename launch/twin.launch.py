# SPDX-License-Identifier: Apache-2.0
"""Launches the nodes of a machine on a native ROS 2 installation.

``ros2 launch mech_twin twin.launch.py machine:=mb10_breaker pace:=realtime record:=DIR view:=NAME.rrd``
"""

import os
import signal

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit, OnShutdown
from launch.events import matches_action
from launch.events.process import ProcessExited, ShutdownProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from mech_twin.machines.catalog import CATALOGUE
from mech_twin.nodes.run import executables
from mech_twin.nodes.run.domain import DISCOVERY, PARENT

PACKAGE = "mech_twin"


def nodes_of(request: executables.LaunchRequest, respawn: bool) -> dict[str, Node]:
    """Return the nodes of a machine by name, the linkage last."""
    shared = {
        "package": PACKAGE,
        "namespace": executables.namespace(request),
        "remappings": executables.remappings(request),
        "parameters": [*executables.parameter_files(request), executables.parameters(request)],
        "output": "screen",
        "respawn": respawn,
        "respawn_delay": executables.RESPAWN_DELAY_S,
        "additional_env": {PARENT: str(os.getpid())},  # whatever ends the launch ends them
    }
    return {
        program.name: Node(
            executable=program.executable, name=program.name, arguments=list(program.arguments), **shared
        )
        for program in executables.programs(request)
    }


def started(context: LaunchContext) -> list:
    """Return the nodes of the machine asked for, and what ends them: each other, and the launch."""
    given = {name: LaunchConfiguration(name).perform(context) for name in executables.LaunchRequest._fields}
    respawn = LaunchConfiguration("respawn").perform(context) == "true"
    nodes = nodes_of(executables.LaunchRequest(**given), respawn)
    value, line = executables.discovery(LaunchConfiguration("discovery").perform(context))
    return [
        SetEnvironmentVariable(DISCOVERY, value),
        *([LogInfo(msg=line)] if line else []),
        *nodes.values(),
        *(end_with(name, nodes, respawn) for name in nodes),
        RegisterEventHandler(OnShutdown(on_shutdown=lambda event, context: interrupt(nodes))),
    ]


def end_with(name: str, nodes: dict[str, Node], respawn: bool) -> RegisterEventHandler:
    """Return what ends a machine's nodes, and no others, when this one ends for good; the launch ends when all have."""

    def ended(event: ProcessExited, context: LaunchContext) -> list:
        if context.is_shutdown or not executables.ends_run(name, event.returncode, respawn):
            return []
        return [EmitEvent(event=ShutdownProcess(process_matcher=matches_action(node))) for node in nodes.values()]

    return RegisterEventHandler(OnProcessExit(target_action=nodes[name], on_exit=ended))


def interrupt(nodes: dict[str, Node]) -> None:
    """Send each node SIGINT: on Ctrl-C the launch library counts on the terminal to do so, and there may be none."""
    for node in nodes.values():
        pid = (node.process_details or {}).get("pid")
        if pid is not None and node.return_code is None:
            try:
                os.kill(pid, signal.SIGINT)
            except ProcessLookupError:
                continue


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "machine", default_value="mb10_breaker", description=f"{', '.join(CATALOGUE)}, or the path of a page"
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="",
                description="where the nodes live, with a clock of their own; empty: /MACHINE and /clock",
            ),
            DeclareLaunchArgument(
                "pace",
                default_value="realtime",
                choices=list(executables.PACES),
                description="follow the wall clock, or run as fast as answers come",
            ),
            DeclareLaunchArgument("duration", default_value="0", description="simulated seconds; 0 until stopped"),
            DeclareLaunchArgument(
                "params_file",
                default_value="",
                description="a whole configuration, or a parameter file laid over that of the machine",
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="false",
                choices=list(executables.SWITCH),
                description="ROS time of the nodes from the clock topic; a run does not depend on it",
            ),
            DeclareLaunchArgument(
                "discovery",
                default_value="",
                choices=list(executables.RANGES),
                description=f"discovery range where {DISCOVERY} is not set; empty: LOCALHOST",
            ),
            DeclareLaunchArgument(
                "respawn",
                default_value="false",
                choices=list(executables.SWITCH),
                description="start a node that died again; it rejoins the run",
            ),
            DeclareLaunchArgument(
                "frames",
                default_value="true",
                choices=list(executables.SWITCH),
                description="publish TF and the robot description",
            ),
            DeclareLaunchArgument("record", default_value="", description="recording directory; empty makes none"),
            DeclareLaunchArgument("view", default_value="", description="file NAME.rrd; empty shows none"),
            OpaqueFunction(function=started),
        ]
    )

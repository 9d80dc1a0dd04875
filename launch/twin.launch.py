"""Launches the nodes of a machine on a native ROS 2 installation.

``ros2 launch mech_twin twin.launch.py machine:=mb10_breaker pace:=realtime record:=DIR view:=NAME.rrd``
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription
from mech_twin.machines.catalog import CATALOGUE

PACKAGE = "mech_twin"
ROLES = {"motor_node": "motor", "force_node": "force_analysis", "body_node": "body", "linkage_node": "linkage"}


def machine_nodes(context: LaunchContext) -> list:
    """Return the nodes of the machine asked for, the linkage last; the launch ends when the linkage does."""
    machine, pace, record, view = (
        LaunchConfiguration(name).perform(context) for name in ("machine", "pace", "record", "view")
    )
    file = str(Path(get_package_share_directory(PACKAGE)) / "config" / f"{machine}.yaml")
    options = {"machine": machine, "run.pace": pace, "run.recorder": bool(record), "run.viewer": bool(view)}
    shared = {"package": PACKAGE, "namespace": machine, "parameters": [file, options], "output": "screen"}
    executables = [name for name in ROLES if name != "body_node" or CATALOGUE[machine].has_body]
    nodes = [Node(executable=name, name=ROLES[name], **shared) for name in executables]
    if record:
        nodes.insert(0, Node(executable="recorder_node", name="recorder", arguments=["--directory", record], **shared))
    if view:
        nodes.insert(0, Node(executable="viewer_node", name="viewer", arguments=["--place", view], **shared))
    end = RegisterEventHandler(OnProcessExit(target_action=nodes[-1], on_exit=[EmitEvent(event=Shutdown())]))
    return [*nodes, end]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, the discovery range of the twin (this machine), and the nodes."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("machine", default_value="mb10_breaker", description="machine of the catalogue"),
            DeclareLaunchArgument("pace", default_value="realtime", description="realtime or max"),
            DeclareLaunchArgument("record", default_value="", description="recording directory; empty makes none"),
            DeclareLaunchArgument("view", default_value="", description="viewer address or NAME.rrd; empty shows none"),
            SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
            OpaqueFunction(function=machine_nodes),
        ]
    )

# SPDX-License-Identifier: Apache-2.0
"""Launches several machines at once, each in a namespace and with a clock of its own.

``ros2 launch mech_twin machines.launch.py machines:=mb10_breaker,left=winding_drum,right=winding_drum``
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from mech_twin.nodes.run import executables

ONE = Path(__file__).with_name("twin.launch.py")
SHARED = {
    "pace": "realtime",
    "duration": "0",
    "use_sim_time": "false",
    "discovery": "",
    "respawn": "false",
    "frames": "true",
}


def each(context: LaunchContext) -> list:
    """Return the launch of each machine asked for."""
    machines, record, view = (LaunchConfiguration(name).perform(context) for name in ("machines", "record", "view"))
    shared = {name: LaunchConfiguration(name).perform(context) for name in SHARED}
    return [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(ONE)),
            launch_arguments={**request._asdict(), **shared}.items(),
        )
        for request in executables.launch_requests(machines, record, view)
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the machines; the launch ends when the last of them does."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "machines",
                default_value="mb10_breaker,winding_drum",
                description="[NAMESPACE=]MACHINE,...; the namespace is the machine's name if it is left out",
            ),
            *(
                DeclareLaunchArgument(name, default_value=value, description="as in twin.launch.py")
                for name, value in SHARED.items()
            ),
            DeclareLaunchArgument("record", default_value="", description="directory of one recording a machine"),
            DeclareLaunchArgument("view", default_value="", description="file NAME.rrd, one a machine"),
            OpaqueFunction(function=each),
        ]
    )

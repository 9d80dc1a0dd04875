"""The process's place in ROS: discovery stays on this machine unless the user says otherwise."""

from __future__ import annotations

import os
import sys
import tempfile

DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"
THIS_HOST = "LOCALHOST"
OTHER_HOSTS = "SUBNET"


def settle_domain(open_to_other_hosts: bool = False) -> str:
    """Set what rclpy reads from the environment, where the user has not set it; call before importing rclpy.

    Parameters
    ----------
    open_to_other_hosts : bool
        Let nodes on other hosts of the network discover this process, and it them.

    Returns
    -------
    str
        The discovery range in force.
    """
    os.environ.setdefault(DISCOVERY, OTHER_HOSTS if open_to_other_hosts else THIS_HOST)
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if "HOME" not in os.environ:
        os.environ.setdefault("ROS_LOG_DIR", tempfile.gettempdir())
    return os.environ[DISCOVERY]

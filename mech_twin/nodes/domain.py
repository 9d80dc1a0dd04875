"""The process's place in ROS: discovery stays on this machine unless the user says otherwise."""

from __future__ import annotations

import os
import sys
import tempfile

DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"


def settle_domain() -> None:
    """Set what rclpy reads from the environment, where the user has not set it; call before importing rclpy."""
    os.environ.setdefault(DISCOVERY, "LOCALHOST")
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if "HOME" not in os.environ:
        os.environ.setdefault("ROS_LOG_DIR", tempfile.gettempdir())

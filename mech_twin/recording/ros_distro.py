# SPDX-License-Identifier: Apache-2.0
"""The name of the running ROS 2 release, as written to recordings."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from types import MappingProxyType

VARIABLE = "ROS_DISTRO"  # a native installation sets it; the wheels do not
# major version of rclpy in each release; as a wheel its distribution is called ros-rclpy
RELEASES: Mapping[str, str] = MappingProxyType({"3": "humble", "7": "jazzy", "9": "kilted"})
RCLPY = ("ros-rclpy", "rclpy")
UNKNOWN = "unknown"


def running_distro(environment: Mapping[str, str] = os.environ, installed: Callable[[str], str] = version) -> str:
    """Return the release, from the environment or from the version of rclpy; ``unknown`` if neither gives it.

    Parameters
    ----------
    environment : mapping, optional
        Environment variables of the process.
    installed : callable, optional
        Returns the version of a distribution; raises PackageNotFoundError.
    """
    named = environment.get(VARIABLE)
    if named:
        return named
    for distribution in RCLPY:
        try:
            return RELEASES.get(installed(distribution).partition(".")[0], UNKNOWN)
        except PackageNotFoundError:
            continue
    return UNKNOWN

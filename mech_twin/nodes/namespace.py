# SPDX-License-Identifier: Apache-2.0
"""The namespace of a run, as arguments of ROS.

A run lives in ``/MACHINE`` unless it is told otherwise.  In a namespace of its own it also has a clock of its own, so
that two runs of one machine share nothing but ``/diagnostics``, whose entries carry full node names.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from mech_twin.configuration_tree import ConfigurationError

NAME = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")


def run_namespace(machine_name: str, namespace: str | None) -> str:
    """Return the full namespace of a run.

    Raises
    ------
    ConfigurationError
        If it is no name of ROS.
    """
    if namespace is None:
        return f"/{machine_name}"
    if not NAME.fullmatch(namespace) or "__" in namespace or namespace.endswith("_"):
        raise ConfigurationError(f"--namespace {namespace}: expected letters, digits and _, such as hall/plant_2")
    return f"/{namespace.removeprefix('/')}"


def ros_arguments(machine_name: str, namespace: str | None) -> list[str]:
    """Return the arguments of ROS that put the nodes of a run into its namespace; none where it is the default."""
    if namespace is None:
        return []
    from mech_twin.messages.topics import CLOCK  # a name is checked before surroundings are, and before rclpy is loaded

    full = run_namespace(machine_name, namespace)
    return ["--ros-args", "-r", f"__ns:={full}", "-r", f"{CLOCK.name}:={full}{CLOCK.name}"]


def replay_arguments(topics: Iterable[str], namespace: str | None) -> list[str]:
    """Return the arguments of ROS that move recorded topics, the first level of their names replaced."""
    if namespace is None:
        return []
    from mech_twin.messages.topics import CLOCK

    full = run_namespace("", namespace)
    moved = {name: full + (CLOCK.name if name == CLOCK.name else f"/{name.split('/', 2)[-1]}") for name in topics}
    rules = [f"{old}:={new}" for old, new in moved.items() if old.count("/") > 1 or old == CLOCK.name]
    return ["--ros-args", "-r", f"__ns:={full}", *(word for rule in rules for word in ("-r", rule))]

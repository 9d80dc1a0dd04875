# SPDX-License-Identifier: Apache-2.0
"""ROS environment of the process: discovery range, namespace, logs; discovery is limited to this host by default.

Importing this module loads no ROS, which reads its environment once.  The namespace of a run is ``/MACHINE`` by
default.  In another namespace it also has a clock of its own, so that two runs of one machine share only
``/diagnostics``, whose entries carry full node names.

A node's process ends when its launch does, even by SIGKILL (Linux).
"""

import os
import re
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.errors import OneLineError
from mech_twin.process.dependencies import SurroundingsError, check_address_space
from mech_twin.process.interruption import end_with_parent


class NodeEndedError(OneLineError):
    """A node's process ended by itself, with an error that it has already printed."""


class NameInUseError(NodeEndedError):
    """There is already a publisher on the topics of this process."""


class UnansweredError(RuntimeError):
    """A node that was sent a command is absent, does not answer, or refuses."""


DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"
THIS_HOST = "LOCALHOST"
OTHER_HOSTS = "SUBNET"
LOG_DIRECTORY = "ROS_LOG_DIR"
ADDRESS_SPACE_BYTES = 1 << 30  # with less, threads and libraries of the middleware fail unpredictably
SHARED_MEMORY = Path("/dev/shm")
SHARED_MEMORY_BYTES = 4 << 20  # each process of a run takes 0.6 MB


def settle_domain(open_to_other_hosts: bool = False) -> str:
    """Set the environment variables of rclpy that the user has not set; call before importing rclpy.

    Parameters
    ----------
    open_to_other_hosts : bool
        Let nodes on other hosts of the network discover this process, and it them.

    Returns
    -------
    str
        The discovery range in force.

    Raises
    ------
    SurroundingsError
        If shared memory is full, or the address space too small.
    """
    os.environ.setdefault(DISCOVERY, OTHER_HOSTS if open_to_other_hosts else THIS_HOST)
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if LOG_DIRECTORY not in os.environ:
        home = os.environ.get("ROS_HOME") or f"{os.environ.get('HOME', os.devnull)}/.ros"  # rclpy's default
        if _lack_of_logs(Path(home, "log")):
            os.environ[LOG_DIRECTORY] = tempfile.gettempdir()
    named = os.environ.get(LOG_DIRECTORY)
    if named and (lack := _lack_of_logs(Path(named))):
        raise SurroundingsError(f"{LOG_DIRECTORY} {named}: {lack}")
    check_address_space(ADDRESS_SPACE_BYTES, "ROS 2 takes")
    _check_shared_memory()
    return os.environ[DISCOVERY]


def _lack_of_logs(place: Path) -> str:
    """Return why rclpy could not write to a log directory, which is made; empty if it can."""
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return f"cannot be made ({error.strerror})"
    return "" if os.access(place, os.W_OK) else "cannot be written"


def _check_shared_memory() -> None:
    """Raise if shared memory is too full: a process that writes beyond its end is killed by a bus error.

    The tracing library of rclpy always writes there.  So does Fast DDS with discovery on this host only, whatever its
    configuration.  If shared memory is not writable at all, both work without it.
    """
    try:
        place = os.statvfs(SHARED_MEMORY)
    except OSError:
        return
    free = place.f_bavail * place.f_frsize
    if free < SHARED_MEMORY_BYTES and os.access(SHARED_MEMORY, os.W_OK):
        needed = f"{SHARED_MEMORY_BYTES >> 20} MiB"
        raise SurroundingsError(
            f"{SHARED_MEMORY} is full ({free >> 10} KiB free, ROS 2 needs {needed}): remove files there"
        )


NAME = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")


def run_namespace(machine_name: str, namespace: str | None) -> str:
    """Return the full namespace of a run; ``/MACHINE`` if none is given.

    Raises
    ------
    ConfigurationError
        If it is not a valid ROS namespace.
    """
    if namespace is None:
        return f"/{machine_name}"
    if not NAME.fullmatch(namespace) or "__" in namespace or namespace.endswith("_"):
        raise ConfigurationError(f"--namespace {namespace}: expected letters, digits and _, such as hall/plant_2")
    return f"/{namespace.removeprefix('/')}"


def ros_arguments(machine_name: str, namespace: str | None) -> list[str]:
    """Return the ROS arguments for the namespace of a run; none for the default."""
    if namespace is None:
        return []
    from mech_twin.messages.topics import CLOCK  # names are checked before the environment, and before rclpy is loaded

    full = run_namespace(machine_name, namespace)
    return ["--ros-args", "-r", f"__ns:={full}", "-r", f"{CLOCK.name}:={full}{CLOCK.name}"]


def replay_arguments(topics: Mapping[str, str], namespace: str | None) -> list[str]:
    """Return the ROS arguments that move topics, given by full name and name below the recorded namespace."""
    if namespace is None:
        return []
    from mech_twin.messages.topics import CLOCK

    full = run_namespace("", namespace)
    rules = [f"{old}:={full}/{below}" for old, below in topics.items() if old.count("/") > 1 or old == CLOCK.name]
    return ["--ros-args", "-r", f"__ns:={full}", *(word for rule in rules for word in ("-r", rule))]


PARENT = "MECH_TWIN_PARENT"


def end_with_launch() -> None:
    """End when the process in the variable ``MECH_TWIN_PARENT`` ends, if it is the parent of this one.

    A launch that is ended by SIGTERM or SIGKILL does not end its processes.
    """
    named = os.environ.get(PARENT, "")
    if not named.isdecimal():
        return
    if os.getppid() == int(named) or not Path("/proc", named).exists():  # else one is in between, such as a debugger
        end_with_parent(int(named))

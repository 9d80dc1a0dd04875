# SPDX-License-Identifier: Apache-2.0
"""The process's place in ROS: discovery stays on this machine unless the user says otherwise."""

from __future__ import annotations

import os
import resource
import sys
import tempfile
from pathlib import Path

from mech_twin.surroundings import MIB, SurroundingsError

DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"
THIS_HOST = "LOCALHOST"
OTHER_HOSTS = "SUBNET"
LOG_DIRECTORY = "ROS_LOG_DIR"
ADDRESS_SPACE_BYTES = 1 << 30  # with less, threads and libraries of the middleware fail at places of their own
SHARED_MEMORY = Path("/dev/shm")
SHARED_MEMORY_BYTES = 4 << 20  # each process of a run takes 0.6 MB


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

    Raises
    ------
    SurroundingsError
        If shared memory is full, or the address space too small.
    """
    os.environ.setdefault(DISCOVERY, OTHER_HOSTS if open_to_other_hosts else THIS_HOST)
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if LOG_DIRECTORY not in os.environ and not _home_takes_logs():
        os.environ[LOG_DIRECTORY] = tempfile.gettempdir()
    _check_log_directory()
    _check_address_space()
    _check_shared_memory()
    return os.environ[DISCOVERY]


def _home_takes_logs() -> bool:
    """Return whether rclpy can log where it does unasked; with a directory there that is another user's it ends."""
    if "HOME" not in os.environ:
        return False
    place = Path(os.environ.get("ROS_HOME") or Path(os.environ["HOME"]) / ".ros") / "log"
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(place, os.W_OK)


def _check_log_directory() -> None:
    """Raise where the directory for logs that the user has named cannot be made: rclpy would not start."""
    named = os.environ.get(LOG_DIRECTORY)
    if not named:
        return
    try:
        Path(named).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SurroundingsError(f"{LOG_DIRECTORY} {named}: cannot be made ({error.strerror})") from error
    if not os.access(named, os.W_OK):
        raise SurroundingsError(f"{LOG_DIRECTORY} {named}: cannot be written")


def _check_address_space() -> None:
    """Raise where the middleware would find no memory halfway: it ends or waits for ever, wherever it happens to be."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < ADDRESS_SPACE_BYTES:
        told = f"limit of address space {limit // MIB} MiB, ROS 2 takes {ADDRESS_SPACE_BYTES // MIB} MiB"
        raise SurroundingsError(f"not enough memory ({told}): raise it, ulimit -v unlimited")


def _check_shared_memory() -> None:
    """Raise where shared memory is too full: whoever writes there beyond its end is ended by a bus error.

    The tracing that rclpy loads does so unasked, and so does Fast DDS, which with discovery on this machine alone uses
    shared memory whatever it is told.  Where it cannot be written at all, both do without.
    """
    free = _free_shared_memory()
    if free is not None and free < SHARED_MEMORY_BYTES:
        needed = f"{SHARED_MEMORY_BYTES >> 20} MiB"
        raise SurroundingsError(
            f"{SHARED_MEMORY} is full ({free >> 10} KiB free, ROS 2 needs {needed}): remove files there"
        )


def _free_shared_memory() -> int | None:
    """Return the free bytes of shared memory, None where it cannot be written."""
    try:
        place = os.statvfs(SHARED_MEMORY)
    except OSError:
        return None
    return place.f_bavail * place.f_frsize if os.access(SHARED_MEMORY, os.W_OK) else None

# SPDX-License-Identifier: Apache-2.0
"""Limits of the system (memory, open files): errors caused by them as one line that names the limit."""

from __future__ import annotations

import errno
import os
import resource

MIB = 1 << 20
UNLIMITED = "none"
_OPEN_FILES = {errno.EMFILE, errno.ENFILE}
# messages of the dynamic loader and of libraries that allocate memory themselves
_NO_MEMORY = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory", "bad_alloc")
_SECURITY = "security"  # in the middleware's errors on a missing key, or a library built without security


NUMERICS_BYTES = 480 * MIB  # with less, the libraries of the kernels fail unpredictably, or hang
FIT_BYTES = 640 * MIB  # with less, linear algebra may end the process in its own words


def check_address_space(needed: int, what: str) -> None:
    """Check that the limit of address space is at least ``needed`` (bytes).

    Raises
    ------
    SurroundingsError
        The limit is lower; the message names it, and what needs more.
    """
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < needed:
        shortage = f"limit of address space {limit // MIB} MiB, {what} {needed // MIB} MiB"
        raise SurroundingsError(f"not enough memory ({shortage}): raise it, ulimit -v unlimited")


class SurroundingsError(Exception):
    """The system lacks something that a run needs; the message is one line that names it."""


def lacking(error: BaseException) -> str | None:
    """Return a line that names the exceeded limit of the system; None if the error has another reason.

    Parameters
    ----------
    error : BaseException
        The error; its causes and contexts are checked too.
    """
    if isinstance(error, SurroundingsError):
        return str(error)
    cause: BaseException | None = error
    while cause is not None:
        if _is_open_files(cause):
            limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
            return f"too many open files (limit {_limit(limit, 1)}): raise it, ulimit -n 256"
        if _is_memory(cause):
            limit = resource.getrlimit(resource.RLIMIT_AS)[0]
            return f"not enough memory (limit of address space {_limit(limit, MIB)}): raise it, ulimit -v unlimited"
        if isinstance(cause, RuntimeError) and _SECURITY in str(cause).lower():
            reason = str(cause).partition("\n")[0].partition(", at /")[0]
            return f"ROS_SECURITY_ENABLE is set, and DDS security cannot be had: {reason}"
        cause = cause.__cause__ or cause.__context__
    return None


def _is_open_files(error: BaseException) -> bool:
    if isinstance(error, OSError):
        return error.errno in _OPEN_FILES
    return isinstance(error, RuntimeError) and os.strerror(errno.EMFILE) in str(error)  # as reported by the middleware


def _is_memory(error: BaseException) -> bool:
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    if isinstance(error, SystemError):  # an extension that did not check an allocation
        return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
    return isinstance(error, ImportError | RuntimeError) and any(words in str(error) for words in _NO_MEMORY)


def _limit(limit: int, unit: int) -> str:
    if limit == resource.RLIM_INFINITY:
        return UNLIMITED
    return f"{limit // unit} MiB" if unit == MIB else str(limit)

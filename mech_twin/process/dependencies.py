# SPDX-License-Identifier: Apache-2.0
"""Checks of dependencies (versions at start, extras when used) and limits of the system (memory, open files).

Each error is one line that names what lacks.
"""

import errno
import os
import re
import resource
import sys
from collections.abc import Callable, Iterable
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec

MIB = 1 << 20
UNLIMITED = "none"
_OPEN_FILES = {errno.EMFILE, errno.ENFILE}
# messages of the dynamic loader and of libraries that allocate memory themselves
_NO_MEMORY = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory", "bad_alloc")
_SECURITY = "security"  # in the middleware's errors on a missing key, or a library built without security


NUMERICS_BYTES = 480 * MIB  # with less, the libraries of the kernels fail unpredictably, or hang
FIT_BYTES = 640 * MIB  # with less, linear algebra may end the process in its own words
PACKAGE = "mech_twin"
EXIT_CODE = 2
EXTRA_OF = {
    "rerun": "view",
    "aiohttp": "view",
    "matplotlib": "plots",
    "PIL": "plots",
    "pyarrow": "tables",
    "pandas": "pandas",
    "distributed": "cluster",
    "ziglang": "fmu",
    "rainflow": "life",
    "numba_cuda": "cuda",
    "foxglove": "foxglove",
    "paho": "alerts",
    "prometheus_client": "alerts",
}
_OF_ROS = re.compile(r"rclpy|\w+_(msgs|srvs|interfaces)")
_BOUND = re.compile(r"([A-Za-z0-9._-]+)\s*>=\s*([0-9.]+)$")


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
    """Return a line that names the limit of the system that an error, or what caused it, exceeded; None for none."""
    if isinstance(error, SurroundingsError):
        return str(error)
    cause: BaseException | None = error
    while cause is not None:
        if _is_open_files(cause):
            return f"too many open files (limit {_limit(resource.RLIMIT_NOFILE)}): raise it, ulimit -n 256"
        if _is_memory(cause):
            limit = _limit(resource.RLIMIT_AS)
            return f"not enough memory (limit of address space {limit}): raise it, ulimit -v unlimited"
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


def _limit(kind: int) -> str:
    limit = resource.getrlimit(kind)[0]
    if limit == resource.RLIM_INFINITY:
        return UNLIMITED
    return f"{limit // MIB} MiB" if kind == resource.RLIMIT_AS else str(limit)


def _number(text: str) -> tuple[int, ...]:
    leading = re.match(r"\d+(\.\d+)*", text)
    return tuple(int(part) for part in leading.group().split(".")) if leading else ()


def unmet(requirements: Iterable[str], installed: Callable[[str], str] = version) -> list[str]:
    """Return what is missing or too old, one phrase each.

    Parameters
    ----------
    requirements : iterable of str
        As in the metadata of a package, ``numba>=0.60``; those of an extra (with ``;``) are skipped.
    installed : callable, optional
        Returns the version of a distribution; raises PackageNotFoundError.
    """
    found = []
    for requirement in requirements:
        bound = _BOUND.match(requirement)
        if bound is None:
            continue
        name, lowest = bound.groups()
        try:
            has = installed(name)
        except PackageNotFoundError:
            found.append(f"{name} {lowest} or newer (not installed)")
            continue
        if _number(has) < _number(lowest):
            found.append(f"{name} {lowest} or newer (found {has})")
    return found


def require_versions() -> None:
    """Exit with a one-line message if a required package is missing or too old; an uninstalled tree is not checked."""
    try:
        declared = requires(PACKAGE) or []
    except PackageNotFoundError:
        return
    lacking = unmet(declared)
    if lacking:
        names = " ".join(f"'{phrase.split()[0]}>={phrase.split()[1]}'" for phrase in lacking)
        sys.stderr.write(f"{PACKAGE}: needs {', '.join(lacking)}: pip install {names}\n")
        raise SystemExit(EXIT_CODE)


def extra_needed(extra: str) -> str:
    """Return a line that names an extra and its installation command."""
    return f"needs the extra '{extra}': pip install '{PACKAGE}[{extra}]'"


def require_extra(extra: str) -> None:
    """Check before a computation that the modules of an extra are installed.

    Raises
    ------
    ModuleNotFoundError
        If a module of the extra is not installed; `missing_extra` gives the line for it.
    """
    require_modules(*(name for name, brings in EXTRA_OF.items() if brings == extra))


def require_modules(*modules: str) -> None:
    """Check before a computation that modules are installed.

    Raises
    ------
    ModuleNotFoundError
        If one is not installed; `missing_extra` gives the line for it.
    """
    for module in modules:
        if find_spec(module) is None:
            extra = EXTRA_OF.get(module)
            remedy = f": {extra_needed(extra)}" if extra else ""
            raise ModuleNotFoundError(f"no module {module!r}{remedy}", name=module)


def missing_extra(error: ImportError) -> str | None:
    """Return a line for an import that failed because an extra or ROS is missing; None for another reason."""
    module = (error.name or "").partition(".")[0]
    if _OF_ROS.fullmatch(module):
        return f"expected ROS 2 for Python, no module {module!r}: {extra_needed('jazzy')}"
    extra = EXTRA_OF.get(module)
    return extra_needed(extra) if extra and isinstance(error, ModuleNotFoundError) else None

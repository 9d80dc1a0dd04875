# SPDX-License-Identifier: Apache-2.0
"""Checks of dependencies: versions at start, extras when they are used; each error is one line."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec

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
    "foxglove": "foxglove",
    "paho": "alerts",
    "prometheus_client": "alerts",
}
_OF_ROS = re.compile(r"rclpy|\w+_(msgs|srvs|interfaces)")
_BOUND = re.compile(r"([A-Za-z0-9._-]+)\s*>=\s*([0-9.]+)$")


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

"""mech_twin: the digital twin of percussion and crank-linkage machines.

From Python ``import mech_twin as mt`` and `mt.simulate`, `mt.analyse`, `mt.sweep`, `mt.size`, `mt.search`,
`mt.reproduce`, `mt.machines`: see `mech_twin.api`.  They are loaded when first named, so that a node or a tool that
needs one room of the package does not pay for the others.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
# what a type checker sees of these stands in __init__.pyi
__all__ = ["analyse", "machines", "reproduce", "search", "simulate", "size", "sweep"]


def __getattr__(name: str) -> Any:
    """Return a function of `mech_twin.api`."""
    if name not in __all__:
        raise AttributeError(f"module 'mech_twin' has no attribute '{name}'")
    return getattr(import_module("mech_twin.api"), name)


def __dir__() -> list[str]:
    """Return the names of the package, those not loaded yet included."""
    return sorted({*globals(), *__all__})

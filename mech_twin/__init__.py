# SPDX-License-Identifier: Apache-2.0
"""mech_twin: the digital twin of percussion and crank-linkage machines.

From Python ``import mech_twin as mt`` and `mt.simulate`, `mt.analyse`, `mt.sweep`, `mt.size`, `mt.search`,
`mt.identify`, `mt.compare`, `mt.reproduce`, `mt.from_json`, `mt.machine_names`: see `mech_twin.api`;
`mt.rollout`, `mt.rollouts`: see `mech_twin.studies.named_rollouts`.
They are loaded when first named, so that a node or a tool that needs one room of the package does not pay for the
others.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.3.0"
# what a type checker sees of these stands in __init__.pyi
__all__ = [
    "analyse",
    "compare",
    "from_json",
    "identify",
    "machine_names",
    "reproduce",
    "rollout",
    "rollouts",
    "search",
    "simulate",
    "size",
    "sweep",
]


def __getattr__(name: str) -> Any:
    """Return a function of the package."""
    if name not in __all__:
        raise AttributeError(f"module 'mech_twin' has no attribute '{name}'")
    room = "mech_twin.studies.named_rollouts" if name.startswith("rollout") else "mech_twin.api"
    return getattr(import_module(room), name)


def __dir__() -> list[str]:
    """Return the names of the package, those not loaded yet included."""
    return sorted({*globals(), *__all__})

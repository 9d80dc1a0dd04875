# SPDX-License-Identifier: Apache-2.0
"""mech_twin: the digital twin of percussion and crank-linkage machines.

From Python ``import mech_twin as mt`` and `mt.simulate`, `mt.analyse`, `mt.sweep`, `mt.size`, `mt.search`,
`mt.identify`, `mt.compare`, `mt.reproduce`, `mt.from_json`, `mt.machine_names`: see `mech_twin.api`;
`mt.rollout`, `mt.rollouts`: see `mech_twin.studies.named_rollouts`.
They are imported at first use, so that a node or a tool that needs one subpackage does not load the others.
"""

from importlib import import_module
from typing import Any

__version__ = "0.3.0"
# their types for a type checker are in __init__.pyi
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
    """Return a function of the package, imported at first use."""
    if name not in __all__:
        raise AttributeError(f"module 'mech_twin' has no attribute '{name}'")
    room = "mech_twin.studies.named_rollouts" if name.startswith("rollout") else "mech_twin.api"
    return getattr(import_module(room), name)


def __dir__() -> list[str]:
    """Return the names of the package, including those not loaded yet."""
    return sorted({*globals(), *__all__})

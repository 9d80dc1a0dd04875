"""mech_twin: the digital twin of percussion and crank-linkage machines.

``mech_twin.rollout`` and ``mech_twin.rollouts`` are those of `mech_twin.studies.rolling_out`, imported when asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_ASKED_FOR = {"rollout": "mech_twin.studies.rolling_out", "rollouts": "mech_twin.studies.rolling_out"}


def __getattr__(name: str) -> Any:
    if name not in _ASKED_FOR:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_ASKED_FOR[name]), name)

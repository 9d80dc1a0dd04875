# SPDX-License-Identifier: Apache-2.0
"""Studies of a machine, under their names on the command line; each is imported at first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mech_twin.studies.declared_studies import draw_figures, regimes, reproduce, size, synthesise
    from mech_twin.studies.design_scan import designs, search
    from mech_twin.studies.parameter_sweep import sweep
    from mech_twin.studies.run_search import search_runs

__all__ = ["designs", "draw_figures", "regimes", "reproduce", "search", "search_runs", "size", "sweep", "synthesise"]
ROOMS = {
    "designs": "design_scan",
    "draw_figures": "declared_studies",
    "regimes": "declared_studies",
    "reproduce": "declared_studies",
    "search": "design_scan",
    "search_runs": "run_search",
    "size": "declared_studies",
    "sweep": "parameter_sweep",
    "synthesise": "declared_studies",
}


def __getattr__(name: str) -> Any:
    """Return a study, imported at first use."""
    if name not in ROOMS:
        raise AttributeError(f"module 'mech_twin.studies' has no attribute '{name}'")
    return getattr(import_module(f"mech_twin.studies.{ROOMS[name]}"), name)

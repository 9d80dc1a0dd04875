# SPDX-License-Identifier: Apache-2.0
"""Runs that are computed on a graphics processor and on the processor; as a program: `graphics_cases.py FILE`."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import Any

import mech_twin as mt

CASES: dict[str, tuple[str, float, list[dict[str, Any]], dict[str, Any]]] = {
    "mb10_breaker": ("mb10_breaker", 0.15, [{}, {"friction.coulomb_nm": 2.0}], {"commands": [1.0, 0.9]}),
    "half sine": ("mb10_breaker", 0.1, [{"excitation.kind": "approximated"}], {}),
    "compaction_press": ("compaction_press", 0.05, [{}, {}], {"commands": [1.0, [(0.02, 0.5)]]}),
    "vibration_crank": (
        "vibration_crank", 0.05, [{}, {}],
        {"commands": [1.0, 0.9], "changes": [(0.02, {"working_force_n": 300.0})]},
    ),
    "impact_mass": ("impact_mass", 0.7, [{}, {"restitution": 0.5}], {}),
    "a step full of events": ("impact_mass", 2.0, [{"coupling.step_s": 0.5}, {}], {}),
    "roller_former": ("roller_former", 0.05, [{}, {"carts.count": 1}], {"columns": ["linkage.crank.velocity"]}),
    "winding_drum": ("winding_drum", 0.05, [{}] * 3, {"commands": [1.0, 0.5, 0.9]}),
}  # fmt: skip


def numbers_of(device: str) -> dict[str, list[Any]]:
    """Return the columns, events, residuals, last rows and errors of the members of each case."""
    found = {}
    for name, (machine, duration_s, settings, options) in CASES.items():
        members = mt.rollouts(machine, duration_s, settings, device=device, **options)
        found[name] = [
            ({key: column.tobytes() for key, column in m.columns.items()}, m.events, m.residuals, m.final, str(m.error))
            for m in members
        ]
    return found


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(pickle.dumps(numbers_of("cuda")))

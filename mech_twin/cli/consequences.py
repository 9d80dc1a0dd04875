# SPDX-License-Identifier: Apache-2.0
"""What ``--set`` does to a machine's own figures, said where it is out of proportion: a slip of a unit shows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mech_twin.cli.console import say
from mech_twin.declarations.captions import caption
from mech_twin.parameters.load import assignments
from mech_twin.parameters.load import machine as built_machine

OUT_OF_PROPORTION = 30.0  # times the figure without --set


def consequences(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[tuple[str, float, float]]:
    """Return name, value and ratio of each figure that is out of proportion, the largest ratio first."""
    found = []
    for name, value in after.items():
        past = before.get(name)
        if not isinstance(value, int | float) or not isinstance(past, int | float) or not past:
            continue
        ratio = abs(value / past)
        if math.isfinite(ratio) and ratio >= OUT_OF_PROPORTION:
            found.append((name, float(value), ratio))
    return sorted(found, key=lambda row: -row[2])


def say_consequences(machine: str, config: Path | None, settings: Sequence[str]) -> None:
    """Say the figure that ``--set`` changes most, where that is out of proportion."""
    if not settings:
        return
    reports = [built_machine(machine, config, changes).report() for changes in ({}, assignments(settings))]
    found = consequences(*reports)
    if found:
        name, value, ratio = found[0]
        label, unit = caption(name)
        say(f"warning: --set {' '.join(settings)}: {label} {value:.4g} {unit}, {ratio:.0f} times that without --set")

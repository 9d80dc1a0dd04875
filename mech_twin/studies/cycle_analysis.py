# SPDX-License-Identifier: Apache-2.0
"""Analysis of a machine over one turn of the crank, as columns."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from mech_twin.roles import Machine


def cycle_positions(count: int) -> list[float]:
    """Return ``count`` crank angles (rad), evenly spaced over one turn from 0, without its end."""
    return [2.0 * math.pi * i / count for i in range(count)]


def analysed_columns(machine: Machine, crank_rad: Iterable[float]) -> dict[str, list[Any]]:
    """Return all results of the analysis at these crank angles (rad), one list for each name."""
    rows = [{"crank_rad": angle, **machine.analyse(angle)} for angle in crank_rad]
    return {key: [row[key] for row in rows] for key in rows[0]}

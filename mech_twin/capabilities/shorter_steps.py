# SPDX-License-Identifier: Apache-2.0
"""Results of a run repeated with a shorter coupling step: digits that agree do not depend on the step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class InShorterSteps(NamedTuple):
    """Results of a run by name with a coupling step (s), compared with one of a longer step (s)."""

    step_s: float
    beside_s: float
    numbers: Mapping[str, float]

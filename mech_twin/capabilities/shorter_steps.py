# SPDX-License-Identifier: Apache-2.0
"""Numbers of a run once more in a shorter coupling step: what both have in common does not depend on the step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class InShorterSteps(NamedTuple):
    """Numbers of a run by name in a coupling step (s), beside one in a longer step (s)."""

    step_s: float
    beside_s: float
    numbers: Mapping[str, float]

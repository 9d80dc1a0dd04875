# SPDX-License-Identifier: Apache-2.0
"""Every number of a configuration has a declared range, and at its extremes it is an answer or one line.

The whole of it is ``benchmarks/reliability/extreme_configurations.py``.
"""

from __future__ import annotations

import math
import random

import pytest
from catalogue import NAMES
from draws.keys import MAGNITUDES, extreme_changes, installed_tree, leaves
from draws.outcomes import ANSWERED, REFUSED, command_outcome

from mech_twin.declarations.quantity import RANGES
from mech_twin.machines.catalog import CATALOGUE

SHOWN = 8  # of each machine


@pytest.mark.parametrize("name", NAMES)
def test_every_number_declares_a_range(name: str) -> None:
    numbers = {change.key for change in extreme_changes(name)}
    assert len(numbers) > 10
    for leaf in leaves(CATALOGUE[name].parameters, (), installed_tree(name)):
        if leaf.key in numbers:
            assert leaf.unit in RANGES, leaf.path
            low, high = leaf.bounds
            assert -math.inf < low < high < math.inf, leaf.path
            assert high < max(MAGNITUDES), leaf.path


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_an_extreme_number_is_an_answer_or_one_line(name: str) -> None:
    chance = random.Random(f"{name} extremes")
    shown = chance.sample(extreme_changes(name), SHOWN)
    ends = [end for change in shown for end in command_outcome(name, change).ends.values()]
    assert set(ends) <= {ANSWERED, REFUSED}
    assert REFUSED in ends

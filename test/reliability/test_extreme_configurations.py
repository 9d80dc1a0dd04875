# SPDX-License-Identifier: Apache-2.0
"""Every number of a configuration has a declared range, and at its extremes it is an answer or one line.

The whole of it is ``benchmarks/reliability/extreme_configurations.py``.
"""

from __future__ import annotations

import math
import random

import pytest
from catalogue import NAMES
from configuration_draws import is_group
from extreme_values import FINE, MAGNITUDES, REFUSED, cases, outcome_of, present_leaves

from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import RANGES
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine_parameters

SHOWN = 8  # of each machine


@pytest.mark.parametrize("name", NAMES)
def test_every_number_declares_a_range(name: str) -> None:
    numbers = {case.key for case in cases(name)}
    assert len(numbers) > 10
    for leaf in present_leaves(CATALOGUE[name].parameters, configuration_tree(machine_parameters(name))):
        if ".".join(leaf.path) in numbers and not is_group(leaf.kinds):
            assert leaf.unit in RANGES, leaf.path
            low, high = leaf.bounds
            assert -math.inf < low < high < math.inf, leaf.path
            assert high < max(MAGNITUDES), leaf.path


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_an_extreme_number_is_an_answer_or_one_line(name: str) -> None:
    chance = random.Random(f"{name} extremes")
    ends = [end for case in chance.sample(cases(name), SHOWN) for end in outcome_of(case).ends.values()]
    assert set(ends) <= {FINE, REFUSED}
    assert REFUSED in ends

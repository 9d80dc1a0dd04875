# SPDX-License-Identifier: Apache-2.0
"""Keys that an importer may set, set together, give the constants that the configuration would."""

from __future__ import annotations

import random

import numpy as np
import pytest

from mech_twin.declarations.configuration_tree import configuration_tree, merged_tree, tree_from_flat
from mech_twin.engine.compiled_machine import compiled_machine, packed_models
from mech_twin.fmi.unit_variables import unit_of
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.parameters.load import machine as built_machine

SETS = 20


@pytest.mark.parametrize("name", CATALOGUE)
def test_values_set_together_are_the_constants_of_that_configuration(name: str) -> None:
    machine, entry = built_machine(name), catalogue_entry(name)
    compiled = compiled_machine(machine)
    assert compiled is not None
    unit = unit_of(machine, compiled)
    chance = random.Random(1)
    for number in range(SETS):
        drawn = chance.uniform if number % 2 else lambda *bounds: chance.choice(bounds)  # each of them is allowed
        values = {each.key.name: drawn(each.least, each.greatest) for each in unit.adjustable}
        expected = np.array(unit.packed.reals)
        for each in unit.adjustable:
            expected[list(each.places)] = values[each.key.name]
        tree = merged_tree(configuration_tree(machine.parameters), tree_from_flat(values))
        other = compiled_machine(entry.build(validated(entry, tree, "drawn")))
        assert other is not None
        assert np.array_equal(packed_models(other.models).reals, expected, equal_nan=True)

# SPDX-License-Identifier: Apache-2.0
"""Keys that an importer may set, set together, give the constants that the configuration would."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mech_twin.declarations.configuration_tree import configuration_tree, merged_tree, tree_from_flat
from mech_twin.engine.compiled_machine import compiled_machine, packed_models
from mech_twin.fmi.export import ExportError, export_fmu
from mech_twin.fmi.unit_variables import unit_of
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.parameters.load import machine as built_machine

SETS = 20


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"machine": "impact_mass"}, "'impact_mass': expected a machine"),
        ({"version": 4}, "version 4 of FMI: expected 2 or 3"),
        ({"version": "3"}, "version '3' of FMI: expected 2 or 3"),
        ({"platforms": ()}, "expected at least one of LINUX and WINDOWS"),
        ({"platforms": "linux"}, "platforms 'linux': expected at least one"),
    ],
)
def test_what_cannot_be_exported_is_refused_by_name(asked: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=said):
        export_fmu(**{"machine": built_machine("impact_mass"), "out": tmp_path / "unit.fmu", **asked})


def test_the_command_of_a_unit_has_its_bounds() -> None:
    machine = built_machine("impact_mass")
    compiled = compiled_machine(machine)
    assert compiled is not None
    command = next(v for v in unit_of(machine, compiled).variables if v.name == "speed_command")
    assert (command.least, command.greatest) == (0.0, 1.0)


@pytest.mark.slow
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

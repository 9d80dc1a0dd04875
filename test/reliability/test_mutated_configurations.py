# SPDX-License-Identifier: Apache-2.0
"""A configuration that was damaged is parameters or a ConfigurationError, never anything else."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from catalogue import NAMES
from mutations import mutated

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.parameters.load import catalogue_entry, configuration_file, machine_parameters

pytestmark = pytest.mark.slow

MUTATIONS = 1000


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_configuration_is_parameters_or_a_configuration_error(name: str, tmp_path: Path) -> None:
    chance = random.Random(f"{name} configuration")
    content = configuration_file(name).read_bytes()
    refused = 0
    file = tmp_path / f"{name}.yaml"
    for _ in range(MUTATIONS):
        file.write_bytes(mutated(content, chance))
        try:
            parameters = machine_parameters(name, file)
        except ConfigurationError as error:
            assert str(error).startswith(str(file))
            refused += 1
        else:
            catalogue_entry(name).build(parameters)
    assert refused > MUTATIONS // 2

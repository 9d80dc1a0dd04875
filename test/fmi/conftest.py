# SPDX-License-Identifier: Apache-2.0
"""Units of the machines, exported once for all tests of them."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest

from mech_twin.fmi.export import LINUX, Platform, export_fmu
from mech_twin.parameters.load import machine as built_machine


@pytest.fixture(scope="session")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the unit of a machine in a version of the standard, exported once for each choice of platforms."""
    folder = tmp_path_factory.mktemp("units")

    @cache
    def exported(name: str, version: int, platforms: tuple[Platform, ...] = (LINUX,)) -> Path:
        file = folder / f"{name}_{version}_{len(platforms)}.fmu"
        return export_fmu(built_machine(name), file, version, platforms).file

    return exported

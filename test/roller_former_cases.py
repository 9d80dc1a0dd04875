# SPDX-License-Identifier: Apache-2.0
"""The roller former's configurations, as the tests of several rooms use them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mech_twin.machines.roller_former.parameters import RollerFormer
from mech_twin.parameters.load import configuration_file, machine, machine_parameters
from mech_twin.roles import Machine


def file_for(carts: int) -> Path:
    return configuration_file(f"roller_former_{carts}")


def parameters_for(carts: int, overrides: Mapping[str, Any] | None = None) -> RollerFormer:
    parameters = machine_parameters("roller_former", file_for(carts), overrides)
    assert isinstance(parameters, RollerFormer)
    return parameters


def machine_for(carts: int, overrides: Mapping[str, Any] | None = None) -> Machine:
    return machine("roller_former", file_for(carts), overrides)

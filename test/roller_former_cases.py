# SPDX-License-Identifier: Apache-2.0
"""The roller former's configurations, as the tests of several rooms use them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

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


class FormerJoints(NamedTuple):
    """Positions, velocities or efforts of the joints by name."""

    drive: float
    crank: float
    twist: float
    carts: tuple[float, ...]
    rods: tuple[float, ...]


def joints_of(values: tuple[float, ...]) -> FormerJoints:
    """Return the values of a sample's joints by name."""
    drive, crank, twist, *carts_and_rods = values
    return FormerJoints(drive, crank, twist, tuple(carts_and_rods[::2]), tuple(carts_and_rods[1::2]))

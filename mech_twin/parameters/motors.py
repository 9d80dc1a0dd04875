# SPDX-License-Identifier: Apache-2.0
"""The motor table: a configuration may name a catalogue motor instead of giving its data."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from mech_twin.declarations.configuration_tree import ConfigurationError

NAME_KEY = "catalogue_name"


def motor_table(file: Path) -> dict[str, dict[str, float]]:
    """Return the motors of a table file by name."""
    try:
        table = _parsed(file.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{file}: motor table cannot be read") from error
    if not isinstance(table, dict) or not all(isinstance(row, dict) for row in table.values()):
        raise ConfigurationError(f"{file}: expected one group of values per motor")
    return table


@lru_cache(maxsize=4)
def _parsed(text: str) -> Any:
    """Return the parsed table, cached so that a study does not parse the same text for every configuration."""
    return yaml.safe_load(text)


def with_catalogue_motor(tree: Mapping[str, Any], file: Path, source: str) -> dict[str, Any]:
    """Return the tree with the data of the motor named in ``motor.catalogue_name`` added.

    Raises
    ------
    ConfigurationError
        If the table has no such motor, or the tree has a value that differs from the table's.
    """
    motor = tree.get("motor")
    if not isinstance(motor, dict) or not isinstance(motor.get(NAME_KEY), str):
        return dict(tree)
    name, table = motor[NAME_KEY], motor_table(file)
    if name not in table:
        raise ConfigurationError(
            f"{source}: key 'motor.{NAME_KEY}', value '{name}': expected one of {', '.join(table)} ({file.name})"
        )
    for key, value in table[name].items():
        if key in motor and motor[key] != value:
            raise ConfigurationError(
                f"{source}: key 'motor.{key}', value {motor[key]!r}: the named motor {name} has {value!r} in "
                f"{file.name}; leave out motor.{NAME_KEY} or the value"
            )
    return {**tree, "motor": {**motor, **table[name]}}

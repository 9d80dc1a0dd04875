# SPDX-License-Identifier: Apache-2.0
"""Which keys a fit may change: by default those that the configuration calls assumed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from math import isfinite
from pathlib import Path

import yaml

from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.parameters.load import configuration_file
from mech_twin.studies.identification.acting_keys import keys_of_motion
from mech_twin.studies.identification.keyed_configuration import numbers_of

ASSUMED = "assumed"
AUTO = "auto"  # in place of a key: every number that the motion of the machine depends on
_ORIGIN = re.compile(r"#.*?\b(assumed|published|derived|measured|catalogue|printed)\b")
# how a run is computed, started and ended, and not what the machine is
NOT_OF_THE_MACHINE = ("coupling", "supply", "integrator", "start", "stall", "run")
# the state a run begins in, which belongs to the run
START_STATES = ("linkage.initial_crank_deg", "initial_position_m", "initial_velocity_m_per_s", "package_radius_m")


def origins(path: Path) -> dict[str, str]:
    """Return the origin that the comment beside each key of a configuration names.

    A key without a word of its own has that of its group.
    """
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    return dict(_origins(root, lines, "", "")) if isinstance(root, yaml.MappingNode) else {}


def assumed_keys(name: str, parameters: Parameters, path: Path | None = None) -> tuple[str, ...]:
    """Return the keys that are numbers of the machine itself and that its configuration calls assumed.

    Parameters
    ----------
    name : str
        Machine of the catalogue.
    parameters : Parameters
        Its configuration; keys that it does not hold are left out.
    path : Path, optional
        File whose comments tell the origins; that of the installed configuration if absent.
    """
    known = origins(configuration_file(name)) if path is None else origins(path) or origins(configuration_file(name))
    return tuple(key for key in _numbers(parameters) if known.get(key) == ASSUMED)


def machine_keys(name: str, parameters: Parameters) -> tuple[str, ...]:
    """Return the numbers of the machine itself that its motion depends on and of which it accepts another value."""
    return keys_of_motion(name, parameters, tuple(_numbers(parameters)))


def _numbers(parameters: Parameters) -> Iterator[str]:
    for key, value in numbers_of(configuration_tree(parameters)):
        of_machine = key.split(".")[0] not in NOT_OF_THE_MACHINE and key not in START_STATES
        if of_machine and isfinite(value):
            yield key


def _origins(node: yaml.MappingNode, lines: list[str], prefix: str, inherited: str) -> Iterator[tuple[str, str]]:
    for key, value in node.value:
        name = str(key.value)
        found = _ORIGIN.search(lines[key.start_mark.line])
        origin = found.group(1) if found else inherited
        if isinstance(value, yaml.MappingNode):
            inner = "" if name in ("/**", "ros__parameters") else f"{prefix}{name}."
            yield from _origins(value, lines, inner, origin)
        elif isinstance(value, yaml.ScalarNode):
            yield prefix + name, origin

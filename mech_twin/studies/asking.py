# SPDX-License-Identifier: Apache-2.0
"""Access to the declared capabilities of a machine."""

from __future__ import annotations

from typing import Any

from mech_twin.capabilities.arguments import is_number
from mech_twin.capabilities.errors import StudyError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import catalogue_entry


def asked_of(machine: str, capability: str, lack: str) -> Any:
    """Return a capability of a machine.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    capability : str
        Field of `mech_twin.roles.Capabilities`.
    lack : str
        Error text for a machine without it.

    Raises
    ------
    StudyError
        If the machine lacks the capability; the message names those that have it.
    """
    entry = catalogue_entry(machine)
    found = getattr(entry.capabilities, capability)
    if found is None:
        others = [name for name, other in CATALOGUE.items() if getattr(other.capabilities, capability) is not None]
        raise StudyError(f"{entry.name}: {lack}; there is an answer for {', '.join(others)}")
    return found


def searches_by_runs(machine: str) -> bool:
    """Return whether a machine has no design question of its own, so that it is searched by simulated runs."""
    return catalogue_entry(machine).capabilities.design is None


def questions_of(machine: str) -> tuple[str, ...]:
    """Return the names of the functions of `mech_twin.studies` that this machine supports."""
    able = catalogue_entry(machine).capabilities
    answered = {
        "sweep": True,
        "size": able.sizing,
        "search": able.design,
        "designs": able.design,
        "synthesise": able.synthesis,
        "regimes": able.regimes,
    }
    return tuple(name for name, capability in answered.items() if capability)


def counted_within(name: str, value: Any, most: int) -> int:
    """Return a requested count as int.

    Raises
    ------
    StudyError
        If it is not a whole number from 1 to ``most``.
    """
    if not is_number(value) or not 1 <= value <= most or value != int(value):
        raise StudyError(f"{name}: expected a whole number from 1 to {most}, got {value}")
    return int(value)

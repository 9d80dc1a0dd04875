# SPDX-License-Identifier: Apache-2.0
"""A question put to a machine through its declared capabilities."""

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
        What is said of a machine without it.

    Raises
    ------
    StudyError
        If the machine has no answer; the line names those that have.
    """
    entry = catalogue_entry(machine)
    found = getattr(entry.capabilities, capability)
    if found is None:
        others = [name for name, other in CATALOGUE.items() if getattr(other.capabilities, capability) is not None]
        raise StudyError(f"{entry.name}: {lack}; there is an answer for {', '.join(others)}")
    return found


def searches_by_runs(machine: str) -> bool:
    """Return whether a machine has no design question of its own, so that its runs are asked."""
    return catalogue_entry(machine).capabilities.design is None


def questions_of(machine: str) -> tuple[str, ...]:
    """Return the questions of `mech_twin.studies` that this machine has an answer to."""
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
    """Return a count that is asked for.

    Raises
    ------
    StudyError
        If it is no whole number from 1 to ``most``.
    """
    if not is_number(value) or not 1 <= value <= most or value != int(value):
        raise StudyError(f"{name}: expected a whole number from 1 to {most}, got {value}")
    return int(value)

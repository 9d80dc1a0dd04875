# SPDX-License-Identifier: Apache-2.0
"""Compares every published number of the machines' sources with the computed one."""

from __future__ import annotations

from collections.abc import Iterable

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.published import CONTRADICTS, PublishedRow
from mech_twin.declarations.quantity import Parameters
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import catalogue_entry, machine_parameters


def machine_rows(machine: str, parameters: Parameters | None = None) -> tuple[PublishedRow, ...]:
    """Return the rows of one machine, in its own order: the problematic ones first.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    parameters : Parameters, optional
        Configuration of the machine; the installed one if absent.
    """
    entry = catalogue_entry(machine)
    rows = entry.capabilities.published
    if rows is None:
        raise StudyError(f"{entry.name}: no published values to compare with")
    return tuple(rows(parameters or machine_parameters(entry.name)))


def machines_with_published_values() -> tuple[str, ...]:
    """Return the machines of the catalogue that have published values."""
    return tuple(name for name, entry in CATALOGUE.items() if entry.capabilities.published is not None)


def all_rows() -> tuple[PublishedRow, ...]:
    """Return the rows of every machine, those of sources that contradict themselves first."""
    rows = [row for machine in machines_with_published_values() for row in machine_rows(machine)]
    return tuple(sorted(rows, key=lambda row: row.verdict != CONTRADICTS))


def all_hold(rows: Iterable[PublishedRow]) -> bool:
    """Return whether every row with a tolerance is within it."""
    return all(row.holds for row in rows)

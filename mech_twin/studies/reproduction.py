# SPDX-License-Identifier: Apache-2.0
"""Every published number of the machines' sources beside the computed one, worked out when asked."""

from __future__ import annotations

from collections.abc import Iterable

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.published import CONTRADICTS, PublishedRow
from mech_twin.declarations.quantity import Parameters
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import catalogue_entry, machine_parameters


def machine_rows(machine: str, parameters: Parameters | None = None) -> tuple[PublishedRow, ...]:
    """Return the rows of one machine, the awkward ones first.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    parameters : Parameters, optional
        What to compute from; the installed configuration if absent.
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
    """Return the rows of every machine: first where a source contradicts itself, then the rest, machine by machine."""
    rows = [row for machine in machines_with_published_values() for row in machine_rows(machine)]
    return tuple(sorted(rows, key=lambda row: row.verdict != CONTRADICTS))


def all_hold(rows: Iterable[PublishedRow]) -> bool:
    """Return whether every gated row keeps its tolerance."""
    return all(row.holds for row in rows)

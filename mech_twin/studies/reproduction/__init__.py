"""Every published number of the machines' sources beside the computed one, worked out when asked."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module

from mech_twin.parameters.load import catalogue_entry, machine_parameters
from mech_twin.quantity import Parameters
from mech_twin.studies.reproduction.row import CONTRADICTS, Row


def machine_rows(machine: str, parameters: Parameters | None = None) -> tuple[Row, ...]:
    """Return the rows of one machine, the awkward ones first.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    parameters : Parameters, optional
        What to compute from; the installed configuration if absent.
    """
    name = catalogue_entry(machine).name
    rows = import_module(f"mech_twin.studies.reproduction.{name}").rows
    return tuple(rows(parameters or machine_parameters(name)))


# the order in which the awkward numbers of the sources are asked about
MACHINES = ("roller_former", "vibration_crank", "compaction_press", "impact_mass", "mb10_breaker", "winding_drum")


def all_rows() -> tuple[Row, ...]:
    """Return the rows of every machine: first where a source contradicts itself, then the rest, machine by machine."""
    rows = [row for machine in MACHINES for row in machine_rows(machine)]
    return tuple(sorted(rows, key=lambda row: row.verdict != CONTRADICTS))


def all_hold(rows: Iterable[Row]) -> bool:
    """Return whether every gated row keeps its tolerance."""
    return all(row.holds for row in rows)

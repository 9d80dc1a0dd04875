# SPDX-License-Identifier: Apache-2.0
"""Reproduces the figures of the machines' sources from computed results."""

from __future__ import annotations

from pathlib import Path

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.plots import Picture, house_style, written
from mech_twin.declarations.quantity import Parameters
from mech_twin.parameters.load import catalogue_entry, machine_parameters


def machine_pictures(machine: str, parameters: Parameters | None = None) -> tuple[Picture, ...]:
    """Return the figures of one machine for these parameters or the installed configuration."""
    entry = catalogue_entry(machine)
    pictures = entry.capabilities.pictures
    if pictures is None:
        raise StudyError(f"{entry.name}: no published figures to draw")
    with house_style():
        return tuple(pictures(parameters or machine_parameters(entry.name)))


def machine_figures(machine: str, directory: Path, parameters: Parameters | None = None) -> list[Path]:
    """Write the figures of one machine; return the files, an SVG and a PNG each."""
    directory.mkdir(parents=True, exist_ok=True)
    return [file for picture in machine_pictures(machine, parameters) for file in written(picture, directory)]

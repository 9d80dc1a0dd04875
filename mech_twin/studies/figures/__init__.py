"""The figures of the machines' sources, drawn anew from what the machines give."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from mech_twin.parameters.load import catalogue_entry, machine_parameters
from mech_twin.quantity import Parameters
from mech_twin.studies.figures.canvas import Picture, house_style, written


def machine_pictures(machine: str, parameters: Parameters | None = None) -> tuple[Picture, ...]:
    """Return the pictures of one machine, drawn from these parameters or the installed configuration."""
    name = catalogue_entry(machine).name
    pictures = import_module(f"mech_twin.studies.figures.{name}").pictures
    with house_style():
        return tuple(pictures(parameters or machine_parameters(name)))


def machine_figures(machine: str, directory: Path, parameters: Parameters | None = None) -> list[Path]:
    """Write the pictures of one machine; return the files, an SVG and a PNG each."""
    directory.mkdir(parents=True, exist_ok=True)
    return [file for picture in machine_pictures(machine, parameters) for file in written(picture, directory)]

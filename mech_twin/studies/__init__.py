"""Questions asked of a machine, under the names they have on the command line.

Each function imports what it needs when it is called, so that naming one costs nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mech_twin.quantity import Parameters
    from mech_twin.studies.reproduction.row import Row


def reproduce(machine: str | None = None, parameters: Parameters | None = None) -> tuple[Row, ...]:
    """Return every published number beside the computed one.

    Parameters
    ----------
    machine : str, optional
        Machine of the catalogue; all of them if absent, rows that contradict themselves first.
    parameters : Parameters, optional
        What to compute one machine's rows from; its installed configuration if absent.
    """
    from mech_twin.studies.reproduction import all_rows, machine_rows

    return all_rows() if machine is None else machine_rows(machine, parameters)


def draw_figures(machine: str, directory: Path, parameters: Parameters | None = None) -> list[Path]:
    """Return the files of a machine's published figures, drawn anew: an SVG and a PNG each.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    directory : Path
        Where to write; made if absent.
    parameters : Parameters, optional
        What to draw from; the installed configuration if absent.
    """
    from mech_twin.studies.figures import machine_figures

    return machine_figures(machine, directory, parameters)

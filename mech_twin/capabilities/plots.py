# SPDX-License-Identifier: Apache-2.0
"""Style of the figures: size, fonts, colours for colour-blind readers; and output as files.

Machines that draw are loaded without the libraries of pictures: these are imported where something is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mech_twin.files.output_file import written_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL import Image

# Okabe and Ito's palette, without its yellow
BLUE, RED, GREEN = "#0072b2", "#d55e00", "#009e73"
ORANGE, PURPLE, SKY, GREY = "#e69f00", "#cc79a7", "#56b4e9", "#7f7f7f"
COLOURS = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY)
INK = "#2b2b2b"
DPI = 200
OWN = "Not a figure of the source."
STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.5,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "svg.hashsalt": "mech_twin",
    "svg.fonttype": "none",
}


def house_style() -> AbstractContextManager[None]:
    """Return the context manager with the style of all figures."""
    from matplotlib import rc_context

    return rc_context(STYLE)


class Picture(NamedTuple):
    """A figure, the name of its files, and its caption."""

    name: str
    caption: str
    figure: Figure


def sheet(
    rows: int = 1, columns: int = 1, width: float = 7.2, height: float = 3.8, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure and its axes, row by row; sizes in inches."""
    figure = blank(width, height)
    made = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, [axes for row in made for axes in row]


def blank(width: float, height: float) -> Figure:
    """Return a figure without axes; sizes in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def turn_axis(axes: Axes, label: str = "crank angle, degrees") -> None:
    """Set the x axis to one turn in degrees."""
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks(range(0, 361, 60))
    axes.set_xlabel(label)


def published(axes: Axes, x: Sequence[float], y: Sequence[float], label: str = "published") -> None:
    """Plot published points as rings."""
    ring: Any = {"color": "none", "markeredgecolor": INK, "markersize": 6.5, "markeredgewidth": 1.4}
    axes.plot(x, y, "o", label=label, zorder=5, clip_on=False, **ring)


def _raster(figure: Figure) -> Image.Image:
    """Return the figure as an image of 64 colours, a third of the size of a full-colour one."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    figure.set_dpi(DPI)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    full = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    return full.quantize(64, dither=Image.Dither.NONE)


def written(picture: Picture, directory: Path) -> tuple[Path, Path]:
    """Write a figure as SVG and PNG; return both files."""
    vector, raster = directory / f"{picture.name}.svg", directory / f"{picture.name}.png"
    with house_style():
        with written_file(vector, force=True) as unfinished:
            picture.figure.savefig(unfinished, metadata={"Date": None})
        with written_file(raster, force=True) as unfinished:
            _raster(picture.figure).save(unfinished, optimize=True, dpi=(DPI, DPI))
    return vector, raster

# SPDX-License-Identifier: Apache-2.0
"""Draw the figures of docs/gallery and write docs/gallery.md: python .ci/gallery.py."""

from __future__ import annotations

from pathlib import Path

from moving_picture import COLOURS_SMALL, small_pictures, write

from mech_twin.capabilities.plots import written
from mech_twin.parameters.load import catalogue_entry
from mech_twin.parameters.load import machine as built_machine
from mech_twin.studies.declared_studies import machine_pictures, machines_with_published_values

DOCS = Path(__file__).parents[1] / "docs"
CONFIG = DOCS.parent / "config"
PAGES = ("spring_hammer", "electropneumatic_hammer", "rammer", "jaw_crusher", "quick_return", "four_bar")
PAGES += ("chebyshev", "roller_former_4", "sommerfeld")
HEAD = """# Gallery

After this page you know how each machine moves and which figures of its source are computed.

## The machines moving

One cycle each, slowed. The first six are the machines of the sources, the others [pages](machines/pages.md).
"""
FIGURES = """The other figures are those of the sources, drawn from the computed results, and a few more.
Rings are published numbers. `mech-twin reproduce --figures DIR` draws them as SVG and PNG.
`.ci/gallery.py` writes this page.
"""


def moving(folder: Path) -> str:
    """Draw the machines and pages moving and return the lines that show them."""
    chosen = [*machines_with_published_values(), *(f"{CONFIG}/pages/{name}.yaml" for name in PAGES)]
    cells = []
    for name in chosen:
        file = f"moving_{Path(name).stem}.gif"
        write(small_pictures(built_machine(name)), folder / file, COLOURS_SMALL)
        title = Path(name).stem.replace("_", " ")
        cells.append(f"![{title}](gallery/{file})<br>{title}")
    rows = [f"| {' | '.join(cells[i : i + 3])} |" for i in range(0, len(cells), 3)]
    return "\n".join(["| | | |", "|---|---|---|", *rows]) + "\n"


def page(folder: Path) -> str:
    """Draw every picture into the folder as PNG and return the page that shows them."""
    parts = [HEAD, moving(folder), FIGURES]
    for name in machines_with_published_values():
        parts.append(f"## {catalogue_entry(name).title[0].upper() + catalogue_entry(name).title[1:]}\n")
        for picture in machine_pictures(name):
            vector, raster = written(picture, folder)
            vector.unlink()
            title = picture.name.replace("_", " ")
            parts.append(f"![{title}](gallery/{raster.name})\n\n{picture.caption}\n")
    return "\n".join(parts)


if __name__ == "__main__":
    (DOCS / "gallery.md").write_text(page(DOCS / "gallery"), encoding="utf-8")

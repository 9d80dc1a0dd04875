# SPDX-License-Identifier: Apache-2.0
"""Draw the figures of docs/gallery and write docs/gallery.md: python .ci/gallery.py."""

from __future__ import annotations

from pathlib import Path

from mech_twin.capabilities.plots import written
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.plots import machine_pictures
from mech_twin.studies.reproduction import machines_with_published_values

DOCS = Path(__file__).parents[1] / "docs"
HEAD = """# Gallery

The figures of the sources, drawn from the computed results, and a few more. Rings are published numbers.
`mech-twin reproduce --figures DIR` draws them as SVG and PNG; `.ci/gallery.py` writes this page.
"""


def page(folder: Path) -> str:
    """Draw every picture into the folder as PNG and return the page that shows them."""
    parts = [HEAD]
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

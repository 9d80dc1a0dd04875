# SPDX-License-Identifier: Apache-2.0
"""A report as one self-contained HTML file with embedded pictures and a print layout."""

import base64
import platform
from collections.abc import Iterable, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mech_twin import __version__

STYLE = """
body { font-family: system-ui, sans-serif; margin: 2rem auto; max-width: 60rem; color: #2b2b2b; line-height: 1.45 }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.92rem }
th, td { border-bottom: 1px solid #ddd; padding: 0.25rem 0.7rem; text-align: right; overflow-wrap: break-word }
th { overflow-wrap: anywhere; min-width: 4.5em }
th:first-child, td:first-child, td.words { text-align: left }
td.verdict { color: #a04500 } td.identified { color: #006b4c; font-weight: 600 }
svg, img { max-width: 100%; height: auto }
.row { display: flex; align-items: flex-start } .row svg { min-width: 0 }
@page { margin: 12mm }
@media print {
  html { font-size: 9pt }
  body { margin: 0; max-width: none; print-color-adjust: exact }
  h1, h2, h3, p, table { margin: 0.5rem 0 } th, td { padding: 0.1rem 0.5rem }
  tr, figure, svg, img { break-inside: avoid } h2, h3 { break-after: avoid } thead { display: table-header-group }
}
"""
WORDS = ("combination", "holds for", "would also identify")  # heads of columns that hold words
SHOWN_IN_PAGES = {".png": "image/png", ".svg": "image/svg+xml"}
PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>{style}</style></head>
<body><h1>{title}</h1>
{body}
</body></html>
"""


def page(title: str, parts: Iterable[str]) -> str:
    """Return an HTML page made of HTML parts."""
    return PAGE.format(title=escape(title), style=STYLE, body="\n".join(parts))


def versions() -> str:
    """Return the versions of mech_twin, Python and NumPy for a report."""
    return f"mech_twin {__version__}, Python {platform.python_version()}, NumPy {version('numpy')}"


def section(title: str, heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a heading and a table, numbers to six digits; an empty string if there is no row."""
    if not rows:
        return ""
    head = "".join(f"<th>{escape(each)}</th>" for each in heads)
    body = "".join("<tr>" + "".join(map(_cell, heads, row)) + "</tr>" for row in rows)
    return f"<h2>{escape(title)}</h2><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _cell(head: str, value: Any) -> str:
    """Return a cell: words of a column in `WORDS` from the left, a verdict in its colour."""
    kind = f"verdict {value}" if head == "verdict" else "words" if head in WORDS else ""
    mark = f' class="{escape(kind)}"' if kind else ""
    return f"<td{mark}>{escape(shown(value))}</td>"


def shown(value: Any) -> str:
    """Return a value as text for a report: floats to six digits, empty for None."""
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


def picture(title: str, file: Path) -> str:
    """Return a PNG or SVG file as a figure within the page; the name of a file of another kind."""
    kind = SHOWN_IN_PAGES.get(file.suffix)
    if kind is None:
        return f"<p>picture: {escape(file.name)}</p>"
    data = base64.b64encode(file.read_bytes()).decode()
    return f'<figure><img alt="{escape(title)}" src="data:{kind};base64,{data}"></figure>'

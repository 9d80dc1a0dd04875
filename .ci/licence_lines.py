# SPDX-License-Identifier: Apache-2.0
"""Puts the licence line at the head of every source file that lacks it: ``python .ci/licence_lines.py``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

PLACE = Path(__file__).resolve().parents[1]
LICENCE = "Apache-2.0"
MARKS = {".py": "#", ".pyi": "#", ".sh": "#", ".mjs": "//", ".c": "//", ".h": "//", "": "#"}
ROOMS = ("mech_twin", "test", "benchmarks", "launch", ".ci")
ALONE = ("setup.py", "Makefile")
NOT_OURS = {"node_modules", "__pycache__"}


def sources() -> Iterator[Path]:
    """Yield the source files of the project."""
    yield from (PLACE / name for name in ALONE)
    for room in ROOMS:
        for path in sorted((PLACE / room).rglob("*")):
            if path.is_file() and path.suffix in MARKS and not NOT_OURS & set(path.parts):
                yield path


def line_of(path: Path) -> str:
    """Return the licence line of a file, in the comments of its language."""
    return f"{MARKS[path.suffix]} SPDX-License-Identifier: {LICENCE}"


def has_line(path: Path) -> bool:
    """Return whether a file begins with its licence line; a line for the shell may stand before it."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return line_of(path) in lines[: 2 if lines and lines[0].startswith("#!") else 1]


def add_line(path: Path) -> None:
    """Put the licence line at the head of a file."""
    head, *rest = path.read_text(encoding="utf-8").splitlines(keepends=True) or [""]
    first = [head] if head.startswith("#!") else []
    path.write_text("".join([*first, line_of(path) + "\n", *([] if first else [head]), *rest]), encoding="utf-8")


if __name__ == "__main__":
    for source in sources():
        if not has_line(source):
            add_line(source)

# SPDX-License-Identifier: Apache-2.0
"""Looks for what no file of the project may hold; one line for each fault, exit code 1 if there is one.

Usage: plain_files.py FILE...
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

LARGEST_BYTES = 2_000_000
MERGE = re.compile(r"^(<{7} |={7}$|>{7} )", re.MULTILINE)
INDEX = re.compile(r"(index-url|find-links|\"resolved\")\W+(https?|file):", re.IGNORECASE)
WRITTEN_BY_OTHERS = {".patch", ".diff", ".svg", ".rviz"}


def faults(name: str, content: bytes) -> Iterator[str]:
    """Yield what is wrong with a file."""
    if len(content) > LARGEST_BYTES:
        yield f"{len(content)} bytes; the most is {LARGEST_BYTES}"
    if not content:
        return
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        yield "is not UTF-8"
        return
    if "\r" in text:
        yield "has carriage returns"
    if not text.endswith("\n") or text.endswith("\n\n"):
        yield "does not end in exactly one new line"
    if Path(name).suffix not in WRITTEN_BY_OTHERS and re.search(r"[ \t]+$", text, re.MULTILINE):
        yield "has spaces at the end of a line"
    if MERGE.search(text):
        yield "holds the marks of a merge"
    if INDEX.search(text):
        yield "holds the address of a package index"


def main(names: list[str]) -> int:
    """Return the exit code."""
    found = [f"{name}: {fault}" for name in names for fault in faults(name, Path(name).read_bytes())]
    sys.stdout.writelines(f"{line}\n" for line in found)
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))

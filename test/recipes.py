# SPDX-License-Identifier: Apache-2.0
"""Recipes of the documentation, applied to a copy of the project block by block.

A block is marked after its language: ``file=PATH`` is a new file, ``line=PATH`` a line at the end of the catalogue, and
``in=PATH`` a change of lines that stand there once, written as a difference; a context line may end in ``...``.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```\w+ (file|line|in)=(\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PARTS = ("mech_twin", "config", "test", "docs")
FILES = ("pyproject.toml", "mkdocs.yml", "Makefile", "README.md", "CONTRIBUTING.md", "SECURITY.md")


def checkout_by(page: str, folder: Path) -> Path:
    """Make a copy of the project with the blocks of a page applied to it, and nothing else."""
    for part in PARTS:
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
    shutil.copytree(ROOT / ".ci", folder / ".ci")
    for name in FILES:
        shutil.copy(ROOT / name, folder)
    blocks = BLOCK.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))
    assert blocks
    for kind, name, text in blocks:
        path = folder / name
        if kind == "file":
            assert not path.exists(), f"{name} is there already"
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        elif kind == "line":
            add_to_catalogue(path, text)
        else:
            change(path, text)
    return folder


def add_to_catalogue(path: Path, text: str) -> None:
    catalogue = path.read_text(encoding="utf-8")
    assert catalogue.count("\n    )\n}") == 1
    path.write_text(catalogue.replace("\n    )\n}", f"\n{text}    )\n}}"), encoding="utf-8")


def change(path: Path, difference: str) -> None:
    """Apply one hunk; its context and its removed lines must stand in the file once."""
    lines, hunk = (
        path.read_text(encoding="utf-8").splitlines(),
        [(line[0], line[1:]) for line in difference.splitlines()],
    )
    before = [text for sign, text in hunk if sign != "+"]

    def stands(place: int) -> bool:
        return all(
            line.startswith(text[: -len("...")]) if text.endswith(" ...") else line == text
            for line, text in zip(lines[place : place + len(before)], before, strict=True)
        )

    places = [place for place in range(len(lines) - len(before) + 1) if stands(place)]
    assert len(places) == 1, f"{path.name}: {before} stands there {len(places)} times"
    kept, after = iter(lines[places[0] :]), []
    for sign, text in hunk:
        line = text if sign == "+" else next(kept)
        if sign != "-":
            after.append(line)
    lines[places[0] : places[0] + len(before)] = after
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def ran(checkout: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run this Python in the copy."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    return subprocess.run(
        [sys.executable, *words],
        cwd=checkout,
        env=environment,
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )

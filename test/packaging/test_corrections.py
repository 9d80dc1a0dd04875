# SPDX-License-Identifier: Apache-2.0
"""Every test that the page of corrections names exists where it says, and every row has a test and a page."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "proof" / "corrections.md"
ROWS = [
    cells
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and (cells := line.strip("|").split(" | "))[0].strip() != "what"
]


def named_tests(cell: str) -> list[tuple[str, str]]:
    """Return file and name of each test of a cell."""
    found, file = [], ""
    for word in re.findall(r"`([^`]+)`", cell):
        if word.endswith(".py"):
            file = word
        else:
            found.append((file, word))
    return found


def functions_in(file: str) -> set[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_every_row_has_its_tests_and_its_page() -> None:
    assert len(ROWS) > 30
    for cells in ROWS:
        assert len(cells) == 3, cells
        assert named_tests(cells[1]), cells[0]
        pages = re.findall(r"\]\(([^)#]+)", cells[2])
        assert pages, cells[0]
        assert [page for page in pages if not (PAGE.parent / page).exists()] == []


def test_every_test_that_is_named_exists() -> None:
    named = {test for cells in ROWS for test in named_tests(cells[1])}
    assert {(file, name) for file, name in named if name not in functions_in(file)} == set()

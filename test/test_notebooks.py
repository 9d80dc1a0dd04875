# SPDX-License-Identifier: Apache-2.0
"""Notebooks of the documentation show what they compute."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from notebooks import FOLDER, code_cells, shown, stored

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.ipynb")), ids=lambda file: file.stem)
def test_every_cell_shows_what_the_notebook_says(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(file.read_text(encoding="utf-8"))
    namespace: dict[str, Any] = {}
    assert any(stored(cell) for cell in code_cells(notebook))
    for cell in code_cells(notebook):
        assert shown("".join(cell["source"]), namespace) == stored(cell)
    assert list(tmp_path.iterdir()) == []

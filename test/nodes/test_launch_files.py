# SPDX-License-Identifier: Apache-2.0
"""What a launch file takes from the package is there, also where the launch library is not."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest

FILES = sorted((Path(__file__).resolve().parents[2] / "launch").glob("*.launch.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_every_name_of_the_package_that_a_launch_file_uses_is_there(file: Path) -> None:
    tree, taken = ast.parse(file.read_text(encoding="utf-8")), dict[str, Any]()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("mech_twin"):
            for alias in node.names:
                taken[alias.name] = getattr(__import__(str(node.module), fromlist=[alias.name]), alias.name)
    used = [n for n in ast.walk(tree) if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name)]
    lacking = [n.attr for n in used if n.value.id in taken and not hasattr(taken[n.value.id], n.attr)]  # type: ignore[attr-defined]
    assert taken
    assert lacking == []

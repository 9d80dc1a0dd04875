# SPDX-License-Identifier: Apache-2.0
"""A name stands for one thing: no two classes of the package share one, and no file is called after nothing."""

from __future__ import annotations

import ast
import importlib
import pkgutil
from collections import defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "mech_twin"
SCRIPT_ROOMS = ("benchmarks", ".ci", "launch")
SAYS_NOTHING = {"utils", "util", "helpers", "helper", "common", "manager", "misc", "data", "base", "core"}
LONGEST_FILE = 500  # lines; a file of one purpose has about 300


@cache
def modules() -> list[tuple[Path, ast.Module]]:
    return [(path, ast.parse(path.read_text(encoding="utf-8"))) for path in sorted(PACKAGE.rglob("*.py"))]


def test_no_two_classes_share_a_name() -> None:
    where: dict[str, list[str]] = defaultdict(list)
    for path, tree in modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                where[node.name].append(str(path.relative_to(PACKAGE)))
    assert len(where) > 100
    assert {name: places for name, places in where.items() if len(places) > 1} == {}


def test_no_file_or_folder_has_a_name_that_says_nothing() -> None:
    named = {path.stem for path, _ in modules()} | {path.name for path in PACKAGE.rglob("*") if path.is_dir()}
    assert named & SAYS_NOTHING == set()


def test_no_file_is_too_long_to_read() -> None:
    lengths = {path.relative_to(PACKAGE): len(path.read_text(encoding="utf-8").splitlines()) for path, _ in modules()}
    assert {path: lines for path, lines in lengths.items() if lines > LONGEST_FILE} == {}


def test_no_script_or_style_of_a_page_is_too_long_to_read() -> None:
    ours = [path for kind in ("js", "css", "html") for path in PACKAGE.rglob(f"page/*.{kind}") if path.stem != "uplot"]
    lengths = {path.name: len(path.read_text(encoding="utf-8").splitlines()) for path in ours}
    assert len(lengths) > 10
    assert {name: lines for name, lines in lengths.items() if lines > LONGEST_FILE} == {}


def test_what_scripts_import_from_the_package_is_there() -> None:
    missing, seen = [], 0
    for path in (path for room in SCRIPT_ROOMS for path in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or (node.module or "").partition(".")[0] != "mech_twin":
                continue
            room, seen = importlib.import_module(str(node.module)), seen + 1
            modules_of_it = {each.name for each in pkgutil.iter_modules(getattr(room, "__path__", ()))}
            left = {each.name for each in node.names if not hasattr(room, each.name)} - modules_of_it
            missing += [f"{path.relative_to(ROOT)}: {node.module}.{name}" for name in left]
    assert seen > 100
    assert missing == []

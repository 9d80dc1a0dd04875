# SPDX-License-Identifier: Apache-2.0
"""Every source that code, configuration and pages name stands in the bibliography, and nothing stands there twice."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "references.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^### (\S+)$", PAGE, re.MULTILINE)
# the names that tables of published numbers give their source by, and older spellings of keys
CITED_AS = set(re.findall(r'"([^"]+)"', PAGE)) | set(re.findall(r"`([a-z_]+)`", PAGE))
KEY = re.compile(r"\b[A-Z][a-z]+[A-Z][A-Za-z]+(?:1[89]|20)\d\d\b")
SPELLED_KEY = re.compile(r"\(key `(\w+)`\)")
CONSTANTS = {"PAPER"}


def files() -> list[Path]:
    rooms = ("mech_twin", "docs", "config", "benchmarks", "test/literature")
    kinds = ("*.py", "*.md", "*.yaml")
    return [file for room in rooms for kind in kinds for file in sorted((ROOT / room).rglob(kind))]


@cache
def named_sources() -> dict[str, set[str]]:
    """Return each key or name of a source, and the files that use it."""
    found: dict[str, set[str]] = {}
    for file in files():
        if file == ROOT / "docs" / "references.md":
            continue
        text = file.read_text(encoding="utf-8")
        names = {*KEY.findall(text), *SPELLED_KEY.findall(text)}
        if file.suffix == ".py":
            names |= constants(ast.parse(text))
        for name in names:
            found.setdefault(name, set()).add(str(file.relative_to(ROOT)))
    return found


def constants(tree: ast.Module) -> set[str]:
    """Return the texts of module constants that name a source."""
    found = set()
    for node in tree.body:
        if isinstance(node, ast.Assign) and CONSTANTS & {getattr(target, "id", "") for target in node.targets}:
            value = ast.literal_eval(node.value)
            found |= {value} if isinstance(value, str) else set()  # a colour of the view has the name too
    return found


def test_the_search_finds_what_is_known_to_be_named() -> None:
    assert {"LoveikinRoller2018", "Alisher, MB-10"} <= set(named_sources())


def test_every_source_that_is_named_has_an_entry() -> None:
    missing = {name: files for name, files in named_sources().items() if name not in ENTRIES and name not in CITED_AS}
    assert missing == {}, "not in docs/references.md"


def test_every_entry_has_a_key_of_its_own_and_a_text() -> None:
    assert len(set(ENTRIES)) == len(ENTRIES)
    for body in re.split(r"^### \S+$", PAGE, flags=re.MULTILINE)[1:]:
        assert len(body.split("\n## ")[0].split()) >= 8


@pytest.mark.parametrize(
    "machine",
    ["compaction press", "vibration crank", "impact mass", "roller former", "MB-10 breaker", "winding drum"],
)
def test_every_machine_has_its_paper(machine: str) -> None:
    assert re.search(rf"Machine: .*{machine}", PAGE)


@pytest.mark.parametrize("doi", re.findall(r"DOI (\S+?)\.?(?:\s|$)", PAGE))
def test_a_doi_has_the_form_of_one(doi: str) -> None:
    assert re.fullmatch(r"10\.\d{4,9}/[-._;()/:A-Za-z0-9]+", doi)

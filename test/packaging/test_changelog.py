# SPDX-License-Identifier: Apache-2.0
"""Fragments of the changelog: a kind that the release knows, and one short line a change."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOWNCRIER = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["towncrier"]
FRAGMENTS = sorted((ROOT / TOWNCRIER["directory"]).glob("*.md"))
KINDS = {kind["directory"] for kind in TOWNCRIER["type"]}


def faults(name: str, text: str) -> list[str]:
    kind = name.split(".")[-2] if name.count(".") > 1 else ""
    wrong = [] if kind in KINDS else [f"{name}: call it SHORT_NAME.KIND.md, with KIND of {sorted(KINDS)}"]
    lines = [line for line in text.splitlines() if line.strip()]
    return wrong + [f"{name}: {len(line.split())} words in {line!r}" for line in lines if len(line.split()) > 25]


def test_each_change_is_one_line_of_at_most_25_words() -> None:
    assert [fault for file in FRAGMENTS for fault in faults(file.name, file.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize(
    ("name", "text"), [("short.mended.md", "One."), ("short.md", "One."), ("a.fixed.md", "so " * 26)]
)
def test_a_long_line_or_an_unknown_kind_is_found(name: str, text: str) -> None:
    assert len(faults(name, text)) == 1


def test_the_release_finds_its_place_in_the_changelog() -> None:
    text = (ROOT / TOWNCRIER["filename"]).read_text(encoding="utf-8")
    assert text.count(TOWNCRIER["start_string"]) == 1

# SPDX-License-Identifier: Apache-2.0
"""The tables of the pages on faults and on draws are those of the scripts they name, each row with date and machine."""

from __future__ import annotations

import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "benchmarks" / "reliability"
sys.path.insert(0, str(SCRIPTS))
measured = import_module("measured")

PAGE = measured.PAGE.read_text(encoding="utf-8")
WRITERS = sorted(
    path.stem
    for path in SCRIPTS.glob("*.py")
    if path.stem != "measured" and re.search(r"(write_table|add_rows)\(", path.read_text(encoding="utf-8"))
)
DATE = re.compile(r"\d{4}-\d\d-\d\d")
MADE = re.compile(r"Made on .*\d+ cores of .+, Python \d")


def test_every_script_of_the_room_writes_into_a_page() -> None:
    assert sorted(path.stem for path in SCRIPTS.glob("*.py") if path.stem != "measured") == WRITERS


@pytest.mark.parametrize("script", WRITERS)
def test_a_script_that_writes_is_named_and_has_its_place(script: str) -> None:
    begin, end = measured.marks(script)
    page = measured.page_of(script).read_text(encoding="utf-8")
    assert page.count(begin) == page.count(end) == 1
    assert f"python benchmarks/reliability/{script}.py" in page
    table = page.partition(begin)[2].partition(end)[0]
    rows = [line for line in table.splitlines() if line.startswith("|")][2:]
    head = table.partition("|")[0]
    assert MADE.search(head) and all(DATE.search(row) or DATE.search(head) for row in rows)


def test_tests_of_the_table_exist() -> None:
    begin, end = measured.marks("claims")
    for file in re.findall(r"test/[\w/]+\.py", PAGE.partition(begin)[2].partition(end)[0]):
        assert (measured.PAGE.parents[2] / file).is_file()


def test_rows_take_the_place_of_those_made_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "page.md"
    page.write_text("\n".join(["above", *measured.marks("flood"), "below"]) + "\n", encoding="utf-8")
    monkeypatch.setattr(measured, "PAGE", page)
    for rows in ([["a", 1], ["b", 2]], [["a", 3]]):
        measured.add_rows("flood", ("what", "count"), rows)
    written = page.read_text(encoding="utf-8").splitlines()
    assert written[0] == "above"
    assert written[-1] == "below"
    made = f"Made on {measured.this_machine()}, where a row names no other."
    assert written[2:-2] == [made, "", "| what | count |", "|---|---|", "| b | 2 |", "| a | 3 |"]
    with pytest.raises(ValueError, match="has no marks"):
        measured.add_rows("another", ("what",), [])


def test_only_a_row_of_another_machine_names_its_own() -> None:
    rows = [f"| a | 2026-01-01, {measured.this_machine()} |", "| b | 2026-01-02, 8 cores of X, Python 3.13.1 |"]
    first = measured.machine_once("", rows)
    assert first[2:] == ["| a | 2026-01-01 |", rows[1]]
    other = measured.machine_once("Made on 8 cores of X, Python 3.13.1, where a row names no other.", rows)
    assert other[2:] == [rows[0], "| b | 2026-01-02 |"]

# SPDX-License-Identifier: Apache-2.0
"""docs/proof/performance.md is written by the benchmarks: each group has its program and its place on the page."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


def loaded(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", BENCHMARKS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


GROUPS = tuple(loaded("performance").GROUPS)
COMPARISON = loaded("comparison")


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_has_its_program_and_its_place_on_the_page(group: str) -> None:
    page = COMPARISON.PAGE.read_text(encoding="utf-8")
    assert page.count(f"<!-- {group}: begin -->") == 1
    assert page.index(f"<!-- {group}: begin -->") < page.index(f"<!-- {group}: end -->")
    assert f'measure("{group}"' in (BENCHMARKS / f"{group}.py").read_text(encoding="utf-8")


def test_every_program_that_measures_a_group_is_run() -> None:
    programs = {file.stem for file in BENCHMARKS.glob("*.py") if "\n    measure(" in file.read_text(encoding="utf-8")}
    assert programs == set(GROUPS)


def test_a_table_replaces_what_stands_between_its_marks_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("above\n<!-- a: begin -->\nold\n<!-- a: end -->\nbelow\n", encoding="utf-8")
    COMPARISON.put_between(page, "a", COMPARISON.Table("how", ("x", "y"), [(1, 2)]).lines())
    kept = "above\n<!-- a: begin -->\nhow\n\n| x | y |\n| --- | --- |\n| 1 | 2 |\n<!-- a: end -->\nbelow\n"
    assert page.read_text(encoding="utf-8") == kept
    with pytest.raises(ValueError, match="no marks"):
        COMPARISON.put_between(page, "b", [])


def test_a_ratio_is_taken_within_each_round() -> None:
    found = COMPARISON.ratio({"slow": [2.0, 9.0, 8.0], "quick": [1.0, 3.0, 2.0]}, "slow", "quick")
    assert found == (3.0, 2.0, 4.0)
    assert str(found) == "3 (2 - 4)"

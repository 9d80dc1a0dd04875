# SPDX-License-Identifier: Apache-2.0
"""What the shell offers for a command line that is being written."""

from __future__ import annotations

import math
import re

import pytest
import typer

from mech_twin.cli.main import app
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.errors import key_units
from mech_twin.studies.declared_studies import questions_of


def offered(line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> dict[str, str]:
    """Return what is offered for the last word of a line, each with its explanation, as zsh is told it."""
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", line)
    monkeypatch.setenv("_MECH_TWIN_COMPLETE", "complete_zsh")
    with pytest.raises(SystemExit):
        typer.main.get_command(app)(prog_name="mech-twin")
    rows = re.findall(r'"((?:[^"\\]|\\.)*)":"((?:[^"\\]|\\.)*)"', capsys.readouterr().out)
    return {name.replace("\\", ""): meaning.replace("\\", "").replace("''", "'") for name, meaning in rows}


def test_machines_are_offered_with_their_titles(monkeypatch, capsys) -> None:
    found = offered("mech-twin simulate ", monkeypatch, capsys)
    assert found == {name: entry.title for name, entry in CATALOGUE.items()}


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_key_of_the_machine_is_offered_with_its_unit(name, monkeypatch, capsys) -> None:
    found = offered(f"mech-twin simulate {name} --duration 3 --set ", monkeypatch, capsys)
    units = key_units(CATALOGUE[name].parameters)
    assert set(found) | {f"{key}=" for key, unit in units.items() if not unit} == {f"{key}=" for key in units}
    assert all(found[f"{key}="] == unit for key, unit in units.items() if unit)


@pytest.mark.parametrize("name", [name for name, entry in CATALOGUE.items() if entry.capabilities.sizing])
def test_limits_of_the_question_are_offered(name, monkeypatch, capsys) -> None:
    sizing = CATALOGUE[name].capabilities.sizing
    assert sizing is not None
    found = offered(f"mech-twin study {name} size --limit ", monkeypatch, capsys)
    usual = {f"{limit}=": value for limit, value in sizing.limits.items() if not math.isnan(value)}
    assert {limit: f"usually {value:g}" for limit, value in usual.items()}.items() <= found.items()


def test_variables_of_a_design_are_offered_with_their_bounds(monkeypatch, capsys) -> None:
    design = CATALOGUE["compaction_press"].capabilities.design
    assert design is not None
    found = offered("mech-twin study compaction_press search --bound ", monkeypatch, capsys)
    assert found == {f"{key}=": f"usually {low:g}:{high:g}" for key, (low, high) in design.variables.items()}


def test_every_machine_answers_a_sweep_and_some_more() -> None:
    assert all({"sweep", "search"} <= {*questions_of(name)} for name in CATALOGUE)
    assert questions_of("compaction_press") == ("sweep", "size", "search", "designs")

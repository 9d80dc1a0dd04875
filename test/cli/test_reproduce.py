# SPDX-License-Identifier: Apache-2.0
"""``mech-twin reproduce``: the table, its document, its exit code."""

import csv
import io
import json

import pytest

from mech_twin.cli.console import CommandError
from mech_twin.cli.reproduce import reproduce_machines
from mech_twin.cli.verbs import ReproduceVerb


def test_the_document_has_every_column_of_the_table(capsys):
    reproduce_machines(ReproduceVerb(machine="winding_drum", as_json=True))
    document = json.loads(capsys.readouterr().out)
    assert document["all_gated_hold"] is True
    asked = {
        "source",
        "figure_or_equation",
        "inputs",
        "published",
        "computed",
        "error",
        "tolerance",
        "verdict",
        "reason",
    }
    assert all(asked <= set(row) for row in document["rows"])


def test_a_gated_row_that_does_not_hold_gives_exit_code_1(capsys):
    with pytest.raises(SystemExit) as left:
        reproduce_machines(ReproduceVerb(machine="vibration_crank", settings=["masses.tree_kg=60.0"], as_json=True))
    assert left.value.code == 1
    assert json.loads(capsys.readouterr().out)["all_gated_hold"] is False


def test_a_change_needs_the_name_of_a_machine():
    with pytest.raises(CommandError, match="name it"):
        reproduce_machines(ReproduceVerb(settings=["mass_kg=2.0"], as_json=True))


def test_the_table_shows_the_awkward_rows(capsys):
    reproduce_machines(ReproduceVerb(machine="vibration_crank"))
    shown = capsys.readouterr().out
    assert "contradicts itself" in shown
    assert "435.8" in shown


def test_csv_has_a_line_for_each_row(capsys):
    reproduce_machines(ReproduceVerb(machine="vibration_crank", as_json=True))
    rows = json.loads(capsys.readouterr().out)["rows"]
    reproduce_machines(ReproduceVerb(machine="vibration_crank", as_csv=True))
    read = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [line["quantity"] for line in read] == [row["quantity"] for row in rows]
    assert [float(line["computed"]) for line in read] == pytest.approx([row["computed"] for row in rows], rel=1e-6)

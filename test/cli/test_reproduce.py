# SPDX-License-Identifier: Apache-2.0
"""``mech-twin reproduce``: the table, its document, its exit code."""

import csv
import io
import json

import pytest

from mech_twin.cli.failure import CommandError
from mech_twin.cli.reproduce import reproduce_machines


def test_the_document_has_every_column_of_the_table(capsys):
    reproduce_machines("winding_drum", None, None, [], shape="json")
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
        reproduce_machines("vibration_crank", None, None, ["masses.tree_kg=60.0"], shape="json")
    assert left.value.code == 1
    assert json.loads(capsys.readouterr().out)["all_gated_hold"] is False


def test_a_change_needs_the_name_of_a_machine():
    with pytest.raises(CommandError, match="name it"):
        reproduce_machines(None, None, None, ["mass_kg=2.0"], shape="json")


def test_the_table_shows_the_awkward_rows(capsys):
    reproduce_machines("vibration_crank", None, None, [], shape="narrow")
    shown = capsys.readouterr().out
    assert "contradicts itself" in shown
    assert "435.8" in shown


@pytest.mark.slow
def test_the_table_fits_80_columns(capsys):
    reproduce_machines(None, None, None, [])
    assert max(len(line) for line in capsys.readouterr().out.splitlines()) <= 80


def test_csv_has_a_line_for_each_row(capsys):
    reproduce_machines("vibration_crank", None, None, [], shape="json")
    rows = json.loads(capsys.readouterr().out)["rows"]
    reproduce_machines("vibration_crank", None, None, [], shape="csv")
    read = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [line["quantity"] for line in read] == [row["quantity"] for row in rows]
    assert [float(line["computed"]) for line in read] == pytest.approx([row["computed"] for row in rows], rel=1e-6)

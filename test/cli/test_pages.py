# SPDX-License-Identifier: Apache-2.0
"""Verbs on pages: a page to start from, its check, a run by its path, and a bag that explains itself."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from mech_twin.capabilities.errors import StudyError
from mech_twin.cli.failure import CommandError
from mech_twin.cli.main import app
from mech_twin.cli.pages import shipped_pages
from mech_twin.configuration_tree import ConfigurationError

RUNNER = CliRunner()


def answer(*words):
    """Return what a command writes; its error is raised."""
    result = RUNNER.invoke(app, [str(word) for word in words], catch_exceptions=False, standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return result.output


@pytest.fixture
def page(tmp_path):
    file = tmp_path / "my.yaml"
    file.write_text(answer("new", "spring_hammer"), encoding="utf-8")
    return file


@pytest.mark.parametrize("kind", shipped_pages())
def test_every_page_to_start_from_passes_its_check(tmp_path, kind):
    file = tmp_path / "mine.yaml"
    file.write_text(answer("new", kind), encoding="utf-8")
    found = json.loads(answer("check", file, "--json"))
    assert found["numbers"]["freedoms"] + found["numbers"]["driven_joints"] >= 1


def test_check_draws_the_machine(page, tmp_path):
    picture = tmp_path / "my.png"
    answer("check", page, "--picture", picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 5000


def test_a_page_stands_where_a_machine_s_name_does(page):
    found = json.loads(answer("simulate", page, "--duration", "1", "--json"))
    assert found["config"]["name"] == "spring_hammer"
    assert found["summary"]["blow_impacts"] >= 1
    assert {event["contact"] for event in found["events"]} <= {"blow", "ram_friction"}
    assert all(residual["worst"] <= residual["limit"] for residual in found["residuals"].values())


def test_a_key_of_the_page_is_set_by_its_names(page):
    found = json.loads(
        answer("simulate", page, "--duration", "0.1", "--json", "--set", "springs.spring.rate_n_per_m=9000")
    )
    assert found["config"]["springs"]["spring"]["rate_n_per_m"] == 9000.0


def test_a_bag_of_a_page_is_computed_anew_to_the_bit_without_the_page(page, tmp_path):
    bag = tmp_path / "bag"
    answer("simulate", page, "--duration", "0.5", "--bag", bag)
    page.unlink()
    answer("replay", bag, "--resimulate")


def test_a_sweep_takes_keys_by_the_page_s_names(page, tmp_path):
    table = tmp_path / "sweep.csv"
    answer(
        "study", page, "sweep", "--over", "springs.spring.rate_n_per_m=7000,9000", "--duration", "0.3",
        "--out", table, "--no-picture", "--cores", "1",
    )  # fmt: skip
    rows = table.read_text(encoding="utf-8").splitlines()
    assert len(rows) == 3
    assert "springs.spring.rate_n_per_m" in rows[0]
    assert rows[1] != rows[2]


def test_a_page_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ConfigurationError, match="no such page"):
        answer("simulate", tmp_path / "nothing.yaml", "--duration", "1")


def test_a_fault_of_a_page_names_file_and_element(page):
    page.write_text(page.read_text(encoding="utf-8").replace("rod.end", "rod.tip"), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"my\.yaml: joints\.wrist\.between: rod has no point 'tip'"):
        answer("check", page)


def test_a_page_is_compared_with_a_bag_of_it(page, tmp_path):
    bag = tmp_path / "bag"
    answer("simulate", page, "--duration", "0.3", "--bag", bag)
    found = json.loads(answer("compare", page, bag, "--duration", "0.3", "--json"))
    assert found
    assert RUNNER.invoke(app, ["compare", str(page), str(bag), "--duration", "0.3"]).exit_code == 0


def test_a_map_of_a_page_is_of_every_path_of_it(page, tmp_path):
    bag, chart = tmp_path / "bag", tmp_path / "map.yaml"
    answer("simulate", page, "--duration", "0.3", "--bag", bag)
    answer("map", bag, page, "--out", chart)
    with pytest.raises(StudyError, match="declares no features of a cycle"):
        answer("monitor", page, bag, "--map", chart, "--baseline", bag)


@pytest.mark.parametrize("words", [("info",), ("view",)])
def test_a_page_where_a_recording_is_expected_is_told_apart(page, words):
    with pytest.raises(CommandError, match="expected a recording, not a page"):
        answer(*words, page)


def test_a_page_is_not_followed_and_that_is_told(page):
    with pytest.raises(CommandError, match="a page has no observer"):
        answer("shadow", page, "--from", "/there")


@pytest.mark.parametrize(("question", "reason"), [("size", "nothing to size"), ("search", "no design question")])
def test_questions_that_a_page_does_not_answer_are_refused_by_name(page, question, reason):
    with pytest.raises(StudyError, match=reason):
        answer("study", page, question)

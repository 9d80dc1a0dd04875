# SPDX-License-Identifier: Apache-2.0
"""Tables fit a terminal of 80 columns, leave nothing out in silence, and show all where they are asked to."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from command_line import mech_twin
from typer.main import get_command

from mech_twin.cli.console import numbered, print_table
from mech_twin.cli.main import app
from mech_twin.cli.run_summary import (
    GROUPS,
    HEADLINES,
    analysed_groups,
    group_of,
    grouped,
    headlines,
    is_notable,
    show_events,
    show_numbers,
    show_residuals,
)
from mech_twin.cli.study_answers import joined
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine
from mech_twin.samples import Event

FOUR_BAR = Path(__file__).resolve().parents[2] / "config" / "pages" / "four_bar.yaml"

# of the run of a machine, as its observer names them
RUN = {
    "time_s": 2.0,
    "blows": 17,
    "run_crank_pin_between_blows_peak_n": 1731.3,
    "worst_loop_closure_m": 1e-16,
    "steady_blow_rate_hz": 10.1,
    "steady_blow_energy_j": 18.2,
    "steady_fluctuation": 0.07,
    "steady_motor_power_w": 566.0,
    "steady_crank_pin_between_blows_peak_n": 1700.0,
    "steady_rocker_bearing_between_blows_peak_n": 1109.0,
    "steady_crank_bearing_impulse_peak_ns": 54.6,
    "steady_rocker_bearing_impulse_peak_ns": 74.1,
}


def typed(words: str, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("mech_twin.cli.console.PIPED", 80)
    done = mech_twin(*words.split())
    assert done.code == 0
    return done.out


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_analysed_position_fits_with_every_number_and_unit(name, monkeypatch) -> None:
    shown = typed(f"analyse {name} --crank-deg 30", monkeypatch)
    assert max(map(len, shown.splitlines())) <= 80
    assert "{" not in shown
    assert "[" not in shown
    named = {line.split()[0] for line in shown.splitlines() if line.split()}
    assert set(machine(name).report()) <= named
    for key, value in machine(name).analyse(math.radians(30.0)).items():
        assert key in named or (isinstance(value, list) and set(value[0]) <= named)


def test_every_number_of_every_cart_is_a_column_of_the_cycle(monkeypatch) -> None:
    rows = list(csv.DictReader(io.StringIO(typed("analyse roller_former --cycle 6 --csv", monkeypatch))))
    assert len(rows) == 6
    assert {"crank_rad", "moment_nm", "rod_force_n.1", "rod_force_n.2"} <= set(rows[0])
    assert all(math.isfinite(float(value)) for row in rows for value in row.values())


def test_a_sweep_shows_what_varies_and_says_what_it_leaves_out(monkeypatch, tmp_path) -> None:
    words = f"study winding_drum sweep --over package_radius_m=0.2,0.3 --no-picture --out {tmp_path / 't.csv'}"
    shown = typed(words, monkeypatch)
    assert max(map(len, shown.splitlines())) <= 80
    assert "yarn_length_m" in shown
    assert "angular_speed_last_rad_per_s" not in shown  # the core's: the same at every point
    assert "more columns with --all" in shown
    every = typed(f"{words} --force --all", monkeypatch)
    assert "angular_speed_last_rad_per_s" in every
    rows = list(csv.DictReader(io.StringIO(typed(f"{words} --force --csv", monkeypatch))))
    assert {float(row["package_radius_m"]) for row in rows} == {0.2, 0.3}
    assert all(float(row["angular_speed_last_rad_per_s"]) > 0.0 for row in rows)


@pytest.mark.parametrize(
    ("words", "files"),
    [
        ("simulate compaction_press --duration 1.2 --table a.csv --energy a.svg", "a.csv and a.svg"),
        ("map a.csv winding_drum --out a.yaml", "a.yaml"),
        (f"check {FOUR_BAR} --picture a.svg", "a.svg"),
        (f"view {FOUR_BAR} --duration 0.1 --save a.rrd", "a.rrd"),
        ("study compaction_press size", "compaction_press-sized.yaml"),
    ],
)
def test_a_verb_says_once_which_files_it_wrote(words, files, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    if words.startswith("map"):
        assert mech_twin("simulate", "winding_drum", "--duration", "1", "--table", "a.csv").code == 0
    said = mech_twin(*words.split(), "--force").err
    assert [line for line in said.splitlines() if "wrote" in line] == [f"wrote {files}"]


def test_a_sweep_shows_every_number_that_is_asked_for(monkeypatch, tmp_path) -> None:
    words = f"study winding_drum sweep --over package_radius_m=0.2,0.3 --no-picture --force --out {tmp_path / 't.csv'}"
    asked = "--number angular_speed_last_rad_per_s --number yarn_length_m"
    shown = typed(f"{words} {asked}", monkeypatch)
    assert "angular_speed_last_rad_per_s" in shown
    assert "yarn_length_m" in shown
    alone = typed(words.replace("0.2,0.3", "0.2"), monkeypatch)
    assert "yarn_length_m" in alone


def test_columns_that_do_not_fit_are_named(monkeypatch, capsys) -> None:
    monkeypatch.setattr("mech_twin.cli.console.PIPED", 80)
    columns = [f"quantity_{i}_m" for i in range(12)]
    print_table("wide", columns, [[float(i) for i in range(12)]], more="--wide")
    shown = capsys.readouterr().out
    head = shown.splitlines()[1].split()
    assert 2 <= len(head) < 12
    assert f"{12 - len(head)} more columns with --wide" in shown
    assert all(column in shown.replace("\n", " ") for column in columns)


def test_brackets_of_a_cell_are_shown(capsys) -> None:
    print_table("with [brackets]", ("name",), [("[bold]m[/bold]",)])
    assert "[bold]m[/bold]" in capsys.readouterr().out


def test_each_number_is_in_one_group_and_a_headline_is_one_of_them() -> None:
    found = grouped(RUN, {"time_s"})
    assert sorted(name for values in found.values() for name in values) == sorted(RUN)
    assert set(found) <= set(GROUPS)
    for group, values in found.items():
        chosen = headlines(values, group)
        assert chosen.items() <= values.items()
        assert len(chosen) <= HEADLINES.get(group, 0)
    assert list(headlines(found["bearings"], "bearings")) == [
        "run_crank_pin_between_blows_peak_n",
        "steady_rocker_bearing_between_blows_peak_n",
        "steady_rocker_bearing_impulse_peak_ns",
    ]


@pytest.mark.parametrize(
    ("name", "group"),
    [
        ("worst_energy_balance", "checks"),
        ("steady_blow_energy_j", "impacts"),
        ("run_rocker_bearing_between_blows_peak_n", "bearings"),
        ("steady_motor_power_w", "operation"),
        ("turn_non_uniformity", "operation"),
    ],
)
def test_the_group_follows_from_the_name(name: str, group: str) -> None:
    assert group_of(name) == group
    assert group_of(name, {name}) == ("checks" if group == "checks" else "design")


def test_the_summary_says_how_many_numbers_it_leaves_out(capsys) -> None:
    show_numbers("run", RUN, ("time_s",), everything=False)
    short = capsys.readouterr().out
    shown = sum(name in short for name in RUN)
    assert f"{len(RUN) - shown} more numbers with --all" in short
    show_numbers("run", RUN, ("time_s",), everything=True)
    every = capsys.readouterr().out
    assert all(name in every for name in RUN)


def test_a_number_is_told_in_the_digits_of_shorter_steps(capsys) -> None:
    run, shorter = (
        {"run_pin_force_max_n": 4248.81, "run_stalls": 20.0},
        {"run_pin_force_max_n": 4251.17, "run_stalls": 21.0},
    )
    show_numbers("run", run, (), shorter, everything=True)
    shown = capsys.readouterr().out
    assert "4250" in shown and "4248.81" not in shown
    assert "20 to 21" in shown


def event(speed: float, impulse: float, kind: str = "impact") -> Event:
    return Event(1.0, kind, "stop", speed, -0.5 * speed, impulse, 1)


def test_the_end_of_a_dying_series_is_left_out_unless_asked_for(capsys) -> None:
    blow, whisper, change = event(1.5, 2.0, "blow"), event(5e-4, 1e-4), event(0.0, 0.0, "release")
    assert [is_notable(one) for one in (blow, whisper, change)] == [True, False, True]
    counts = Counter(one.kind for one in (blow, whisper, change))
    show_events([blow, whisper, change], counts, everything=False)
    short = capsys.readouterr().out
    assert "3 events: 1 blow, 1 impact, 1 release" in short
    assert "1 more with --all" in short
    assert "0.0005" not in short
    show_events([blow, whisper, change], counts, everything=True)
    assert "0.0005" in capsys.readouterr().out


def test_events_that_a_long_run_no_longer_keeps_are_counted(capsys) -> None:
    show_events([event(1.5, 2.0, "blow")], Counter(blow=30_000, release=1), everything=True)
    assert "30001 events: 30000 blow, 1 release; the newest 1 are kept" in capsys.readouterr().out


def test_a_residual_that_is_no_number_is_broken(capsys) -> None:
    residuals = {
        "loop_closure_m": {"worst": 1e-16, "limit": 1e-12},
        "energy_balance": {"worst": float("nan"), "limit": 1e-9},
    }
    show_residuals(residuals)
    states = {line.split()[0]: line.split()[-1] for line in capsys.readouterr().out.splitlines()}
    assert states["loop_closure_m"] == "holds"
    assert states["energy_balance"] == "broken"


def test_equal_regimes_that_follow_each_other_are_one_row() -> None:
    rows = [(0.1, "periodic", 1, "1", 2.0), (0.2, "periodic", 1, "1", 3.0), (0.3, "chaotic", "-", "-", 4.0)]
    assert joined(rows) == [(0.1, 0.2, "periodic", 1, "1", "2 to 3"), (0.3, 0.3, "chaotic", "-", "-", "4")]


def commands() -> list[list[str]]:
    root: Any = get_command(app)
    questions = root.commands["study"].commands
    return [[], *([name] for name in root.commands), *(["study", "mb10_breaker", question] for question in questions)]


@pytest.mark.parametrize("words", commands(), ids=" ".join)
def test_every_help_text_fits_80_columns_and_says_what_each_option_takes(words, monkeypatch) -> None:
    shown = typed(" ".join([*words, "--help"]), monkeypatch)
    assert max(map(len, shown.splitlines())) <= 80
    assert "<" not in shown.replace("<=", "")  # no name of a Python type
    assert "…" not in shown


def test_no_help_text_has_brackets_which_the_library_takes_for_markup() -> None:
    root: Any = get_command(app)
    every = [*root.commands.values(), *root.commands["study"].commands.values()]
    for command in every:
        assert command.help
        for parameter in command.params:
            assert parameter.help, (command.name, parameter.name)
            assert "[" not in parameter.help, (command.name, parameter.name)


@pytest.mark.parametrize(("question", "grid"), [("sweep", True), ("regimes", False)])
def test_a_grid_of_keys_is_offered_by_the_question_that_takes_one(question, grid) -> None:
    root: Any = get_command(app)
    over = next(each for each in root.commands["study"].commands[question].params if each.name == "over")
    assert ("grid" in over.help) is grid


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_analysis_stands_in_the_groups_of_a_summary_and_leaves_nothing_out(name) -> None:
    report = machine(name).report()
    groups = analysed_groups(report)
    assert set(groups) <= set(GROUPS)
    assert sorted(key for values in groups.values() for key in values) == sorted(report)
    assert list(groups) == [group for group in GROUPS if group in groups]


def test_the_margin_of_a_limit_has_the_unit_of_its_number() -> None:
    rows = numbered({"run_power_mean_w <= 200": 31.2, "crank_m": 0.05})
    assert rows == [("run_power_mean_w <= 200", 31.2, "W"), ("crank_m", 0.05, "m")]

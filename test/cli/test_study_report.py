# SPDX-License-Identifier: Apache-2.0
"""The report of a study is one file: settings that differ, every point and constraint, the picture, the versions."""

from __future__ import annotations

import csv
import re
from html import unescape

import pytest
from command_line import mech_twin

from mech_twin import __version__

NAME = "vibration_crank"


def cells(html: str, title: str) -> list[list[str]]:
    """Return the rows of the table below a heading, the head first."""
    table = html[html.index(f"<h2>{title}</h2>") :].partition("</table>")[0]
    rows = re.findall(r"<tr>(.*?)</tr>", table)
    return [[unescape(cell) for cell in re.findall(r"<t[hd]>(.*?)</t[hd]>", row)] for row in rows]


@pytest.mark.slow
def test_a_sweep_is_reported_with_its_settings_points_picture_and_versions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("--over", "masses.extra_kg=4:8:3", "--set", "masses.boom_kg=30", "--out", "s.csv", "--report", "s.html")
    assert mech_twin("study", NAME, "sweep", *words).code == 0
    html = (tmp_path / "s.html").read_text(encoding="utf-8")
    assert cells(html, "Settings that differ from the machine as installed")[1:] == [["masses.boom_kg", "33.4", "30.0"]]
    assert ["over", "masses.extra_kg=4:8:3"] in cells(html, "Asked")
    head, *points = cells(html, re.search(r"<h2>(vibration_crank: points: 3, .*?)</h2>", html)[1])
    with (tmp_path / "s.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert [point[0] for point in points] == ["4", "6", "8"]
    for name in head[1:]:
        assert [point[head.index(name)] for point in points] == [f"{float(row[name]):.6g}" for row in table]
    assert 'src="data:image/png;base64,' in html
    assert f"mech_twin {__version__}, Python" in html
    assert "@media print" in html
    assert not re.search(r"(src|href)=\"(?!data:)", html), "nothing is fetched"


def test_a_sizing_is_reported_with_its_constraints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert mech_twin("study", NAME, "size", "--report", "s.html").code == 0
    html = (tmp_path / "s.html").read_text(encoding="utf-8")
    assert len(cells(html, f"{NAME}: sizes")) > 1
    states = {row[-1] for row in cells(html, "constraints")[1:]}
    assert states <= {"binds", "holds", "not met"}
    assert states


def reported(monkeypatch, folder, *words: str) -> str:
    """Return the report of a study, which tells its question as asked."""
    monkeypatch.chdir(folder)
    ended = mech_twin("study", *words, "--report", "s.html")
    assert ended.code == 0, ended.err
    return (folder / "s.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_designs_are_reported_with_the_question_and_the_best_of_each_objective(tmp_path, monkeypatch):
    words = ("--count", "2000", "--seed", "3", "--bound", "crank=0.03:0.08", "--set", "drive.speed_rpm=200.0")
    html = reported(monkeypatch, tmp_path, "compaction_press", "designs", *words)
    assert ["bound", "crank=0.03:0.08"] in cells(html, "Asked")
    assert ["seed", "3"] in cells(html, "Asked")
    assert cells(html, "Settings that differ from the machine as installed")[1][-1] == "200.0"
    assert cells(html, "designs")[1][:2] == ["designs", "2000"]
    head, *rows = cells(html, "best designs")
    assert all(0.03 <= float(row[head.index("crank_m")]) <= 0.08 for row in rows)
    torque = [float(row[head.index("peak_torque_nm")]) for row in rows]
    assert torque[[row[0] for row in rows].index("peak_torque_nm")] == min(torque)


@pytest.mark.slow
def test_a_search_is_reported_with_its_front_and_its_margins(tmp_path, monkeypatch):
    words = ("--objective", "peak_torque_nm", "--objective", "flywheel_inertia_kg_m2", "--points", "1")
    html = reported(monkeypatch, tmp_path, "compaction_press", "search", *words)
    assert ["objective", "peak_torque_nm, flywheel_inertia_kg_m2"] in cells(html, "Asked")
    front = "Pareto front of peak_torque_nm, flywheel_inertia_kg_m2"
    assert len(cells(html, front)) > 2
    margins = cells(html, "margins of the constraints (least first; 0 binds)")
    assert all(float(margin) >= -1e-6 for _, margin, _ in margins[1:])
    assert 'alt="Pareto front of peak_torque_nm, flywheel_inertia_kg_m2" src="data:image/png;base64,' in html


@pytest.mark.slow
def test_cycles_and_regimes_are_reported(tmp_path, monkeypatch):
    html = reported(monkeypatch, tmp_path, "impact_mass", "synthesise", "--periods", "1000", "--starts", "10")
    assert ["starts", "10"] in cells(html, "Asked")
    assert cells(html, "one-impact cycle")[0] == ["", "published", "robust"]
    over = "phase1_duration_s=0.03:0.04:3"
    words = ("--over", over, "--settling", "100", "--force")
    html = reported(monkeypatch, tmp_path, "impact_mass", "regimes", *words)
    assert ["over", over] in cells(html, "Asked")
    assert len(cells(html, "regimes")) == 4
    assert 'src="data:image/png;base64,' in html
    for out, shown in (("r.svg", 'src="data:image/svg+xml;base64,'), ("r.pdf", "picture: r.pdf")):
        assert shown in reported(monkeypatch, tmp_path, "impact_mass", "regimes", *words, "--out", out)


def test_a_report_that_is_there_is_not_overwritten_and_another_suffix_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.html").write_text("mine")
    for report in ("s.html", "s.pdf"):
        words = ("--over", "masses.extra_kg=4:8:3", "--report", report)
        ended = mech_twin("study", NAME, "sweep", *words)
        assert ended.code != 0
        assert report in ended.err
    assert (tmp_path / "s.html").read_text() == "mine"

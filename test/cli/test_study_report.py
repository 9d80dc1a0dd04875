# SPDX-License-Identifier: Apache-2.0
"""The report of a study is one file: settings that differ, every point and constraint, the picture, the versions."""

from __future__ import annotations

import csv
import re
from html import unescape

from command_line import mech_twin

from mech_twin import __version__

NAME = "vibration_crank"


def cells(html: str, title: str) -> list[list[str]]:
    """Return the rows of the table below a heading, the head first."""
    table = html[html.index(f"<h2>{title}</h2>") :].partition("</table>")[0]
    rows = re.findall(r"<tr>(.*?)</tr>", table)
    return [[unescape(cell) for cell in re.findall(r"<t[hd]>(.*?)</t[hd]>", row)] for row in rows]


def test_a_sweep_is_reported_with_its_settings_points_picture_and_versions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("--over", "masses.extra_kg=4:8:3", "--set", "masses.boom_kg=30", "--out", "s.csv", "--report", "s.html")
    assert mech_twin("study", NAME, "sweep", *words).code == 0
    html = (tmp_path / "s.html").read_text(encoding="utf-8")
    assert cells(html, "Settings that differ from the machine as installed")[1:] == [["masses.boom_kg", "33.4", "30.0"]]
    assert cells(html, "Varied")[1:] == [["masses.extra_kg", "3", "4", "8"]]
    head, *points = cells(html, "Points")
    with (tmp_path / "s.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert [point[0] for point in points] == ["4", "6", "8"]
    for name in head[1:-1]:
        assert [point[head.index(name)] for point in points] == [f"{float(row[name]):.6g}" for row in table]
    assert 'src="data:image/png;base64,' in html
    assert f"mech_twin {__version__}, Python" in html
    assert "@media print" in html
    assert not re.search(r"(src|href)=\"(?!data:)", html), "nothing is fetched"


def test_a_sizing_is_reported_with_its_constraints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert mech_twin("study", NAME, "size", "--report", "s.html").code == 0
    html = (tmp_path / "s.html").read_text(encoding="utf-8")
    assert len(cells(html, "Sizes")) > 1
    states = {row[-1] for row in cells(html, "Constraints")[1:]}
    assert states <= {"binds", "holds", "not met"}
    assert states


def test_a_report_that_is_there_is_not_overwritten_and_another_suffix_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.html").write_text("mine")
    for report in ("s.html", "s.pdf"):
        words = ("--over", "masses.extra_kg=4:8:3", "--report", report)
        ended = mech_twin("study", NAME, "sweep", *words)
        assert ended.code != 0
        assert report in ended.err
    assert (tmp_path / "s.html").read_text() == "mine"

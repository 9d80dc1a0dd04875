# SPDX-License-Identifier: Apache-2.0
"""Samples that a page could not take in are dropped: the next picture goes out when the last one is shown."""

import time

import pytest
from rrd_tables import rrd_tables
from synthetic_four_bar import drawing, frame

from mech_twin.view import flow as flow_module
from mech_twin.view.flow import MOST_PAGES, PATIENCE_S, Flow, PageReports
from mech_twin.view.rerun_scene import RerunScene
from mech_twin.view.sending import LIVE


@pytest.fixture
def clock(monkeypatch):
    """The clock of the module, which goes on only when told."""
    now = [1000.0]
    monkeypatch.setattr(flow_module.time, "monotonic", lambda: now[0])
    return now


def test_the_next_picture_waits_until_the_page_has_shown_the_last_one(tmp_path, clock):
    reports, flow = PageReports(tmp_path), Flow(tmp_path)
    assert flow.is_open(0.1)
    flow.sent(5.0)
    reports.shown("a", 4.9)
    clock[0] += 1.0
    assert not flow.is_open(0.1)
    reports.shown("a", 5.0)
    clock[0] += 0.02
    assert flow.is_open(0.1)


def test_pictures_go_out_no_faster_than_asked(tmp_path, clock):
    reports, flow = PageReports(tmp_path), Flow(tmp_path)
    flow.sent(5.0)
    reports.shown("a", 5.0)
    clock[0] += 0.05
    assert not flow.is_open(0.1)
    clock[0] += 0.06
    assert flow.is_open(0.1)


def test_a_page_that_loads_or_stands_still_gets_a_picture_now_and_then(tmp_path, clock):
    reports, flow = PageReports(tmp_path), Flow(tmp_path)
    reports.opened()
    flow.sent(5.0)
    clock[0] += PATIENCE_S - 0.1
    assert not flow.is_open(0.1)
    clock[0] += 0.2
    assert flow.is_open(0.1)


def test_of_more_pages_than_are_kept_those_heard_last_count(tmp_path, clock):
    reports, flow = PageReports(tmp_path), Flow(tmp_path)
    for number in range(MOST_PAGES + 1):
        reports.shown(f"page{number}", float(number))
    assert flow.shown_s() == 1.0
    reports.shown("page1", 50.0)
    assert flow.shown_s() == 2.0


def test_of_several_pages_the_slowest_counts_until_it_has_gone(tmp_path, clock):
    reports, flow = PageReports(tmp_path), Flow(tmp_path)
    reports.shown("slow", 1.0)
    reports.shown("fast", 5.0)
    assert flow.shown_s() == 1.0
    clock[0] += 60.0
    reports.shown("fast", 6.0)
    assert flow.shown_s() == 6.0


def test_where_nobody_says_what_is_shown_pictures_go_out_at_intervals(tmp_path, clock):
    for flow in (Flow(), Flow(tmp_path)):
        flow.sent(5.0)
        clock[0] += 0.2
        assert not flow.is_open(0.03)
        clock[0] += 0.1
        assert flow.is_open(0.03)


def test_what_a_page_could_not_take_in_is_dropped_and_the_newest_second_is_sent(tmp_path):
    pages = tmp_path / "pages"
    pages.mkdir()
    reports = PageReports(pages)
    reports.shown("a", 0.0)
    path = tmp_path / "run.rrd"
    with RerunScene("four_bar", rrd_path=path, sending=LIVE, flow=Flow(pages)) as scene:
        scene._flow.sent(0.5)  # a picture is under way from here on
        for step in range(4000):
            if step == 3500:
                reports.shown("a", 0.5)
                time.sleep(0.15)
            now = frame(step)
            scene.frame(now.motor, now.linkage, now.forces, now.body)
            if scene.drawing_due(now.linkage.time_s):
                scene.drawing(drawing(step))
    steps = sorted(rrd_tables(path)[0]["/pins/magnitude"]["step"].to_pylist())
    assert steps[0] >= 2499
    assert steps[-1] == 3999

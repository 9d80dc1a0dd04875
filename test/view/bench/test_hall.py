# SPDX-License-Identifier: Apache-2.0
"""A person opens the bench without a run: recordings are listed, opened, laid over each other, fetched and salvaged."""

from __future__ import annotations

import json
import re
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from browser import COMMAND, UP_MS, opened, running
from playwright.sync_api import expect

from mech_twin import __version__
from mech_twin.recording.bag_reader import open_bag

pytestmark = [pytest.mark.browser, pytest.mark.slow]
SPAN_S, STEP_S = 1.5, 0.001
RUN = {"vibration_crank": "vibration crank", "winding_drum": "winding drum", "mine.yaml": "slider crank"}
CONFIG = Path(__file__).parents[3] / "config"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return a folder of two recordings of the press, the second with twice the force, and one cut off."""
    folder = tmp_path_factory.mktemp("recordings")
    for name, changes in (("soft", []), ("hard", ["--set", "working_force.peak_n=20000"])):
        words = ["simulate", "compaction_press", "--duration", str(SPAN_S), "--one-step", "--bag", name, *changes]
        subprocess.run([*COMMAND, *words], check=True, capture_output=True, cwd=folder, timeout=300)
    cut = folder / "cut.mcap"
    whole = next((folder / "soft").glob("*.mcap")).read_bytes()
    cut.write_bytes(whole[: 2 * len(whole) // 3])
    return folder


def row(page, name):
    return page.locator(".recording", has_text=re.compile(f"^{re.escape(name)}:"))


def test_recordings_are_listed_opened_compared_fetched_and_salvaged(browser, recordings, ros_domain):
    with running("bench", str(recordings), folder=recordings) as (url, _), opened(browser, url, shows=False) as page:
        expect(page.locator("#status")).to_have_text("Open a recording, or run a machine.", timeout=UP_MS)
        expect(page.locator("#state")).to_have_text("ready")
        expect(row(page, "soft")).to_contain_text(re.compile(r"compaction press, 1\.5 s, .* MB, complete"))
        expect(row(page, "cut.mcap")).to_contain_text(re.compile("damaged|not closed"))

        # what of a machine is not as installed
        expect(row(page, "soft").locator("details")).to_have_count(0)
        row(page, "hard").locator("summary").click()
        expect(row(page, "hard").locator("td")).to_have_text(["working_force.peak_n", "10000.0", "20000.0"])

        # open one
        row(page, "hard").get_by_role("button", name="Open").click()
        expect(page.locator("#machine")).to_have_text("compaction press", timeout=UP_MS)
        page.wait_for_function(f"() => Number(document.getElementById('cursor').max) > {SPAN_S - 0.1}", timeout=UP_MS)
        expect(page.locator("#command")).to_be_hidden()

        # two in one view: the pressing force of the second is twice that of the first
        row(page, "soft").get_by_role("button", name="Reference", exact=True).click()
        row(page, "hard").get_by_role("button", name="Compare with reference").click()
        expect(page.locator("#settings")).to_contain_text("working_force.peak_n", timeout=UP_MS)
        expect(page.locator("#settings tr")).to_have_text("working_force.peak_n10000.020000.0")
        page.wait_for_function("() => window.bench.apart().rows > 100", timeout=UP_MS)
        assert page.evaluate("() => window.bench.apart().largest") > 1000.0
        assert page.evaluate("() => window.bench.apart().rows") % (SPAN_S / STEP_S + 1) == 0  # every step
        page.locator("#how").select_option("difference")
        page.locator("#align").select_option("angle")
        with page.expect_download() as saved:
            page.locator("#report").click()
        report = saved.value.path().read_text(encoding="utf-8")
        assert "Runs: curves are A - B, at equal cycle angle" in report
        assert "<figcaption>Pin reactions, N, A - B</figcaption>" in report

        # fetch one
        with page.expect_download() as fetched:
            row(page, "soft").get_by_role("button", name="Download").click()
        kept = next((recordings / "soft").glob("*.mcap"))
        assert fetched.value.suggested_filename == kept.name
        assert fetched.value.path().read_bytes() == kept.read_bytes()
        assert page.request.get(fetched.value.url).status == 404, "an address serves once"

        # salvage one
        row(page, "cut.mcap").get_by_role("button", name="Salvage").click()
        expect(row(page, "cut_salvaged")).to_contain_text("closed, but not complete", timeout=UP_MS)
        with open_bag(recordings / "cut_salvaged") as reader:
            assert reader.info.message_count > 100


def test_machines_and_a_page_of_ones_own_are_run_from_the_bench_and_their_recordings_listed(
    browser, ros_domain, tmp_path
):
    (tmp_path / "mine.yaml").write_bytes((CONFIG / "pages" / "slider_crank.yaml").read_bytes())
    with running("bench", str(tmp_path), folder=tmp_path) as (url, _), opened(browser, url, shows=False) as page:
        expect(page.locator("#recordings")).to_have_text("no recording here", timeout=UP_MS)
        for machine, name in RUN.items():
            page.evaluate("() => { window.bench.shown = 0; }")
            page.locator("#machines").select_option(machine)
            page.locator("#begin").click()
            expect(page.locator("#machine")).to_have_text(name, timeout=UP_MS)
            page.wait_for_function("() => window.bench.shown > 0.2", timeout=UP_MS)
            page.locator("#order-pause").click()
            expect(page.locator("#state")).to_have_text("paused")
        step_once(page)
        (tmp_path / "bad.yaml").write_text("name: bad\nbodees: {}\n", encoding="utf-8")
        page.locator("#list").click()
        expect(page.locator(".recording", has_text="vibration_crank")).to_contain_text("complete", timeout=UP_MS)
        expect(page.locator(".recording", has_text="mine-")).to_contain_text("slider crank", timeout=UP_MS)
        page.locator("#machines").select_option("bad.yaml")
        page.locator("#begin").click()
        expect(page.locator("#status")).to_contain_text("bad.yaml: expected a page with bodies", timeout=UP_MS)
        expect(page.locator("#answers li.refused").first).to_contain_text("bad.yaml: expected a page")
        expect(page.locator("#machine")).to_have_text("mech_twin bench")
        expect(page.locator("#machines")).to_have_value("bad.yaml")


def step_once(page) -> None:
    """Order one step of a paused run: its time goes on by a step, and no further."""
    page.wait_for_timeout(500)  # the pictures on their way when it paused are drawn
    before = page.evaluate("() => window.bench.shown")
    page.locator("#order-step").click()
    page.wait_for_function(f"() => window.bench.shown > {before}")
    after = page.evaluate("() => window.bench.shown")
    assert 0.0 < after - before < 0.005, "what was shown is where it paused"
    page.wait_for_timeout(500)
    assert page.evaluate("() => window.bench.shown") == after
    expect(page.locator("#state")).to_have_text("paused")


def test_a_report_holds_machine_settings_pictures_numbers_and_versions_in_one_file(browser, ros_domain, tmp_path):
    words = ("run", "mb10_breaker", "--no-record", "--set", "tool.restitution=0.3")
    with running(*words, folder=tmp_path) as (url, _), opened(browser, url) as page:
        page.wait_for_selector("#metrics tr", timeout=UP_MS)
        page.locator("#order-pause").click()
        expect(page.locator("#state")).to_have_text("paused")
        with page.expect_download() as saved:
            page.locator("#report-json").click()
        told = json.loads(saved.value.path().read_text(encoding="utf-8"))
        with page.expect_download() as saved:
            page.locator("#report").click()
        assert saved.value.suggested_filename == "mb10_breaker-report.html"
        (tmp_path / "report.html").write_bytes(saved.value.path().read_bytes())
        shown = page.locator("#metrics tr").first.inner_text().split("\t")
        plots = page.locator(".plot:visible").count()
    tables = {table["title"]: table["rows"] for table in told["tables"]}
    assert ["tool.restitution", "0.35", "0.3"] in tables["Settings that differ from the machine as installed"]
    assert shown in tables["Numbers of the run"]
    made = datetime.strptime(told["made"], "%Y-%m-%d %H:%M UTC").replace(tzinfo=UTC)
    assert abs(datetime.now(UTC) - made) < timedelta(hours=1), "the zone of the time is told"
    assert told["versions"].startswith(f"mech_twin {__version__}, Python ")
    context = browser.new_context(viewport={"width": 800, "height": 1000}, offline=True)
    read = context.new_page()
    read.goto((tmp_path / "report.html").as_uri())
    pictures = read.locator("img")
    assert pictures.count() == plots + 1
    sizes = pictures.evaluate_all("(all) => all.map((each) => each.naturalWidth)")
    assert min(sizes) > 200
    expect(read.locator("body")).to_contain_text("tool.restitution")
    context.close()

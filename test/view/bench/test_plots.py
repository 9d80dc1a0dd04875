# SPDX-License-Identifier: Apache-2.0
"""Plots of a page: a drag zooms all of them, one cursor reads all of them, and each can be left out."""

from __future__ import annotations

import re

import numpy as np
import pytest
from browser import opened
from playwright.sync_api import expect

from mech_twin.view.bench.link import BenchLink
from mech_twin.view.bench.picture import Curves, Panel, packed_curves, packed_layout
from mech_twin.view.bench.started import StartedBench

pytestmark = [pytest.mark.browser, pytest.mark.slow]

LENGTH_S, PICTURE_S, ROW_S = 2.0, 0.01, 0.001
SPAN_S = 1.0  # of the page, unless told otherwise
NAMES = {"line": ("rising by three metres in a second", "falling by one"), "square": ("squared",)}
PANELS = [Panel("Lines, m", ("line",)), Panel("Square, m", ("square",))]
WINDOW = "() => window.bench.window()"


def machine(recording: str) -> dict:
    settings = [["tool.restitution", "0.35", "0.3"]] if recording == "first" else []
    told = {"name": "drawn_machine", "namespace": "", "orders": [], "parameters": []}
    return told | {"recording": recording, "settings": settings}


def picture(begin_s: float) -> dict:
    time_s = begin_s + ROW_S * np.arange(1, round(PICTURE_S / ROW_S) + 1)
    values = {"line": np.column_stack([3.0 * time_s, -time_s]), "square": np.column_stack([time_s**2])}
    curves = packed_curves(Curves(path, NAMES[path], time_s, found) for path, found in values.items())
    told = {"time_s": float(time_s[-1]), "sent_s": 0.0, "state": "running", "alarm": "", "command": None, "cards": []}
    return told | {"bounds": None, "shapes": None, "curves": curves, "events": [], "lanes": []}


@pytest.fixture
def page(browser):
    with StartedBench() as bench, BenchLink(bench.place, 5.0) as link:
        link.tell("machine", machine("first"))
        link.tell("layout", packed_layout(PANELS, NAMES))
        for place in range(round(LENGTH_S / PICTURE_S)):
            assert link.show(picture(PICTURE_S * place))
        with opened(browser, bench.url, shows=False) as found:
            found.link = link
            found.wait_for_function(f"() => window.bench.shown > {LENGTH_S - PICTURE_S / 2}")
            found.locator("#span").select_option("1")  # a recording is opened with the whole of it in sight
            chosen = f"([low, high]) => Math.abs(low - {LENGTH_S - SPAN_S}) < 0.01 && high > {LENGTH_S - 0.01}"
            found.wait_for_function(f"() => ({chosen})(window.bench.window())")  # both the span and its end
            yield found


def over(page, plot: int) -> dict:
    return page.locator(".u-over").nth(plot).bounding_box()


def point(page, share: float, plot: int = 0) -> None:
    box = over(page, plot)
    page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)


def read_off(page) -> tuple[float, list[float]]:
    """Return the cursor's time, and the values of all curves."""
    told = page.locator("#reading").inner_text()
    values = page.locator(".plot:has(.u-over) .legend b").all_inner_texts()
    return float(re.fullmatch(r"cursor t = ([\d.]+) s", told)[1]), [float(value) for value in values]


def check_values(page, expected_s: float, within_s: float) -> None:
    at_s, values = read_off(page)
    assert at_s == pytest.approx(expected_s, abs=within_s)
    assert values == pytest.approx([3.0 * at_s, -at_s, at_s**2], rel=2e-3)


def test_one_cursor_reads_every_curve_at_one_time(page):
    assert page.evaluate(WINDOW) == pytest.approx([LENGTH_S - SPAN_S, LENGTH_S])
    expect(page.locator("#reading")).to_have_text("")
    places = [over(page, plot) for plot in range(2)]
    point(page, 0.25)
    assert [over(page, plot) for plot in range(2)] == places, "a plot moves away under the mouse"
    check_values(page, LENGTH_S - SPAN_S + 0.25 * SPAN_S, 2.0 * SPAN_S / over(page, 0)["width"])
    point(page, 0.75, plot=1)
    check_values(page, LENGTH_S - SPAN_S + 0.75 * SPAN_S, 2.0 * SPAN_S / over(page, 1)["width"])
    lines = page.locator(".plot .u-over .reading")
    shares = [
        (lines.nth(i).bounding_box()["x"] - over(page, i)["x"]) / over(page, i)["width"] for i in range(lines.count())
    ]
    assert shares == pytest.approx([0.75, 0.75], abs=0.01)
    page.mouse.move(5, 5)
    expect(page.locator("#reading")).to_have_text("")
    expect(lines.first).to_be_hidden()


def test_a_drag_zooms_all_plots_the_picture_is_of_their_end_and_a_double_click_goes_back(page):
    box = over(page, 0)
    point(page, 0.2)
    page.mouse.down()
    point(page, 0.3)
    expect(page.locator(".band").first).to_be_visible()
    point(page, 0.6)
    page.mouse.up()
    wanted = [LENGTH_S - SPAN_S + share * SPAN_S for share in (0.2, 0.6)]
    page.wait_for_function("() => window.bench.window()[1] < 1.9")
    found = page.evaluate(WINDOW)
    assert found == pytest.approx(wanted, abs=3.0 * SPAN_S / box["width"])
    assert page.evaluate("() => window.bench.shown") == pytest.approx(found[1], abs=PICTURE_S)
    point(page, 0.5, plot=1)
    check_values(page, sum(found) / 2, 0.01)
    # what is left of the mouse stands at a click, and nothing is zoomed by it
    page.mouse.down()
    page.mouse.up()
    assert page.evaluate(WINDOW) == pytest.approx(found)
    page.locator(".u-over").first.dblclick()
    page.wait_for_function("() => window.bench.window()[1] > 1.99")
    assert page.evaluate(WINDOW) == pytest.approx([LENGTH_S - SPAN_S, LENGTH_S])


def test_cursor_and_zoom_are_reached_by_the_keyboard(page):
    page.locator(".plot:has(.u-over)").first.focus()
    page.keyboard.press("Home")
    check_values(page, LENGTH_S - SPAN_S, 1e-3)
    page.keyboard.press("ArrowRight")
    check_values(page, LENGTH_S - SPAN_S + 0.01 * SPAN_S, 1e-3)
    for _ in range(5):
        page.keyboard.press("Shift+ArrowRight")
    check_values(page, LENGTH_S - SPAN_S + 0.51 * SPAN_S, 1e-3)
    page.keyboard.press("+")
    page.wait_for_function("() => window.bench.window()[1] < 1.9")
    low, high = page.evaluate(WINDOW)
    assert high - low == pytest.approx(SPAN_S / 2)
    check_values(page, LENGTH_S - SPAN_S + 0.51 * SPAN_S, 1e-3)  # the cursor keeps its time
    page.keyboard.press("0")
    page.wait_for_function("() => window.bench.window()[1] > 1.99")
    page.keyboard.press("Escape")
    expect(page.locator("#reading")).to_have_text("")


def test_what_is_shown_of_a_recording_is_kept_with_it_and_its_settings_stand_there(page):
    expect(page.locator("#changed tr")).to_have_text("tool.restitution0.350.3")
    page.locator("#panels summary").click()
    page.get_by_label("Lines, m", exact=True).uncheck()
    plots = page.locator(".plot:has(.u-over)")
    expect(plots.first).to_be_hidden()
    expect(plots.nth(1)).to_be_visible()
    page.reload()
    expect(plots.nth(1)).to_be_visible()
    expect(plots.first).to_be_hidden()
    page.link.tell("machine", machine("second"))
    expect(plots.first).to_be_visible()
    expect(page.locator("#differs")).to_be_hidden()
    page.link.tell("machine", machine("first"))
    expect(plots.first).to_be_hidden()


def test_in_the_whole_of_a_recording_a_click_or_enter_goes_to_a_time_and_the_window_stays(page):
    page.locator("#span").select_option("whole")
    page.wait_for_function("() => window.bench.window()[0] < 0.05")
    whole = page.evaluate(WINDOW)
    assert whole == pytest.approx([PICTURE_S, LENGTH_S])
    point(page, 0.25)
    page.mouse.down()
    page.mouse.up()
    wanted_s = whole[0] + 0.25 * (whole[1] - whole[0])
    page.wait_for_function("() => window.bench.shown < 1.0")
    assert page.evaluate("() => window.bench.shown") == pytest.approx(wanted_s, abs=2 * PICTURE_S)
    assert page.evaluate(WINDOW) == pytest.approx(whole)
    mark = page.locator(".u-over .shown-at").first
    share = (mark.bounding_box()["x"] + 1 - over(page, 0)["x"]) / over(page, 0)["width"]
    assert share == pytest.approx(0.25, abs=0.01)
    page.mouse.move(5, 5)
    page.locator(".plot:has(.u-over)").first.focus()
    page.keyboard.press("End")
    page.keyboard.press("Enter")
    page.wait_for_function("() => window.bench.shown > 1.9")
    expect(mark).to_be_hidden()


def test_of_a_long_recording_the_extremes_are_drawn(page):
    """A peak of one row among a hundred thousand is on the page."""
    rows = 100_000
    time_s = LENGTH_S + 1e-5 * np.arange(1, rows + 1)
    spike = np.zeros((rows, 1))
    spike[rows // 3] = 77.0
    told = picture(LENGTH_S)
    told["time_s"] = float(time_s[-1])
    told["curves"] = packed_curves([Curves("square", NAMES["square"], time_s, spike)])
    assert page.link.show(told)
    page.locator("#span").select_option("whole")
    page.wait_for_function("() => window.bench.drawn(1).largest === 77")
    assert page.evaluate("() => window.bench.drawn(1).rows") <= 4001


def test_the_difference_of_two_runs_has_the_peaks_of_both(page):
    """A peak of the second run alone lies between the extremes of the first: it was not in A - B."""
    rows = 100_000
    time_s = 1e-5 * np.arange(1, rows + 1)
    first, second = np.zeros((rows, 1)), np.zeros((rows, 1))
    second[rows // 3] = -77.0
    page.link.tell("machine", machine("") | {"sides": ["one", "other"]})
    page.link.tell("anew", {})
    for side, values in ({}, first), ({"side": 1}, second):
        told = picture(LENGTH_S) | {"time_s": float(time_s[-1])} | side
        told["curves"] = packed_curves([Curves("square", NAMES["square"], time_s, values)])
        assert page.link.show(told)
    page.link.tell("comparison", {"settings": [], "numbers": [], "note": "A ends at 3 s, B at 2 s", "angle": None})
    page.locator("#how").select_option("difference")
    page.wait_for_function("() => window.bench.drawn(1).largest === 77")
    assert page.evaluate("() => window.bench.drawn(1).rows") <= 4001


def test_an_event_of_the_log_is_gone_to(page):
    told = picture(LENGTH_S)
    told["events"] = [[1.255, "t = 1.255 s: blow"]]
    assert page.link.show(told)
    page.locator("#events button").click()
    page.wait_for_function("() => Math.abs(window.bench.shown - 1.26) < 1e-6")


TICKS = [[0, 500, 1000], [1066.1, 1066.2, 1066.3], [10000, 10000.5, 10001], [-0.002, 0, 0.002], [2e6, 3e6]]
LABELS = [
    ["0", "500", "1000"],
    ["1066.1", "1066.2", "1066.3"],
    ["10k", "10.0005k", "10.001k"],
    ["-0.002", "0", "0.002"],
]


def test_the_ticks_of_an_axis_are_told_apart_and_rounding_is_no_curve(page):
    named = "async (every) => { const { labels } = await import('./plots.js'); return every.map(labels); }"
    told = page.evaluate(named, TICKS)
    assert told == [*LABELS, ["2M", "3M"]]
    ranges = "async (all) => { const { padded } = await import('./plots.js'); return all.map((one) => padded(...one)) }"
    flat, noise, apart = page.evaluate(ranges, [[1066.1, 1066.1002], [-4e-15, 1e-14], [1066.0, 1067.0]])
    assert flat == pytest.approx([1066.1 - 53.3, 1066.1 + 53.3], abs=0.1)
    assert noise == pytest.approx([-1e-3, 1e-3])
    assert apart == pytest.approx([1065.95, 1067.05])


# whether anything below the drawing stands out to the right of it
TIMELINE = """() => [...document.querySelectorAll("#timeline > *")].some((each) =>
  each.getBoundingClientRect().right > document.getElementById("picture").getBoundingClientRect().right)"""


@pytest.mark.parametrize("width", [1280, 1000, 900, 380])
def test_a_narrow_window_hides_nothing_to_its_right(page, width):
    told = picture(LENGTH_S)
    cards = [[name, "18.8 J", name, 18.8, "J", None] for name in ("blow rate", "last blow at 1.89 s", "pressing force")]
    assert page.link.show(told | {"cards": cards})
    page.set_viewport_size({"width": width, "height": 720})
    page.wait_for_function("() => document.documentElement.scrollWidth <= innerWidth")
    assert not page.evaluate(TIMELINE)


def test_the_header_says_that_a_run_is_over_though_no_picture_follows(page):
    expect(page.locator("#state")).to_have_text("running")
    page.link.tell("end", {"text": "the run is over"})
    expect(page.locator("#state")).to_have_text("over")
    expect(page.locator("#answers li").first).to_have_text("the run is over")


def test_a_long_run_keeps_its_beginning_and_extremes_in_thinned_rows(page):
    rows = """async () => {
        const { Curve } = await import(new URL("curves.js", document.querySelector("script[type=module]").src));
        const letters = (numbers) => Array.from(new Uint8Array(numbers.buffer), (byte) => String.fromCharCode(byte));
        const packed = (numbers) => btoa(letters(numbers).join(""));
        const curve = new Curve(2), count = 1000;
        for (let first = 0; first < 1500 * count; first += count) {
            const times = Float64Array.from({ length: count }, (_, k) => first + k);
            const values = Float32Array.from({ length: 2 * count }, (_, k) => (first + (k >> 1) === 1234 ? 9 : 1));
            curve.add(packed(times), packed(values));
        }
        const times = [...curve.times.subarray(0, curve.rows)];
        return { rows: curve.rows, first: times[0], last: times.at(-1), spike: curve.values[1][times.indexOf(1234)],
                 rises: times.every((time, k) => k === 0 || time > times[k - 1]) };
    }"""
    found = page.evaluate(rows)
    assert 200_000 < found.pop("rows") <= 401_000
    assert found == {"first": 0.0, "last": 1_499_999.0, "spike": 9.0, "rises": True}

# SPDX-License-Identifier: Apache-2.0
"""A person runs the breaker and opens the bench: it shows the run, and each control changes the machine."""

from __future__ import annotations

import re
import subprocess
from contextlib import ExitStack

import pytest
from browser import COMMAND, UP_MS, opened, running
from playwright.sync_api import expect

from mech_twin.cli.live_view import opened_view
from mech_twin.kernels.kernel import kernel

pytestmark = [pytest.mark.browser, pytest.mark.slow]

expect.set_options(timeout=20_000)  # a busy machine answers late, not differently
AA_TEXT, AA_SHAPE = 4.5, 3.0  # contrast that WCAG 2 asks of text, and of what has to be seen to understand
# the contrast of every visible text against the ground behind it, and of every legend's sample against white
CONTRAST = """() => {
  const parse = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const light = (rgb) => rgb.slice(0, 3).map((v) => v / 255)
    .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const ratio = (one, other) => {
    const [a, b] = [light(one), light(other)].sort((x, y) => y - x);
    return (a + 0.05) / (b + 0.05);
  };
  const ground = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const found = parse(getComputedStyle(at).backgroundColor);
      if (found.length < 4 || found[3] > 0.99) return found;
    }
    return [255, 255, 255];
  };
  return [...document.querySelectorAll("body *")]
    .filter((node) => node.offsetParent !== null)
    .filter((node) => [...node.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim()))
    .map((node) => [node.textContent.trim().slice(0, 40), ratio(parse(getComputedStyle(node).color), ground(node))]);
}"""
# the connection is lost, and what the page says meanwhile kept
CUT = """() => {
  const state = document.getElementById("state");
  window.states = [];
  new MutationObserver(() => window.states.push(state.textContent)).observe(state, { childList: true });
  window.bench.cut();
}"""
LEGENDS = """() => [...document.querySelectorAll(".plot:has(.u-over)")].map((plot) => {
  const legend = plot.querySelector(".legend");
  const data = plot.querySelector(".u-over").getBoundingClientRect(), key = legend.getBoundingClientRect();
  const colour = (item) => [...item.getContext("2d").getImageData(7, 4, 1, 1).data].slice(0, 3);
  return {
    title: plot.querySelector("h2").textContent,
    names: [...legend.querySelectorAll("li")].map((item) => item.textContent),
    colours: [...legend.querySelectorAll("canvas")].map(colour),
    over: key.top < data.bottom && key.bottom > data.top,
    cut: legend.scrollWidth > legend.clientWidth,
  };
})"""


# whether the last plot has curves: points of a legend's colour in its canvas
DRAWN = """() => {
  const plot = [...document.querySelectorAll(".plot:has(.u-over)")].at(-1);
  const colour = plot.querySelector(".legend canvas").getContext("2d").getImageData(7, 4, 1, 1).data;
  const canvas = plot.querySelector(".u-wrap canvas"), context = canvas.getContext("2d");
  const data = context.getImageData(0, 0, canvas.width, canvas.height).data;
  for (let at = 0; at < data.length; at += 4) {
    if (data[at + 3] > 200 && [0, 1, 2].every((part) => Math.abs(data[at + part] - colour[part]) < 12)) return true;
  }
  return false;
}"""
LANES = """() => [...document.querySelectorAll("#lane-words li")].map((item) => [
  item.textContent, [...item.querySelector("canvas").getContext("2d").getImageData(7, 4, 1, 1).data].slice(0, 3),
])"""


def share(page) -> float:
    """Return the share of rated speed that the page says is in force (%)."""
    return float(re.match(r"(\d+) % now", page.locator("#speed-now").inner_text() or "0 % now")[1])


def try_preload(page):
    """Move a slider without letting it go: the page tells what would come of it, and sends nothing."""
    row, answers = page.locator("[data-name='body.preload_deflection_m']"), page.locator("#answers li")
    sent = answers.count()
    row.locator("input[type=range]").evaluate("(it) => { it.value = 0.02; it.dispatchEvent(new Event('input')); }")
    expect(row.locator(".was")).to_contain_text("with 0.02: crank", timeout=60_000)
    assert answers.count() == sent


def change_restitution(page):
    """Send a value, and type or send a refused one meanwhile: the first stays, and undo takes it back."""
    number, first = page.locator("[data-name='tool.restitution'] input.number"), page.locator("#answers li").first
    for is_typed_only in (True, False):
        number.fill("0.5")
        number.press("Enter")
        number.fill("7")
        if is_typed_only:
            expect(first).to_have_text("tool.restitution = 0.5")
            page.wait_for_timeout(300)
            expect(number).to_have_value("7")
        number.press("Enter")
        expect(first).to_have_class("refused")
        expect(first).to_contain_text("tool.restitution")
        expect(number).to_have_value("0.5")
        page.locator("#undo").click()
        expect(first).to_have_text("tool.restitution = 0.35")
        expect(number).to_have_value("0.35")


def slow_down(page):
    """Set the speed by the mouse's event, and by a key that is held: the last value is in force."""
    speed, first = page.locator("#speed"), page.locator("#answers li").first
    speed.evaluate("(it) => { it.value = 0.55; it.dispatchEvent(new Event('change')); }")
    expect(first).to_have_text("speed 55% of rated")
    expect(page.locator("#speed-now")).to_have_text("55 % now")
    speed.focus()
    for _ in range(5):
        page.keyboard.press("ArrowLeft")
    expect(speed).to_be_focused()
    expect(first).to_have_text("speed 50% of rated")
    expect(page.locator("#speed-now")).to_have_text("50 % now")


def set_limit(page):
    """Set a limit of a headline number: what is above it is said there, and in the log of events."""
    most, outside = page.get_by_label("crank, at most"), page.locator("#cards .outside")
    expect(most).to_have_value("")
    expect(outside).to_have_count(0)
    most.fill("1")
    most.press("Enter")
    expect(outside).to_contain_text("above 1 rad/s")
    expect(page.locator("#events")).to_contain_text("crank above 1 rad/s")
    most.fill("")
    most.press("Enter")
    expect(outside).to_have_count(0)


def test_a_run_is_watched_and_commanded_from_its_page(browser, ros_domain, tmp_path):
    with running("run", "mb10_breaker", "--no-record", folder=tmp_path) as (url, _), opened(browser, url) as page:
        expect(page.locator("#machine")).to_have_text("mb10 breaker")
        expect(page.locator("#state")).to_have_text("running", timeout=UP_MS)
        answers = page.locator("#answers li")

        # the drawing moves, and header and picture say one time
        before = page.locator("#drawing").screenshot()
        page.wait_for_timeout(700)
        assert page.locator("#drawing").screenshot() != before
        told, shown = page.evaluate(
            "() => [document.getElementById('time').textContent, window.bench.shown.toFixed(2)]"
        )
        assert told == f"t = {shown} s"

        # speed
        slow_down(page)

        # a live parameter, its undo, and a value the machine refuses
        number = page.locator("[data-name='tool.wall_force_n'] input.number")
        number.fill("700")
        number.press("Enter")
        expect(answers.first).to_have_text("tool.wall_force_n = 700.0")
        expect(page.locator("[data-name='tool.wall_force_n'] .was")).to_have_text("was 500")
        page.locator("#undo").click()
        expect(answers.first).to_have_text("tool.wall_force_n = 500.0")
        expect(number).to_have_value("500")
        change_restitution(page)

        # a slider on its way: what would come of it, and nothing sent
        try_preload(page)

        set_limit(page)

        # pause, go on, stop, start, reset
        page.locator("#order-pause").click()
        expect(page.locator("#state")).to_have_text("paused")
        page.wait_for_timeout(300)
        still = page.evaluate("() => window.bench.shown")
        page.wait_for_timeout(700)
        assert page.evaluate("() => window.bench.shown") == still
        page.locator("#order-pause").click()
        page.wait_for_function(f"() => window.bench.shown > {still}")
        page.locator("#order-stop").click()
        expect(page.locator("#state")).to_have_text(re.compile("running down|stopped"), timeout=20_000)
        page.locator("#order-start").click()
        expect(page.locator("#state")).to_have_text("running", timeout=20_000)
        page.locator("#order-reset").click()
        expect(answers.first).to_contain_text("initial state")

        # time: halt, one picture back, follow
        page.locator("#drawing").focus()
        page.keyboard.press(",")
        halted = page.evaluate("() => window.bench.shown")
        page.wait_for_timeout(500)
        page.keyboard.press(",")
        page.wait_for_function(f"() => window.bench.shown < {halted}")
        page.keyboard.press("f")
        page.wait_for_function(f"() => window.bench.shown > {halted} + 0.2")


def change_and_look_anew(page):
    """Change a value here, and pause at the terminal: a page opened anew knows both."""
    number = page.locator("[data-name='tool.wall_force_n'] input.number")
    number.fill("700")
    number.press("Enter")
    expect(page.locator("#changed tr")).to_have_text(re.compile("^tool.wall_force_n500.0700.0$"))
    for order, word in (("pause", "Go on"), ("resume", "Pause")):
        subprocess.run([*COMMAND, "tell", "mb10_breaker", order], check=True, capture_output=True, timeout=60)
        expect(page.locator("#order-pause")).to_have_text(word)
        if order == "pause":
            expect(page.locator("#state")).to_have_text("paused")
            page.reload()
            expect(page.locator("#order-pause")).to_have_text(word)
            expect(number).to_have_value("700")
            expect(page.locator("#changed tr")).to_have_text(re.compile("^tool.wall_force_n500.0700.0$"))
    page.wait_for_function("() => window.bench.shown > 0.2", timeout=UP_MS)


def test_one_of_two_pages_commands_and_a_page_comes_back_after_its_connection_was_lost(browser, ros_domain, tmp_path):
    with running("run", "mb10_breaker", "--no-record", folder=tmp_path) as (url, _), opened(browser, url) as first:
        expect(first.locator("#role")).to_have_text("this page commands")
        with opened(browser, url) as second:
            expect(second.locator("#role")).to_have_text("another page commands, 2 pages")
            expect(second.locator("#order-stop")).to_be_disabled()
            second.locator("#take").click()
            expect(second.locator("#order-stop")).to_be_enabled()
            expect(first.locator("#order-stop")).to_be_disabled()
        expect(first.locator("#role")).to_have_text("nobody commands")
        first.evaluate(CUT)
        expect(first.locator("#role")).to_have_text("this page commands", timeout=20_000)
        assert "no connection" in first.evaluate("() => window.states")
        change_and_look_anew(first)
        before = first.evaluate("() => window.bench.shown")
        first.wait_for_function(f"() => window.bench.shown > {before}")


def test_the_page_is_legible_and_every_curve_named_in_a_colour_of_its_own(browser, ros_domain, tmp_path):
    with running("run", "roller_former", "--no-record", folder=tmp_path) as (url, _), opened(browser, url) as page:
        page.wait_for_selector("#metrics tr", timeout=UP_MS)
        faint = [(text, ratio) for text, ratio in page.evaluate(CONTRAST) if ratio < AA_TEXT]
        assert faint == []
        legends = page.evaluate(LEGENDS)
        assert len(legends) >= 4
        for plot in legends:
            assert plot["names"], plot["title"]
            assert len(plot["names"]) == len(plot["colours"])
            assert len({tuple(colour) for colour in plot["colours"]}) == len(plot["colours"]), plot["title"]
            assert not plot["over"], f"{plot['title']}: the legend lies on the data"
            assert not plot["cut"], plot["title"]
            for red, green, blue in plot["colours"]:
                assert contrast_to_white(red, green, blue) >= AA_SHAPE, (plot["title"], red, green, blue)
        lanes = page.evaluate(LANES)
        assert lanes and all(word for word, _ in lanes)
        assert len({tuple(colour) for _, colour in lanes}) == len(lanes)
        assert all(contrast_to_white(*colour) >= AA_SHAPE for _, colour in lanes)
        text = page.locator("body").inner_text()
        assert not re.search(r"\d\.?\d*e-\d\d", text.partition("Numbers of the run")[0])
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")


def contrast_to_white(*colour: int) -> float:
    """Return the contrast of a colour to white."""
    parts = [value / 255 for value in colour]
    linear = [part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 1.05 / (0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2] + 0.05)


def test_while_kernels_compile_the_page_says_so_from_the_first_second(browser):
    with ExitStack() as stack:
        view = opened_view("web", 0, stack, kernels=9999)
        with opened(browser, view.page, shows=False) as page:
            expect(page.locator("#status")).to_have_text("loading", timeout=1000)
            doubled = kernel(eval("lambda x: 2.0 * x"))  # of no file, so that it is never kept and always compiled
            assert doubled(1.0) == 2.0
            told = re.compile(r"compiling kernels for this processor, once: number \d+ of at most 9999 \(")
            expect(page.locator("#status")).to_have_text(told)
            expect(page.locator("#state")).to_have_text("starting")
            with opened(browser, view.page.partition("#")[0], shows=False) as other:
                expect(other.locator("#status")).to_contain_text("needs the whole address")


def shown_at(page) -> float:
    """Return where in the first plot the time shown is marked, as a share of its width."""
    mark, over = page.locator(".u-over .shown-at").first.bounding_box(), page.locator(".u-over").first.bounding_box()
    return (mark["x"] + mark["width"] / 2 - over["x"]) / over["width"]


def zoom_drawing(page) -> None:
    """Zoom the drawing by wheel and by key; a double click shows all of it again."""
    drawing = page.locator("#drawing")
    shown = drawing.screenshot()
    drawing.hover()
    page.mouse.wheel(0, -300)
    page.wait_for_timeout(300)
    near = drawing.screenshot()
    assert near != shown
    drawing.press("+")
    page.wait_for_timeout(300)
    assert drawing.screenshot() != near
    drawing.dblclick()
    page.mouse.move(5, 5)
    page.wait_for_timeout(300)
    drawing.blur()
    assert drawing.screenshot() == shown


def test_a_recording_is_played_scrubbed_and_has_no_commands(browser, ros_domain, tmp_path):
    made = [*COMMAND, "run", "vibration_crank", "--duration", "2", "--pace", "max", "--view", "none", "--record", "bag"]
    subprocess.run(made, check=True, capture_output=True, cwd=tmp_path)
    with running("view", "bag", folder=tmp_path) as (url, _), opened(browser, url, shows=False) as page:
        expect(page.locator("#command")).to_be_hidden()
        page.wait_for_function("() => Number(document.getElementById('cursor').max) > 1.9", timeout=UP_MS)
        # it is opened at its end, with the whole of it in the plots
        page.wait_for_function("() => window.bench.shown > 1.9999 && window.bench.window()[1] > 1.9999")
        assert page.evaluate("() => window.bench.window()[0]") < 0.1
        expect(page.locator("#span")).to_have_value("whole")
        expect(page.locator(".shown-at:visible")).to_have_count(0)
        page.locator("#cursor").evaluate("(it) => { it.value = 0.5; it.dispatchEvent(new Event('input')); }")
        page.wait_for_function("() => Math.abs(window.bench.shown - 0.5) < 0.05")
        assert page.evaluate("() => window.bench.window()[1]") > 1.9
        assert shown_at(page) == pytest.approx(0.25, abs=0.02)
        # a plot that is scrolled to is drawn, also where nothing moves
        last = page.locator(".plot .u-over").last
        last.scroll_into_view_if_needed()
        page.wait_for_function(DRAWN)
        zoom_drawing(page)
        page.locator("#pace").select_option("0.1")
        page.locator("#play").click()
        page.wait_for_timeout(2000)
        assert 0.55 < page.evaluate("() => window.bench.shown") < 0.9


def test_a_run_that_is_over_takes_no_command_also_from_a_page_opened_later(browser, ros_domain, tmp_path):
    words = ("run", "compaction_press", "--duration", "4", "--hold", "--no-record")
    with running(*words, folder=tmp_path) as (url, _):
        for _ in range(2):
            with opened(browser, url) as page:
                expect(page.locator("#state")).to_have_text("over")
                commands = page.locator("#command button, #command input, #keys input, #undo")
                assert commands.count() > 5
                for place in range(commands.count()):
                    expect(commands.nth(place)).to_be_disabled()

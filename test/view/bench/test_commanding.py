# SPDX-License-Identifier: Apache-2.0
"""A person commands from a page whose bench answers late, or not at all, as the test tells it to."""

from __future__ import annotations

import json
import re

import pytest
from browser import opened
from playwright.sync_api import expect

from mech_twin.view.bench.picture import Panel, packed_layout
from mech_twin.view.bench.started import StartedBench

pytestmark = [pytest.mark.browser, pytest.mark.slow]

EXPECTED = "expected a number such as 0.5 or 1200"
KEY, NAMES = "tool.restitution", {"line": ("rising",)}
PARAMETER = {"name": KEY, "value": 0.35, "unit": "", "low": 0.0, "high": 1.0, "meaning": "", "choices": []}
MACHINE = {"name": "told_machine", "namespace": "told", "orders": ["start", "stop", "speed", "pause", "step", "change"]}
ROLE = {"commands": True, "free": False, "pages": 1}
CARD = ["blow rate", "20.0/s", "blow rate", 20.0, "1/s", None]
FAULT = {
    "name": "worn_pin",
    "state": "active",
    "since_s": 3.0,
    "is_acknowledged": False,
    "shelved_until_s": None,
    "size": "",
}


def picture(time_s: float, command: float = 1.0) -> dict:
    told = {"time_s": time_s, "sent_s": 0.0, "state": "running", "alarm": "", "command": command, "cards": [CARD]}
    return told | {"bounds": None, "shapes": None, "curves": {}, "events": [], "lanes": []}


class Told:
    """The bench of a page: what the page asks, and what it is told."""

    def __init__(self, page) -> None:
        self.page, self.asked = page, []
        page.route_web_socket(re.compile("/feed$"), self._connected)

    def _connected(self, socket) -> None:
        self.socket = socket
        socket.on_message(self._heard)

    def _heard(self, text: str) -> None:
        if not text.startswith("{"):
            self.begin()  # the token
            return
        message = json.loads(text)
        if message["kind"] == "try" and not message["values"]:  # nothing is tried yet
            self.tell("ghost", values={}, from_s=2.0, to_s=2.3, curves={}, cards=[])
        elif message["kind"] in ("order", "try"):
            self.asked.append(message)

    def tell(self, kind: str, **content) -> None:
        self.socket.send(json.dumps({"kind": kind, **content}))

    def begin(self) -> None:
        self.tell("machine", **MACHINE, parameters=[PARAMETER], settings=[])
        self.tell("layout", **packed_layout([Panel("Line, m", ("line",))], NAMES))
        self.tell("role", **ROLE)
        self.tell("pictures", list=[picture(1.0), picture(2.0, 0.5)])

    def await_asked(self, number: int) -> dict:
        for _ in range(100):
            if len(self.asked) >= number:
                return self.asked[number - 1]
            self.page.wait_for_timeout(50)
        raise AssertionError(self.asked)


@pytest.fixture(scope="module")
def bench():
    with StartedBench() as found:  # it hands out the page alone: what it would be told goes to the test
        yield found


@pytest.fixture
def told(browser, bench):
    with opened(browser, "about:blank", shows=False) as page:
        found = Told(page)
        page.goto(bench.url)
        page.wait_for_function("() => window.bench.shown === 2")
        yield found


@pytest.mark.parametrize(("text", "value"), [("0,5", 0.5), (".25", 0.25), ("2e-1", 0.2), ("1,", 1)])
def test_a_number_is_read_with_a_decimal_point_or_a_comma(told, text, value):
    """A number box of another language drops the comma: 0,5 was 05."""
    box = told.page.get_by_label(f"{KEY}, number")
    box.fill("")
    box.press_sequentially(text)
    box.press("Enter")
    assert told.await_asked(1)["values"] == {KEY: value}


@pytest.mark.parametrize("text", ["1e", "half", "1,000", "1.000,5", "0x1", "1e400"])
def test_what_is_no_number_is_refused_by_its_text_and_what_stood_there_stays(told, text):
    page = told.page
    most = page.get_by_label("blow rate, at most")
    most.fill("2,5")
    most.press("Enter")
    for name, box, stays in ((KEY, page.get_by_label(f"{KEY}, number"), "0.35"), ("blow rate, at most", most, "2.5")):
        box.fill("")
        box.press_sequentially(text)
        box.press("Enter")
        expect(page.locator("#answers li.refused").first).to_have_text(f"{name}: {text}: {EXPECTED}")
        expect(box).to_have_value(stays)
    expect(page.locator("#cards .outside")).to_contain_text("above 2.5 1/s")
    assert told.asked == []


def test_undo_takes_back_the_last_change_also_before_it_is_answered(told):
    box, undo = told.page.get_by_label(f"{KEY}, number"), told.page.locator("#undo")

    def answered(number: int) -> dict:
        asked = told.await_asked(number)
        told.tell("answer", id=asked["id"], text="", is_done=True)
        return asked["values"]

    for number, value in ((1, "0.5"), (2, "0.6")):
        box.fill(value)
        box.press("Enter")
        if number == 1:
            answered(1)
    expect(undo).to_be_enabled()
    for _ in range(5):  # more than there are changes
        undo.click()
    assert [answered(number) for number in (2, 3, 4)] == [{KEY: 0.6}, {KEY: 0.5}, {KEY: 0.35}]
    expect(box).to_have_value("0.35")
    expect(undo).to_be_disabled()
    box.fill("0.4")
    box.press("Enter")
    assert answered(5) == {KEY: 0.4}
    told.page.wait_for_timeout(300)
    assert len(told.asked) == 5


def test_the_speed_control_shows_the_present_beside_an_earlier_picture(told):
    """A key moved it from the speed of the time shown, which the machine had left."""
    page = told.page
    page.locator("#cursor").evaluate("(it) => { it.value = 1; it.dispatchEvent(new Event('input')); }")
    page.wait_for_function("() => window.bench.shown === 1")
    expect(page.locator("#speed-now")).to_have_text("50 % now")
    page.locator("#speed").press("ArrowRight")
    assert told.await_asked(1)["values"] == {"share": 0.51}


def test_after_a_lost_connection_the_page_knows_the_run_that_is_there_now_alone(told):
    page = told.page
    told.tell("pause", is_paused=True)
    told.tell("metrics", rows=[["blows", "3", ""]])
    box = page.get_by_label(f"{KEY}, number")
    box.fill("0.5")
    box.press("Enter")
    told.tell("answer", id=told.await_asked(1)["id"], is_done=True, text="done")
    expect(page.locator("#undo")).to_be_enabled()
    expect(page.locator("#state")).to_have_text("paused")
    told.socket.close()
    expect(page.locator("#state")).to_have_text("no connection")
    page.set_viewport_size({"width": 900, "height": 700})  # drawn anew
    page.wait_for_timeout(300)
    expect(page.locator("#state")).to_have_text("no connection")
    expect(page.locator("#state")).to_have_text("running")
    expect(page.locator("#order-pause")).to_have_text("Pause")
    expect(page.locator("#undo")).to_be_disabled()
    expect(page.locator("#numbers")).to_be_hidden()
    expect(box).to_have_value("0.35")


def test_what_the_run_before_did_not_answer_holds_back_no_command_of_the_next(told):
    page = told.page
    box, speed = page.get_by_label(f"{KEY}, number"), page.locator("#speed")
    for number in (1, 3):
        box.fill("0.5")
        box.press("Enter")
        assert told.await_asked(number)["values"] == {KEY: 0.5}
        speed.press("ArrowRight")
        assert told.await_asked(number + 1)["values"] == {"share": 0.51}
        if number == 1:
            late = [each["id"] for each in told.asked]
            told.tell("anew", all=True)
            told.begin()
            expect(box).to_have_value("0.35")
            for each in late:
                told.tell("answer", id=each, is_done=True, text="late")
            expect(page.locator("#answers li").first).to_have_text("late")
            expect(box).to_have_value("0.35")
            expect(page.locator("#undo")).to_be_disabled()


def drag(slider, to: float) -> None:
    """Move a slider without letting it go."""
    slider.evaluate("(it, to) => { it.value = to; it.dispatchEvent(new Event('input', { bubbles: true })); }", to)


def test_a_trial_that_is_answered_after_its_value_was_sent_tells_nothing(told):
    slider, was = told.page.get_by_label(f"{KEY}, slider"), told.page.locator(".was")
    drag(slider, 0.5)
    assert told.await_asked(1)["kind"] == "try"
    slider.dispatch_event("change")
    told.tell("answer", id=told.await_asked(2)["id"], is_done=True, text="done")
    expect(was).to_have_text("was 0.35")
    told.tell("ghost", values={KEY: 0.5}, from_s=2.0, to_s=2.3, curves={}, cards=[["blow rate", "1/s"]])
    drag(slider, 0.6)
    assert told.await_asked(3)["values"] == {KEY: 0.6}
    expect(was).to_have_text("was 0.35")


def test_a_trial_that_is_never_answered_as_another_page_commands_holds_back_none_later(told):
    slider = told.page.get_by_label(f"{KEY}, slider")
    drag(slider, 0.5)
    told.await_asked(1)
    for commands in (False, True):
        told.tell("role", **(ROLE | {"commands": commands}))
        expect(slider).to_be_enabled(enabled=commands)
    drag(slider, 0.6)
    assert told.await_asked(2)["values"] == {KEY: 0.6}
    # the bench drops what is asked while it computes; the answer to 0.5 is not that to 0.6
    told.tell("ghost", values={KEY: 0.5}, from_s=2.0, to_s=2.3, curves={}, cards=[["blow rate", "1/s"]])
    assert told.await_asked(3)["values"] == {KEY: 0.6}
    told.tell("ghost", values={KEY: 0.6}, from_s=2.0, to_s=2.3, curves={}, cards=[["blow rate", "2/s"]])
    expect(told.page.locator(".was")).to_have_text("with 0.6: blow rate 2/s")


def test_keys_of_time_work_also_where_a_button_or_the_time_was_just_used(told):
    page = told.page
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_text("Halt")
    page.keyboard.press("k")
    expect(page.locator("#play")).to_have_text("Play")
    page.locator("#cursor").focus()
    page.keyboard.press("f")
    expect(page.locator("#follow")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press(",")
    page.wait_for_function("() => window.bench.shown === 1")


def test_two_runs_that_have_no_common_angle_are_compared_at_equal_time(told):
    page = told.page
    times = ["AAAAAAAAAAAAAAAAAADwPw=="] * 2  # 0 and 1 s
    told.tell("comparison", settings=[], numbers=[], note="", angle=times)
    page.locator("#align").select_option("angle")
    told.tell("comparison", settings=[], numbers=[], note="A ends at 3 s, B at 2 s", angle=None)
    expect(page.locator("#align")).to_be_disabled()
    expect(page.locator("#align")).to_have_value("time")
    expect(page.locator("#equal")).to_have_text("0 of 0 numbers are equal. A ends at 3 s, B at 2 s")


def test_a_page_that_drops_the_beginning_of_a_run_says_so_once(told):
    drawn = {"kinds": "", "colours": [], "widths": [], "texts": [], "counts": [0] * 500_000, "points": ""}
    for number in range(9):
        told.tell("pictures", list=[picture(3.0 + number) | {"shapes": drawn}])
    told.page.wait_for_function("() => window.bench.shown === 11", timeout=60_000)
    cut = "This page keeps 200 MB of pictures: the oldest are no longer here."
    expect(told.page.locator("#answers li")).to_have_text([cut])
    assert float(told.page.locator("#cursor").get_attribute("min")) > 3.0


def test_a_fault_that_changes_keeps_its_buttons(told):
    page = told.page
    told.tell("machine", **(MACHINE | {"orders": ["acknowledge", "shelve"]}), parameters=[], settings=[])
    told.tell("alarms", faults=[FAULT | {"size": "wear 1 mm"}])
    button = page.get_by_role("button", name="Acknowledge")
    button.focus()
    told.tell("alarms", faults=[FAULT | {"size": "wear 2 mm"}])
    expect(page.locator(".fault")).to_contain_text("wear 2 mm")
    expect(button).to_be_focused()
    told.tell("alarms", faults=[FAULT | {"name": "loose"}, FAULT | {"size": "wear 3 mm", "is_acknowledged": True}])
    expect(page.locator(".fault").nth(1).get_by_role("button", name="Acknowledge")).to_be_disabled()
    expect(page.locator(".fault").first.get_by_role("button", name="Acknowledge")).to_be_enabled()
    told.tell("alarms", faults=[])
    expect(page.locator("#faults")).to_have_text("no fault")

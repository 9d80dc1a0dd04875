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
            self.tell("ghost", from_s=2.0, to_s=2.3, curves={}, cards=[])
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


@pytest.fixture
def told(browser):
    with StartedBench() as bench, opened(browser, "about:blank", shows=False) as page:
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


@pytest.mark.parametrize("text", ["1e", "half", "1,000", "1.000,5", "0x1"])
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

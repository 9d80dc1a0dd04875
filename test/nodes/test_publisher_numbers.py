# SPDX-License-Identifier: Apache-2.0
"""Whose a message is, by the numbers the middleware gives each publisher's messages: the laws, without ROS."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mech_twin.nodes.exchange.direct_exchange import SOURCES, PublisherNumbers

SILENCE_S = 0.5
MOTOR = 17.0


class Topic:
    """A topic with a clock that stands, and whether one publishes alone."""

    def __init__(self) -> None:
        self.now_s, self.alone = 0.0, False
        self.numbers = PublisherNumbers(SILENCE_S, lambda: self.now_s)

    def own(self, number: int | None, source: float = MOTOR) -> bool:
        return self.numbers.is_own(source, number, lambda: self.alone)


@given(st.integers(1, 10**9), st.lists(st.tuples(st.booleans(), st.integers(1, 10**9)), max_size=60))
def test_a_copy_is_believed_only_where_its_number_is_the_next(first: int, heard: list[tuple[bool, int]]) -> None:
    topic, newest = Topic(), first
    assert topic.own(first)
    for copied, number in heard:
        if copied and number != newest + 1:
            assert not topic.own(number)
        elif not copied:
            newest += 1
            assert topic.own(newest)


def test_a_gap_is_a_loss_where_one_publishes_alone_and_a_copy_where_another_does() -> None:
    topic = Topic()
    assert topic.own(1)
    assert not topic.own(5)
    topic.alone = True
    assert topic.own(5)
    topic.alone = False
    assert topic.own(6)


def test_after_a_silence_another_number_of_the_source_is_followed() -> None:
    topic = Topic()
    assert topic.own(100)
    topic.now_s = SILENCE_S
    assert not topic.own(103), "a copy does not end the silence"
    topic.now_s = SILENCE_S + 0.1
    assert topic.own(103)
    assert not topic.own(101)


def test_each_source_has_numbers_of_its_own() -> None:
    topic = Topic()
    assert topic.own(100) and topic.own(1, MOTOR + 1.0) and topic.own(101) and topic.own(2, MOTOR + 1.0)


def test_a_middleware_that_gives_no_numbers_is_believed() -> None:
    topic = Topic()
    assert topic.own(1) and topic.own(None) and topic.own(2)


def test_of_many_sources_the_newest_are_remembered() -> None:
    topic = Topic()
    for other in range(1, 10 * SOURCES):
        topic.own(1, MOTOR + other)
    assert len(topic.numbers._newest) == SOURCES

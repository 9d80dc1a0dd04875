# SPDX-License-Identifier: Apache-2.0
"""A missing answer is asked for again, and its peer counts as gone after the timeout: without ROS, without a clock."""

from __future__ import annotations

import pytest

from mech_twin.nodes.exchange.peers import ASK_AGAIN_S, ASK_AGAIN_WAITING_S, PeerWait

TIMEOUT_S = 0.5


def test_nothing_is_asked_again_before_its_time() -> None:
    wait = PeerWait(TIMEOUT_S, 0.0)
    assert not wait.due(ASK_AGAIN_S)
    assert wait.due(ASK_AGAIN_S + 1e-6)
    assert not wait.ask(0.4)
    assert not wait.due(0.4 + 0.99 * ASK_AGAIN_S)


def test_a_wait_begins_once_after_the_timeout_and_then_asks_more_often() -> None:
    wait = PeerWait(TIMEOUT_S, 0.0)
    assert not wait.ask(TIMEOUT_S)
    assert not wait.waiting
    assert wait.ask(0.6)
    assert wait.waiting
    assert not wait.ask(0.8)
    assert wait.count == 1
    assert wait.due(0.8 + ASK_AGAIN_WAITING_S + 1e-6)


def test_a_step_ends_the_wait_and_what_was_waited_adds_up() -> None:
    wait = PeerWait(TIMEOUT_S, 0.0)
    wait.ask(1.0)
    assert wait.total_s(3.0) == pytest.approx(2.0)
    wait.stepped(4.0)
    assert not wait.waiting
    assert wait.total_s(100.0) == pytest.approx(3.0)
    wait.ask(5.0)
    wait.stepped(5.5)
    assert (wait.count, wait.total_s(6.0)) == (2, pytest.approx(3.5))


def test_time_this_process_stood_still_is_no_silence_of_a_peer() -> None:
    wait = PeerWait(TIMEOUT_S, 0.0)
    wait.resumed(60.0)
    assert not wait.ask(60.0 + TIMEOUT_S)
    assert wait.silence_s(61.0) == 1.0

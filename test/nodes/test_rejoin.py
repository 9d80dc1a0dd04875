# SPDX-License-Identifier: Apache-2.0
"""A starting linkage asks its peers where the run is, for as long as somebody may know.  No ROS, no clock."""

from __future__ import annotations

from mech_twin.nodes.roles.linkage_topics import ASK_AGAIN_S, NOBODY_LIMIT_S, RejoinRequest
from mech_twin.samples import LinkageSample, Named

LAST = LinkageSample(7, 0.007, ("crank",), (0.0,), (0.0,), (0.0,), 0, 1.0, Named(), Named())


def test_it_asks_at_once_and_again_after_a_while() -> None:
    request = RejoinRequest(10.0)
    assert request.due(0.0)
    assert not request.due(ASK_AGAIN_S)
    assert request.due(1.01 * ASK_AGAIN_S)
    assert not request.due(1.5 * ASK_AGAIN_S)


def test_both_answers_settle_it_and_one_does_not() -> None:
    request = RejoinRequest(10.0)
    assert not request.settled(0.0, True)
    request.answer("linkage", LAST)
    assert not request.settled(0.1, True)
    request.answer("description", None)
    assert request.settled(0.2, True)
    assert request.answers["linkage"] == LAST


def test_where_nobody_answers_it_gives_up_soon_and_where_somebody_could_later() -> None:
    alone, among_peers = RejoinRequest(10.0), RejoinRequest(10.0)
    for request, peers in ((alone, False), (among_peers, True)):
        assert not request.settled(0.0, peers)
    later = NOBODY_LIMIT_S + 0.1
    assert alone.settled(later, False)
    assert not among_peers.settled(later, True)
    assert among_peers.settled(10.1, True)


def test_answers_after_the_beginning_change_nothing() -> None:
    request = RejoinRequest(10.0)
    request.open = False
    request.answer("linkage", LAST)
    assert request.answers == {}

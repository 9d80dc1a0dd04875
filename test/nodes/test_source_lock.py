# SPDX-License-Identifier: Apache-2.0
"""One publisher is followed at a time: the laws of the source lock, without ROS."""

from __future__ import annotations

from mech_twin.messages.step_message import ANONYMOUS
from mech_twin.nodes.exchange.peers import SOURCE_BITS, Admission, HeardSource, SourceLock, new_source


def test_the_first_source_is_followed_and_a_second_is_refused_while_it_is_there() -> None:
    lock = SourceLock()
    assert not lock.locked
    assert lock.admit(7.0, vacant=True) is Admission.NEWLY_FOLLOWED
    assert lock.admit(7.0, vacant=False) is Admission.FOLLOWED
    assert lock.admit(8.0, vacant=False) is Admission.REFUSED
    assert lock.source == 7.0


def test_a_vacant_place_is_taken_and_the_former_source_is_then_a_stranger() -> None:
    lock = SourceLock()
    lock.admit(7.0, vacant=True)
    assert lock.admit(8.0, vacant=True) is Admission.NEWLY_FOLLOWED
    assert lock.admit(7.0, vacant=False) is Admission.REFUSED


def test_nobody_is_followed_where_the_place_is_not_vacant() -> None:
    lock = SourceLock()
    assert lock.admit(ANONYMOUS, vacant=False) is Admission.REFUSED
    assert not lock.locked


def test_a_source_that_is_not_a_number_is_never_followed_on() -> None:
    lock = SourceLock()
    lock.admit(float("nan"), vacant=True)
    assert lock.admit(float("nan"), vacant=False) is Admission.REFUSED


def test_a_new_source_is_exact_in_a_float64_and_not_anonymous() -> None:
    drawn = {new_source() for _ in range(1000)}
    assert len(drawn) == 1000
    assert all(source == int(source) and 0.0 < source <= 2.0**SOURCE_BITS for source in drawn)
    assert ANONYMOUS not in drawn


def test_a_listener_follows_who_signs_until_it_has_fallen_silent() -> None:
    now_s = [0.0]
    heard = HeardSource(1.0, lambda: now_s[0])
    assert heard.admit(7.0, lambda: False) is Admission.NEWLY_FOLLOWED
    now_s[0] = 0.9
    assert heard.admit(8.0, lambda: False) is Admission.REFUSED
    assert heard.admit(7.0, lambda: False) is Admission.FOLLOWED
    now_s[0] = 1.8  # a stranger's messages do not keep the place
    assert heard.admit(8.0, lambda: False) is Admission.REFUSED
    now_s[0] = 2.0
    assert heard.admit(8.0, lambda: False) is Admission.NEWLY_FOLLOWED


def test_a_listener_follows_who_does_not_sign_only_where_it_is_alone_and_nobody_signs() -> None:
    heard = HeardSource(1.0, lambda: 0.0)
    assert heard.admit(ANONYMOUS, lambda: False) is Admission.REFUSED
    assert heard.admit(ANONYMOUS, lambda: True) is Admission.NEWLY_FOLLOWED
    assert heard.admit(7.0, lambda: False) is Admission.NEWLY_FOLLOWED
    assert heard.admit(ANONYMOUS, lambda: True) is Admission.REFUSED

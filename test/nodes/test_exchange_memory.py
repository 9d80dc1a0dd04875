# SPDX-License-Identifier: Apache-2.0
"""A step asked again is answered with the same sample, and who goes back is followed back.  Without ROS."""

from __future__ import annotations

from mech_twin.nodes.roles.follower_node import REMEMBERED_STEPS, ExchangeMemory


def filled(last: int) -> ExchangeMemory[str, str]:
    memory: ExchangeMemory[str, str] = ExchangeMemory()
    for step in range(last + 1):
        memory.remember(step, f"q{step}", f"a{step}")
    return memory


def test_the_newest_few_are_kept() -> None:
    memory = filled(10)
    assert memory.last_step == 10
    kept = [step for step in range(11) if memory.get(step) is not None]
    assert kept == list(range(11 - REMEMBERED_STEPS, 11))


def test_going_back_forgets_what_came_after() -> None:
    memory = filled(10)
    memory.return_to(9)
    assert memory.last_step == 9
    exchange = memory.get(9)
    assert exchange is not None
    assert exchange.answer == "a9"


def test_who_begins_anew_finds_nothing_of_the_run_before() -> None:
    memory = filled(10)
    memory.return_to(0)
    assert memory.last_step is None


def test_who_goes_on_finds_everything() -> None:
    memory = filled(10)
    memory.return_to(11)
    assert memory.last_step == 10

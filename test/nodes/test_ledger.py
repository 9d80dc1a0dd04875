"""Nothing is lost silently: the laws of the loss counters, without ROS."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.nodes.ledger import Ledger, Sequence


@given(st.lists(st.integers(0, 50), min_size=1))
def test_every_step_is_either_accepted_or_counted(steps: list[int]) -> None:
    ledger = Ledger()
    sequence = Sequence("topic", ledger)
    accepted = [step for step in steps if sequence.accepts(step)]
    refused = ledger.total["topic", "repeated"] + ledger.total["topic", "late"]
    assert len(accepted) + refused == len(steps)
    assert accepted == sorted(set(accepted))
    assert ledger.total["topic", "missing"] == accepted[-1] - accepted[0] + 1 - len(accepted)


def test_a_window_reports_each_topic_once_and_then_forgets() -> None:
    ledger = Ledger()
    ledger.count("a", "late", "step 3 after 4", 2)
    ledger.count("a", "malformed", "a position is not finite")
    ledger.count("b", "foreign")
    reports = ledger.close_window()
    assert [report.topic for report in reports] == ["a", "b"]
    assert reports[0].counts == {"late": 2, "malformed": 1}
    assert reports[0].last_reason == "a position is not finite"
    assert ledger.close_window() == []
    assert ledger.totals() == {"a: late": 2, "a: malformed": 1, "b: foreign": 1}


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="vanished"):
        Ledger().count("a", "vanished")

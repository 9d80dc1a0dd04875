"""Nothing is lost silently: the laws of the loss counters, without ROS."""

from __future__ import annotations

import pytest

from mech_twin.nodes.ledger import Ledger


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

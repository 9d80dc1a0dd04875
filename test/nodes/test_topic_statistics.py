# SPDX-License-Identifier: Apache-2.0
"""Nothing is lost silently: the laws of the loss counters, without ROS."""

from __future__ import annotations

import pytest

from mech_twin.nodes.exchange.counting import TopicStatistics


def test_a_window_reports_each_topic_once_and_then_forgets() -> None:
    statistics = TopicStatistics()
    statistics.count("a", "late", "step 3 after 4", 2)
    statistics.count("a", "malformed", "a position is not finite")
    statistics.count("b", "unknown_source")
    reports = statistics.close_window()
    assert [report.topic for report in reports] == ["a", "b"]
    assert reports[0].counts == {"late": 2, "malformed": 1}
    assert reports[0].last_reason == "a position is not finite"
    assert statistics.close_window() == []
    assert statistics.totals() == {"a: late": 2, "a: malformed": 1, "b: unknown_source": 1}


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="vanished"):
        TopicStatistics().count("a", "vanished")

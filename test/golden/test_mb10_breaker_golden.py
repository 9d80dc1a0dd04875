# SPDX-License-Identifier: Apache-2.0
"""Golden values of the breaker: our own earlier report, steady figures and blows.

A change that moves them on purpose rewrites them: ``python test/golden/test_mb10_breaker_golden.py``.
"""

import json
from pathlib import Path

import pytest

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine

STORE = Path(__file__).with_name("mb10_breaker.json")
DURATION_S = 2.0


def figures():
    """Return report, running figures of two seconds, and time (s) and impulse (N s) of its events."""
    twin = machine("mb10_breaker")
    observer, events = twin.observer(), []
    for frame in frames(twin, DURATION_S):
        observer.observe(frame)
        events += [[event.kind, event.time_s, event.impulse_ns] for event in frame.linkage.events]
    return {"report": twin.report(), "run": observer.numbers(), "events": events}


def test_figures_are_those_of_before():
    stored, found = json.loads(STORE.read_text(encoding="utf-8")), figures()
    for part in ("report", "run"):
        assert found[part].keys() == stored[part].keys()
        for key, value in stored[part].items():
            assert found[part][key] == pytest.approx(value, rel=1e-9, abs=1e-8, nan_ok=True), (part, key)
    assert [row[0] for row in found["events"]] == [row[0] for row in stored["events"]]
    for old, new in zip(stored["events"], found["events"], strict=True):
        assert new[1:] == pytest.approx(old[1:], rel=1e-9, abs=1e-9), old


if __name__ == "__main__":
    STORE.write_text(json.dumps(figures(), indent=1) + "\n", encoding="utf-8")

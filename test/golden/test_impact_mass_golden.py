# SPDX-License-Identifier: Apache-2.0
"""Our own earlier numbers: first blow of each period for the cases of figs. 2, 3a and 3b."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine

GOLDEN = json.loads((Path(__file__).parent / "impact_mass.json").read_text(encoding="utf-8"))


def firsts(t1: float, duration_s: float) -> list[list[float]]:
    """Return [period, time, speed before] of the first blow of each period."""
    found: dict[int, list[float]] = {}
    for frame in frames(machine("impact_mass", overrides={"phase1_duration_s": t1}), duration_s):
        for event in frame.linkage.events:
            if event.kind == "impact":
                found.setdefault(event.period, [event.period, event.time_s, event.pre_velocity_m_per_s])
    return list(found.values())


@pytest.mark.parametrize("t1", sorted(GOLDEN))
def test_first_blows_are_those_of_before(t1):
    case = GOLDEN[t1]
    ours = firsts(float(t1), case["duration_s"])
    assert len(ours) == len(case["blows"])
    for mine, before in zip(ours, case["blows"], strict=True):
        assert mine == pytest.approx(before, rel=1e-10)

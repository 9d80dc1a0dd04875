# SPDX-License-Identifier: Apache-2.0
"""The roller former's carts, one to four, over topics: the one-process run to the bit; a stall is seen from outside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from roller_former_cases import machine_for, parameters_for
from step_samples import assert_equal_engine, recorded_samples

from mech_twin.engine.run import frames
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.run.composition import run_in_process

NAME = "roller_former"


def record_over_topics(carts: int, overrides: dict[str, Any], duration_s: float, bag: Path) -> None:
    options = RunOptions(pace="max", duration_s=duration_s, recorder=True, exclusive=False)
    run_in_process(NAME, parameters_for(carts, overrides), options, bag, None)


@pytest.mark.parametrize("carts", [1, 2, 3, 4])
def test_topics_equal_engine_to_the_bit(carts: int, ros_domain: int, tmp_path: Path) -> None:
    at_speed = {"start.speed_fraction": 0.85, "start.load_rise_s": 0.05}  # so that the load comes on within the run
    steps = frames(machine_for(carts, at_speed), 0.2)
    assert any(event.kind == "load_engaged" for frame in steps for event in frame.linkage.events)
    record_over_topics(carts, at_speed, 0.2, tmp_path / "bag")
    assert_equal_engine(tmp_path / "bag", machine_for(carts, at_speed), 0.2)


def test_a_stall_is_seen_on_the_topics(ros_domain: int, tmp_path: Path) -> None:
    loaded = {"start.load_from_fraction": 0.0, "stall.time_s": 0.2}
    record_over_topics(2, loaded, 0.3, tmp_path / "bag")
    samples = recorded_samples(NAME, tmp_path / "bag")["step/linkage"]
    seen = [event for sample in samples for event in sample.events if event.kind == "stall"]
    assert [event.time_s for event in seen] == [pytest.approx(0.2, abs=1e-12)]
    assert machine_for(2).linkage.regimes[samples[-1].regime] == "stalled"

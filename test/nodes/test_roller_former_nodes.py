# SPDX-License-Identifier: Apache-2.0
"""The roller former's carts, one to four, over topics: the one-process run to the bit; a stall is seen from outside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import deserialize_message
from roller_former_cases import machine_for, parameters_for
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.topics import full_name, step_topics
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.roles.viewer_node import DECODERS
from mech_twin.nodes.run.composition import run_in_process
from mech_twin.recording.bag_reader import BagReader

NAME = "roller_former"
PARTS = {"step/linkage": "linkage", "step/motor": "motor", "step/forces": "forces"}


def recorded(bag: Path) -> dict[str, list[Any]]:
    with BagReader(bag) as reader:
        return {
            topic.name: [
                DECODERS[topic.name](deserialize_message(row.raw, JointState))
                for row in reader.messages(topics=[full_name(NAME, topic)])
            ]
            for topic in step_topics(False)
        }


def over_topics(carts: int, overrides: dict[str, Any], duration_s: float, bag: Path) -> dict[str, list[Any]]:
    options = RunOptions(pace="max", duration_s=duration_s, recorder=True, exclusive=False)
    run_in_process(NAME, parameters_for(carts, overrides), options, bag, None)
    return recorded(bag)


@pytest.mark.parametrize("carts", [1, 2, 3, 4])
def test_topics_equal_engine_to_the_bit(carts: int, ros_domain: int, tmp_path: Path) -> None:
    at_speed = {"start.speed_fraction": 0.85, "start.load_rise_s": 0.05}  # so that the load comes on within the run
    expected = list(frames(machine_for(carts, at_speed), 0.2))
    assert any(event.kind == "load_engaged" for frame in expected for event in frame.linkage.events)
    for topic, samples in over_topics(carts, at_speed, 0.2, tmp_path / "bag").items():
        assert sorted({sample.step for sample in samples}) == list(range(len(expected))), topic
        for sample in samples:  # one that was asked again, when the machine stalled, stands there twice
            assert sample == getattr(expected[sample.step], PARTS[topic]), topic


def test_a_stall_is_seen_on_the_topics(ros_domain: int, tmp_path: Path) -> None:
    loaded = {"start.load_from_fraction": 0.0, "stall.time_s": 0.2}
    samples = over_topics(2, loaded, 0.3, tmp_path / "bag")["step/linkage"]
    seen = [event for sample in samples for event in sample.events if event.kind == "stall"]
    assert [event.time_s for event in seen] == [pytest.approx(0.2, abs=1e-12)]
    assert machine_for(2).linkage.regimes[samples[-1].regime] == "stalled"

# SPDX-License-Identifier: Apache-2.0
"""A run over topics is the one-process run, to the bit, through real DDS and a real recording."""

from __future__ import annotations

from pathlib import Path

import pytest
from catalogue import NAMES, built
from step_samples import PARTS, recorded_samples

from mech_twin.engine.run import frames
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.run.composition import Outcome, run_in_process, run_processes

RUN_S = 0.4


def assert_equal_engine(name: str, bag: Path, duration_s: float) -> None:
    expected = list(frames(built(name), duration_s))
    for topic, samples in recorded_samples(name, bag).items():
        assert sorted({sample.step for sample in samples}) == list(range(len(expected))), topic
        for sample in samples:  # one that was asked again, when the machine stalled, stands there twice
            assert sample == getattr(expected[sample.step], PARTS[topic]), topic


@pytest.mark.parametrize("name", NAMES)
def test_topics_equal_engine_to_the_bit(name: str, ros_domain: int, tmp_path: Path) -> None:
    options = RunOptions(pace="max", duration_s=RUN_S, recorder=True, exclusive=False)
    outcome = run_in_process(name, built(name).parameters, options, tmp_path / "bag", None)
    assert_equal_engine(name, tmp_path / "bag", RUN_S)
    assert_every_message_heard(outcome)


def assert_every_message_heard(outcome: Outcome) -> None:
    for topic, number in outcome.received.items():
        assert outcome.sent.get(topic, 0) == number, topic


@pytest.mark.parametrize("name", ["mb10_breaker", "winding_drum"])
@pytest.mark.slow
def test_nodes_in_processes_of_their_own_equal_engine_to_the_bit(name: str, ros_domain: int, tmp_path: Path) -> None:
    options = RunOptions(pace="max", duration_s=RUN_S, recorder=True, exclusive=False)
    run_processes(name, built(name).parameters, options, tmp_path / "bag", None)
    assert_equal_engine(name, tmp_path / "bag", RUN_S)

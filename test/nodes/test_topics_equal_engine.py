# SPDX-License-Identifier: Apache-2.0
"""A run over topics is the one-process run, to the bit, through real DDS and a real recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from catalogue import NAMES, built
from step_samples import assert_equal_engine

from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.run.composition import Outcome, run_in_process, run_processes
from mech_twin.parameters.load import machine

RUN_S = 0.4
RECORDED = RunOptions(pace="max", duration_s=RUN_S, recorder=True, exclusive=False)
# its lists are a vector and rows of a table, its groups hold empty ones
PAGE = """
name: block_in_soil
gravity_m_per_s2: [0.0, -9.81]
ground: {points_m: {soil: [0.0, 0.0]}}
bodies: {block: {mass_kg: 5.0}}
joints: {guide: {kind: slider, between: [ground, block], direction_deg: 90.0, start_m: 0.05, start_m_per_s: -2.0}}
contacts: {soil: {point: block, line: ground.soil, normal_deg: 90.0, layer_m_n: [[0.0, 0.0], [0.1, 5000.0]]}}
"""


@pytest.mark.parametrize("name", NAMES)
def test_topics_equal_engine_to_the_bit(name: str, ros_domain: int, tmp_path: Path) -> None:
    outcome = run_in_process(name, built(name).parameters, RECORDED, tmp_path / "bag", None)
    assert_equal_engine(tmp_path / "bag", built(name), RUN_S)
    assert_every_message_heard(outcome)


def assert_every_message_heard(outcome: Outcome) -> None:
    for topic, number in outcome.received.items():
        assert outcome.sent.get(topic, 0) == number, topic


@pytest.mark.parametrize("name", ["mb10_breaker", "winding_drum"])
@pytest.mark.slow
def test_nodes_in_processes_of_their_own_equal_engine_to_the_bit(name: str, ros_domain: int, tmp_path: Path) -> None:
    run_processes(name, built(name).parameters, RECORDED, tmp_path / "bag", None)
    assert_equal_engine(tmp_path / "bag", built(name), RUN_S)


@pytest.mark.parametrize("run", [run_in_process, pytest.param(run_processes, marks=pytest.mark.slow)])
def test_a_page_over_topics_equals_engine_to_the_bit(run: Callable[..., Any], ros_domain: int, tmp_path: Path) -> None:
    file = tmp_path / "block.yaml"
    file.write_text(PAGE, encoding="utf-8")
    block = machine(str(file))
    run("page", block.parameters, RECORDED, tmp_path / "bag", None)
    assert_equal_engine(tmp_path / "bag", block, RUN_S)

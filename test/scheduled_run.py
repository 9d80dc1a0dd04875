# SPDX-License-Identifier: Apache-2.0
"""A machine's nodes under schedules that a seed decides, each step compared with the engine's, bit by bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from catalogue import built
from simulated_ros import Network, simulated_ros

from mech_twin.engine.run import frames
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.roles.answering_nodes import BodyNode, ForceNode, MotorNode
from mech_twin.nodes.roles.linkage_node import LinkageNode
from mech_twin.samples import Frame

NAME = "mb10_breaker"
STEPS = 10  # of one schedule
RESTARTS = 0.25  # share of schedules
LONGEST_S = 60.0  # of a schedule, by the clock of the nodes
LONGEST_AWAY_S = 2.0
TICK_S = 0.02
MAKERS: dict[str, Callable[..., Any]] = {
    "motor": MotorNode,
    "forces": ForceNode,
    "body": BodyNode,
    "linkage": LinkageNode,
}


class ScheduledRun:
    """The nodes of a machine; each is of one process with the others, or of one of its own."""

    def __init__(self, network: Network, name: str = NAME) -> None:
        self.network, self.name = network, name
        self._roles = [role for role in MAKERS if role != "body" or built(name).body is not None]
        self.steps = -1
        self._options = RunOptions(exclusive=False)
        self._nodes: dict[str, Any] = {}
        self._engine: Iterator[Frame] = frames(built(name), 1e6)
        self._expected: list[Frame] = []
        for role in self._roles:
            self._start(role)
        network.at(network.now_s, self._tick)

    def _tick(self) -> None:
        linkage = self._nodes.get("linkage")
        if linkage is not None:
            linkage.tick()
        self.network.at(self.network.now_s + TICK_S, self._tick)

    def _start(self, role: str) -> None:
        node = MAKERS[role](self.name, built(self.name).parameters, self._options)
        node.get_logger().set_level(50)
        node.on_sample = partial(self._check, role)
        if self.network.random.random() < 0.5:
            node.join(self.network.hand_over)
        self._nodes[role] = node

    def _check(self, role: str, sample: Any) -> None:
        while len(self._expected) <= sample.step:
            self._expected.append(next(self._engine))
        assert sample == getattr(self._expected[sample.step], role), f"{role}, step {sample.step}"
        if role == "linkage":
            assert sample.step <= self.steps + 1, f"step {sample.step} after {self.steps}"
            self.steps = max(self.steps, sample.step)

    def schedule(self) -> None:
        """Take some steps, during which a node may be gone for a while, and come back as another process."""
        choose, goal = self.network.random, self.steps + STEPS
        if choose.random() < RESTARTS and self.steps > STEPS:
            self._until(self.steps + choose.randrange(STEPS))
            role = choose.choice(self._roles)
            self.network.end(self._nodes.pop(role))
            away_s = choose.random() * LONGEST_AWAY_S
            self.network.at(self.network.now_s + away_s, partial(self._start, role))
        self._until(goal)

    def _until(self, step: int) -> None:
        end_s = self.network.now_s + LONGEST_S
        while self.steps < step:
            self.network.turn()
            assert self.network.now_s < end_s, f"no step after {self.steps} for {LONGEST_S:g} s"


def run_schedules(seed: int, schedules: int, monkeypatch: pytest.MonkeyPatch, name: str = NAME) -> int:
    """Run some schedules of a seed one after the other; return the steps taken."""
    with simulated_ros(seed, monkeypatch) as network:
        run = ScheduledRun(network, name)
        for number in range(schedules):
            try:
                run.schedule()
            except AssertionError as error:
                raise AssertionError(f"{name}, seed {seed}, schedule {number}: {error}") from error
        return run.steps

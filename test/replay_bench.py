# SPDX-License-Identifier: Apache-2.0
"""A replay on a bench: the node driven by the test itself, and somebody who listens."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from bench_run import Bench
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from mech_twin.messages.topics import DIAGNOSTICS, EVERY, EVERY_LATCHED
from mech_twin.nodes.replay.replay_node import ReplayNode, ReplayOptions
from mech_twin.nodes.replay.source import ReplaySource
from mech_twin.recording.bag_reader import BagReader

LIMIT_S = 20.0


class Heard(NamedTuple):
    """One message heard."""

    topic: str
    raw: bytes


class ReplayBench(Bench):
    """A replay node and a listener to each of its topics, in one process, through real DDS."""

    def __init__(
        self,
        bag: Path,
        *,
        topics: tuple[str, ...] = (),
        start_s: float = 0.0,
        duration_s: float | None = None,
        listeners: int = 1,
        **options: Any,
    ) -> None:
        super().__init__("", list)
        self.reader = BagReader(bag)
        self.source = ReplaySource(self.reader, list(topics), start_s, duration_s)
        self.heard: list[Heard] = []
        self.announced: list[tuple[int, str]] = []
        self.client.create_timer(0.002, lambda: None)  # wakes the executor, so that turns come often enough
        if options.get("clock"):
            self.source.without_clock()
        self.source.topics.pop(DIAGNOSTICS.name, None)  # where the replay speaks of itself
        for name, topic in self.source.topics.items():
            self.listen(name, topic.kind, latched=topic.latched)
        self.client.create_subscription(DIAGNOSTICS.type, DIAGNOSTICS.name, self._on_diagnostics, EVERY)
        self.node = ReplayNode(self.source, ReplayOptions(listeners=listeners, **options))
        self.add(self.node)

    def listen(self, name: str, kind: Any, *, latched: bool = False) -> Any:
        def take(raw: bytes) -> None:
            self.heard.append(Heard(name, raw))

        return self.client.create_subscription(kind, name, take, EVERY_LATCHED if latched else EVERY, raw=True)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            if status.name == "/replay":
                self.announced.append((len(self.heard), status.message))

    def of(self, topic: str) -> list[bytes]:
        """Return what was heard on a topic."""
        return [heard.raw for heard in self.heard if heard.topic == topic]

    def until(self, predicate: Callable[[], bool]) -> None:
        """Replay until something holds; fail if it does not within the limit."""
        end = time.monotonic() + LIMIT_S

        def turned() -> bool:
            if not self.node.done:
                self.node.tick()
            return predicate() or time.monotonic() > end

        self.spinner.until(turned)
        assert predicate(), "did not happen within the limit"

    def for_a_while(self, seconds: float) -> None:
        """Replay for a time, whatever happens."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end)

    def to_the_end(self) -> None:
        """Replay until everything is published and heard."""
        self.until(lambda: self.node.done)
        self.until(lambda: len(self.heard) >= sum(output.published for output in self.node.outputs.values()))

    def ask(self, service: str) -> Any:
        """Return the answer of one of the replay's services."""
        return self.call(Trigger, f"/replay/{service}", Trigger.Request())

    def set_parameter(self, name: str, value: float) -> Any:
        """Return the result of setting a parameter of the replay."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        return self.call(SetParameters, "/replay/set_parameters", request).results[0]

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self.reader.close()

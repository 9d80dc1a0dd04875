# SPDX-License-Identifier: Apache-2.0
"""Serving nodes for hours takes no more memory than for seconds, and ends when it is to."""

from __future__ import annotations

import gc
import math
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise

import pytest
import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64

from mech_twin.nodes.exchange.spinner import SLICE_S, Spinner

pytestmark = pytest.mark.usefixtures("ros_domain")
WARM_S, WATCHED_S, WATCHES = 1.0, 2.0, 3
FEWER_A_SLICE = 1.0  # blocks of memory that are not given back; a slice begun anew each time is nearly two


class Paced(Node):
    """Is due a moment after each message, and says so from within it, as a linkage does that follows the wall clock."""

    def __init__(self) -> None:
        super().__init__("paced")
        self.interrupt: Callable[[], None] = lambda: None
        self.turns = 0
        self._due_s = math.inf
        self._timer = self.create_timer(0.002, self._message)

    def _message(self) -> None:
        self.turns += 1
        self._due_s = time.monotonic() + 0.0005
        self.interrupt()

    def tick(self) -> float:
        wait_s = self._due_s - time.monotonic()
        if wait_s > 0.0:
            return wait_s
        self._due_s = math.inf
        return math.inf


class Idle(Node):
    """Hears often and is never due by itself."""

    def __init__(self) -> None:
        super().__init__("idle")
        self.turns = 0
        self._timer = self.create_timer(0.002, self._message)

    def _message(self) -> None:
        self.turns += 1


@pytest.fixture(params=[Idle, Paced])
def node(request: pytest.FixtureRequest) -> Iterator[Idle | Paced]:
    rclpy.init()
    made = request.param()
    yield made
    made.destroy_node()
    rclpy.try_shutdown()


def served(spinner: Spinner, for_s: float) -> int:
    """Return the blocks of memory that Python holds after serving for a time."""
    end_s = time.monotonic() + for_s
    spinner.serve(lambda: time.monotonic() > end_s)
    gc.collect()
    return sys.getallocatedblocks()


@pytest.mark.slow
def test_serving_holds_no_more_memory_the_longer_it_lasts(node: Idle | Paced) -> None:
    with Spinner([node]) as spinner:
        held = [served(spinner, WARM_S)]
        turns = node.turns
        held += [served(spinner, WATCHED_S) for _ in range(WATCHES)]
    assert node.turns > turns + 0.5 * WATCHES * WATCHED_S / SLICE_S
    # what grows with time does so each time; what is kept once, as the middleware's own, does not
    assert min(after - before for before, after in pairwise(held)) < FEWER_A_SLICE * WATCHED_S / SLICE_S


def test_serving_ends_soon_after_the_run(node: Idle | Paced) -> None:
    with Spinner([node]) as spinner:
        begun_s = time.monotonic()
        served(spinner, WARM_S)
    assert time.monotonic() - begun_s < WARM_S + 10.0 * SLICE_S + 0.2


@pytest.mark.slow
def test_serving_ends_where_messages_come_faster_than_they_are_served(ros: None) -> None:
    """Each message takes 5 ms, so those after the end are at most 2 s of serving; some 5000 wait in the queue."""
    node, late = Node("slow"), 0
    more = node.create_publisher(Float64, "more", 5000)

    def message(heard: Float64) -> None:
        nonlocal late
        late += time.monotonic() > end_s
        time.sleep(0.005)
        for _ in range(5):
            more.publish(heard)

    node.create_subscription(Float64, "more", message, 5000)
    node.create_timer(0.3, lambda: more.publish(Float64()))
    end_s = time.monotonic() + 3.0
    with Spinner([node]) as spinner:
        spinner.serve(lambda: time.monotonic() > end_s)
    node.destroy_node()
    assert late < 400

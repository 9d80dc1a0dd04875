# SPDX-License-Identifier: Apache-2.0
"""A message there and back between two bare nodes of rclpy: ``python benchmarks/round_trip.py [--write]``.

The message is a step of the breaker's linkage.  In one process the time is processor time of the whole process; between
two processes it is the wall clock's, the second one being this file with the name of an executor.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any, NoReturn

import rclpy
from comparison import Table, measure, ratio, told_in_turn
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.step_message import linkage
from mech_twin.messages.topics import DATA
from mech_twin.parameters.load import machine

NAME = "mb10_breaker"
TRIPS, ROUNDS = 1000, 5
LIMIT_S = 60.0  # for the other process to be discovered, and for the trips
SETTLE_S = 0.5  # in which what was sent before comes back
EXECUTORS: dict[str, Any] = {"single": SingleThreadedExecutor, "events": EventsExecutor}
CELLS = " | "


def echo(node: Any, *, raw: bool) -> None:
    """Let a node send back what it hears."""
    back = node.create_publisher(JointState, "back", DATA)
    node.create_subscription(JointState, "there", back.publish, DATA, raw=raw)


def trip(message: Any, executor_name: str, clock: Callable[[], float], *, here: bool) -> float:
    """Return the time of a round trip (s) of a message, or of its bytes, with the other node here or elsewhere."""
    raw = isinstance(message, bytes)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    executor = EXECUTORS[executor_name]()
    nodes = [rclpy.create_node("first", namespace="/trip")]
    there = nodes[0].create_publisher(JointState, "there", DATA)
    count, goes_on = 0, False

    def returned(_: Any) -> None:
        nonlocal count
        count += 1
        if goes_on:
            there.publish(message)

    nodes[0].create_subscription(JointState, "back", returned, DATA, raw=raw)
    command = [sys.executable, __file__, executor_name, "bytes" if raw else "object"]
    other = None if here else subprocess.Popen(command)
    try:
        if here:
            nodes.append(rclpy.create_node("second", namespace="/trip"))
            echo(nodes[1], raw=raw)
        for node in nodes:
            executor.add_node(node)
        end_s = time.monotonic() + LIMIT_S
        while not count:  # each side has discovered the other once a message is back
            if time.monotonic() > end_s:
                raise TimeoutError(f"the other node was not discovered in {LIMIT_S:g} s")
            there.publish(message)
            executor.spin_once(timeout_sec=0.05)
        settled_s = time.monotonic() + SETTLE_S
        while time.monotonic() < settled_s:
            executor.spin_once(timeout_sec=0.05)
        count, goes_on = 0, True
        begun = clock()
        there.publish(message)
        while count < TRIPS:
            if time.monotonic() > end_s:
                raise TimeoutError(f"{count} of {TRIPS} round trips in {LIMIT_S:g} s: a message was lost")
            executor.spin_once(timeout_sec=1.0)
        return (clock() - begun) / TRIPS
    finally:
        if other is not None:
            other.kill()
            other.wait()
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def measured() -> list[Table]:
    """Return the table."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(20 + os.getpid() % 30))
    sample = next(iter(frames(machine(NAME), 0.0))).linkage
    messages = {"message objects": linkage.to_message(sample), "their bytes": linkage.to_bytes(sample)}
    tasks: dict[str, Callable[[], float]] = {}
    for nodes, here, clock in (
        ("one process, processor time", True, time.process_time),
        ("two processes, wall clock", False, time.perf_counter),
    ):
        for name, kind in product(EXECUTORS, messages):
            task = partial(trip, messages[kind], name, clock, here=here)
            tasks[CELLS.join((nodes, f"`{EXECUTORS[name].__name__}`", kind))] = task
    times = told_in_turn(tasks, ROUNDS)
    first = {name.partition(CELLS)[0]: name for name in reversed(times)}
    rows = [
        (*name.split(CELLS), f"{1e6 * min(spent):.0f}", ratio(times, first[name.partition(CELLS)[0]], name))
        for name, spent in times.items()
    ]
    how = f"JointState of {len(linkage.to_bytes(sample))} bytes, {TRIPS} round trips, best of {ROUNDS} rounds in turn."
    columns = ("nodes", "executor", "message", "us a round trip", "times as quick as the first (spread)")
    return [Table(how, columns, rows)]


def answer(executor_name: str, kind: str) -> NoReturn:
    """Send back what is heard, for ever."""
    rclpy.init(args=[])
    node = rclpy.create_node("second", namespace="/trip")
    echo(node, raw=kind == "bytes")
    executor = EXECUTORS[executor_name]()
    executor.add_node(node)
    while True:
        executor.spin_once(timeout_sec=1.0)


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in EXECUTORS:
        answer(*sys.argv[1:])
    measure("round_trip", measured)

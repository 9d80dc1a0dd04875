# SPDX-License-Identifier: Apache-2.0
"""Four bare rclpy nodes that exchange the messages of a step without physics: what any scheme over topics costs.

Linkage -> motor and force, force -> body, motor and body -> linkage, on one `EventsExecutor`, as the twin's nodes do.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from mech_twin.messages.topics import DATA
from mech_twin.nodes.exchange.spinner import Spinner

NAMES = ("linkage", "motor", "force", "body")
LISTENERS = {"linkage": 2, "motor": 1, "force": 1, "body": 1}


class BareStep(NamedTuple):
    """Seconds a step: by the wall clock, of the process, of its main thread, and of that in publishing."""

    wall_s: float
    process_s: float
    thread_s: float
    publish_s: float


class _Publishing:
    """Publishes, and adds up the main thread's time in it."""

    def __init__(self) -> None:
        self.spent_s = 0.0

    def __call__(self, publisher: Any, message: Any) -> None:
        begun = time.thread_time()
        publisher.publish(message)
        self.spent_s += time.thread_time() - begun


def bare_step(messages: list[Any], steps: int, *, raw: bool) -> BareStep:
    """Return the time of a step in which bare nodes pass on messages: objects, or with ``raw`` their bytes."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    nodes = {name: rclpy.create_node(name, namespace="/bare") for name in NAMES}
    out = {name: nodes[name].create_publisher(JointState, name, DATA) for name in NAMES}
    sample, publish = dict(zip(NAMES, messages, strict=True)), _Publishing()
    state = {"step": 0, "motor": False, "body": False}

    def listen(node: str, topic: str, react: Callable[[Any], None]) -> None:
        nodes[node].create_subscription(JointState, topic, react, DATA, raw=raw)

    def passing_on(name: str) -> Callable[[Any], None]:
        return lambda message: publish(out[name], sample[name])

    def answered(who: str) -> Callable[[Any], None]:
        def note(message: Any) -> None:
            state[who] = True
            if state["motor"] and state["body"]:
                state.update(step=state["step"] + 1, motor=False, body=False)
                publish(out["linkage"], sample["linkage"])

        return note

    listen("motor", "linkage", passing_on("motor"))
    listen("force", "linkage", passing_on("force"))
    listen("body", "force", passing_on("body"))
    listen("linkage", "motor", answered("motor"))
    listen("linkage", "body", answered("body"))
    try:
        with Spinner(nodes.values()) as spinner:
            spinner.until(lambda: all(out[name].get_subscription_count() >= n for name, n in LISTENERS.items()))
            publish.spent_s = 0.0
            begun = time.perf_counter(), time.process_time(), time.thread_time()
            out["linkage"].publish(sample["linkage"])
            spinner.until(lambda: state["step"] >= steps)
            ended = time.perf_counter(), time.process_time(), time.thread_time()
    finally:
        for node in nodes.values():
            node.destroy_node()
        rclpy.try_shutdown()
    return BareStep(*((b - a) / steps for a, b in zip(begun, ended, strict=True)), publish.spent_s / steps)

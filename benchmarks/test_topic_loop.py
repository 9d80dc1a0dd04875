# SPDX-License-Identifier: Apache-2.0
"""Steps per second over real topics, beside four bare rclpy nodes that exchange the same messages without physics."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages import body, force, linkage, motor
from mech_twin.messages.topics import DATA
from mech_twin.nodes.composition import run_in_process
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.spinner import Spinner
from mech_twin.parameters.load import machine

NAME = "mb10_breaker"
STEPS = 2000


@pytest.fixture(autouse=True)
def _own_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(20 + os.getpid() % 30))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


def bare_steps_per_second(messages: list[JointState]) -> float:
    """Return the lock-step rate of bare nodes: the floor any scheme over topics stands on."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    names = ("linkage", "motor", "force", "body")
    nodes = {name: rclpy.create_node(name, namespace="/bare") for name in names}
    out = {name: nodes[name].create_publisher(JointState, name, DATA) for name in names}
    sample = dict(zip(names, messages, strict=True))
    state = {"step": 0, "motor": False, "body": False}

    def listen(node: str, topic: str, react: Callable[[Any], None]) -> None:
        nodes[node].create_subscription(JointState, topic, react, DATA)

    def answered(who: str) -> Callable[[Any], None]:
        def note(message: JointState) -> None:
            state[who] = True
            if state["motor"] and state["body"]:
                state.update(step=state["step"] + 1, motor=False, body=False)
                out["linkage"].publish(sample["linkage"])

        return note

    listen("motor", "linkage", lambda message: out["motor"].publish(sample["motor"]))
    listen("force", "linkage", lambda message: out["force"].publish(sample["force"]))
    listen("body", "force", lambda message: out["body"].publish(sample["body"]))
    listen("linkage", "motor", answered("motor"))
    listen("linkage", "body", answered("body"))
    try:
        with Spinner(nodes.values()) as spinner:
            counts = {"linkage": 2, "motor": 1, "force": 1, "body": 1}
            spinner.until(lambda: all(out[name].get_subscription_count() >= n for name, n in counts.items()))
            begin = time.perf_counter()
            out["linkage"].publish(sample["linkage"])
            spinner.until(lambda: state["step"] >= STEPS)
            return STEPS / (time.perf_counter() - begin)
    finally:
        for node in nodes.values():
            node.destroy_node()
        rclpy.try_shutdown()


def test_topic_loop_beside_bare_nodes(benchmark: Any) -> None:
    built = machine(NAME)
    last = list(frames(built, 0.05))[-1]
    assert last.body is not None
    messages = [
        linkage.to_message(last.linkage),
        motor.to_message(last.motor),
        force.to_message(last.forces),
        body.to_message(last.body),
    ]
    floor = max(bare_steps_per_second(messages) for _ in range(2))
    options = RunOptions(pace="max", duration_s=STEPS * built.coupling_step_s)
    run_in_process(NAME, built.parameters, options, None, None)
    benchmark.pedantic(run_in_process, (NAME, built.parameters, options, None, None), rounds=3)
    ours = STEPS / benchmark.stats.stats.min
    alone = time.perf_counter()
    count = len(list(frames(built, STEPS * built.coupling_step_s)))
    engine = count / (time.perf_counter() - alone)
    benchmark.extra_info.update(
        steps_per_second=ours,
        bare_steps_per_second=floor,
        share_of_bare=ours / floor,
        engine_steps_per_second=engine,
        times_real_time=ours * built.coupling_step_s,
    )

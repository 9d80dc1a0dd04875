# SPDX-License-Identifier: Apache-2.0
"""Latency of a shadow from a sample to its estimate, over topics, at a steady rate.

    python benchmarks/shadow_latency.py [--rate-hz 1000] [--seconds 10] [MACHINE ...]

A publisher in another process shows the crank of the machine's own run, stamped with the instant at which each sample
was due; the time from there to the arrival of the estimate at a third listener is the latency.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from typing import Any

import numpy as np

from mech_twin.nodes.run.domain import settle_domain

MACHINES = ("vibration_crank", "mb10_breaker")
TOPIC = "/plant/joint_states"


def published(name: str, rate_hz: float, seconds: float, ready: Any) -> None:
    """Show a machine's joints at a rate, stamped with the wall clock."""
    settle_domain()
    import rclpy
    from sensor_msgs.msg import JointState

    from mech_twin.engine.rollout import roll_out
    from mech_twin.messages.cdr import Header, StepMessage, encoded, stamp_of
    from mech_twin.messages.topics import DATA
    from mech_twin.parameters.load import machine

    run = roll_out(machine(name), seconds + 2.0, ["linkage.crank.position"])
    rclpy.init()
    node = rclpy.create_node("plc")
    out = node.create_publisher(JointState, TOPIC, DATA)
    ready.wait()
    while out.get_subscription_count() == 0:
        time.sleep(0.05)
    begin, wall = time.monotonic(), time.time()
    every = round(1.0 / rate_hz / machine(name).coupling_step_s)
    for i in range(round(seconds * rate_hz)):
        time.sleep(max(0.0, begin + i / rate_hz - time.monotonic()))
        crank = float(run["linkage.crank.position"][i * every])
        stamp = stamp_of(wall + i / rate_hz)
        out.publish(encoded(StepMessage(Header(stamp), ("crank",), (crank,), (0.0,), (0.0,))))
    time.sleep(0.3)
    node.destroy_node()
    rclpy.shutdown()


def measured(name: str, rate_hz: float, seconds: float) -> tuple[np.ndarray, int]:
    """Return the latencies (s) of the estimates, and how many samples there were."""
    settle_domain()
    import rclpy

    from mech_twin.measurements.measurement_map import MeasurementMap
    from mech_twin.messages.cdr import received_message
    from mech_twin.messages.topics import ESTIMATED, full_name
    from mech_twin.nodes.exchange.spinner import Spinner
    from mech_twin.nodes.shadow.shadow_node import ShadowNode, ShadowSetup

    source = {"topic": TOPIC, "joint": "crank", "field": "position"}
    channel = {"source": source, "is": "linkage.crank.position", "sigma": 1e-3}
    given = MeasurementMap.model_validate({"machine": name, "channels": [channel]})
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    plant = context.Process(target=published, args=(name, rate_hz, seconds, ready))
    plant.start()
    rclpy.init()
    node = ShadowNode(name, ShadowSetup("/plant", given))
    witness = rclpy.create_node("witness")
    delays: list[float] = []

    def on_estimate(raw: bytes) -> None:
        stamp = received_message(raw).header.stamp
        delays.append(time.time() - stamp.sec - 1e-9 * stamp.nanosec)

    witness.create_subscription(ESTIMATED.type, full_name(name, ESTIMATED), on_estimate, 2000, raw=True)
    ready.set()
    with Spinner([node, witness]) as spinner:
        spinner.until(lambda: not plant.is_alive())
    node.destroy_node()
    witness.destroy_node()
    rclpy.shutdown()
    plant.join()
    return np.array(delays), round(seconds * rate_hz)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="*", default=list(MACHINES))
    parser.add_argument("--rate-hz", type=float, default=1000.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    asked = parser.parse_args()
    print(f"| machine | samples at {asked.rate_hz:g} Hz | estimates | median, ms | 95 %, ms |\n|{'---|' * 5}")
    for name in asked.machines:
        delays, samples = measured(name, asked.rate_hz, asked.seconds)
        low, high = (float(1e3 * value) for value in np.quantile(delays, (0.5, 0.95)))
        print(f"| {name} | {samples} | {len(delays)} | {low:.2f} | {high:.2f} |", flush=True)


if __name__ == "__main__":
    main()

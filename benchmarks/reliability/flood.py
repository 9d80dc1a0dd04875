# SPDX-License-Identifier: Apache-2.0
"""Does the recorder keep up?  ``python benchmarks/reliability/flood.py [SECONDS] [RATE] [--write]`` floods it.

The recorder is a process of its own; the messages come from this one, at a steady pace, as whole step messages.
Prints sent, recorded and missed, and the recorder's share of a core; ``--write`` adds it to docs/proof/reliability.md.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
from measured import add_rows, here

from mech_twin.nodes.run.domain import settle_domain

COLUMNS = ("flood", "sent", "lost", "recorder", "made")
MACHINE = "vibration_crank"
TOPICS = 3
STEP_S = 0.001


def main() -> None:
    """Run, and print what was seen."""
    asked = arguments()
    seconds, rate = asked.seconds, asked.rate
    settle_domain()
    import rclpy

    from mech_twin.engine.run import frames
    from mech_twin.messages.step_message import force, linkage, motor, set_stamp
    from mech_twin.messages.topics import DATA, STEP_FORCES, STEP_LINKAGE, STEP_MOTOR
    from mech_twin.parameters.load import machine
    from mech_twin.recording.bag_reader import bag_info

    frame = list(frames(machine(MACHINE), 0.1))[-1]
    messages = [
        linkage.to_message(frame.linkage),
        motor.to_message(frame.motor),
        force.to_message(frame.forces),
    ]
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        code = "from mech_twin.nodes.run.executables import recorder_node; recorder_node()"
        words = ["--directory", str(bag), "--ros-args", "-p", f"machine:={MACHINE}"]
        recorder = subprocess.Popen([sys.executable, "-c", code, *words])
        rclpy.init(args=[])
        node = rclpy.create_node("flood", namespace=f"/{MACHINE}")
        topics = (STEP_LINKAGE, STEP_MOTOR, STEP_FORCES)
        publishers = [node.create_publisher(topic.type, topic.name, DATA) for topic in topics]
        while not all(publisher.get_subscription_count() for publisher in publishers):
            time.sleep(0.01)
        process = psutil.Process(recorder.pid)
        before, begin, sent = sum(process.cpu_times()[:2]), time.monotonic(), 0
        while (now := time.monotonic() - begin) < seconds:
            while sent * TOPICS < now * rate:
                for message, publisher in zip(messages, publishers, strict=True):
                    set_stamp(message.header, sent * STEP_S)
                    publisher.publish(message)
                sent += 1
            time.sleep(0.0005)
        wall = time.monotonic() - begin
        time.sleep(1.0)
        share = (sum(process.cpu_times()[:2]) - before) / wall
        recorder.terminate()
        recorder.wait(10)
        node.destroy_node()
        rclpy.shutdown()
        counters = {topic.name: info.message_count for topic, info in _recorded(bag_info(bag), topics)}
    print(f"sent {sent * TOPICS} messages in {wall:.1f} s: {sent * TOPICS / wall:.0f} a second")
    print(f"recorded {sum(counters.values())}, lost {sent * TOPICS - sum(counters.values())}")
    print(f"recorder: {share:.0%} of a core")
    if asked.write:
        lost = sent * TOPICS - sum(counters.values())
        asked_for = f"{rate:g} messages/s for {seconds:g} s"
        add_rows("flood", COLUMNS, [[asked_for, sent * TOPICS, lost, f"{share:.0%} of a core", here()]])


def arguments() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seconds", type=float, nargs="?", default=60.0)
    parser.add_argument("rate", type=float, nargs="?", default=4000.0, help="messages a second")
    parser.add_argument("--write", action="store_true", help="add the run to the table of docs/proof/reliability.md")
    return parser.parse_args()


def _recorded(info: object, topics: tuple) -> list:
    return [(topic, info.topics[f"/{MACHINE}/{topic.name}"]) for topic in topics]  # type: ignore[attr-defined]


if __name__ == "__main__":
    main()

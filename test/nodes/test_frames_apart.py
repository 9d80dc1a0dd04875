# SPDX-License-Identifier: Apache-2.0
"""A run in several processes publishes frames and description unasked, and ends well before they have begun."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from mech_twin.messages.topics import EVERY, FRAMES, LATCHED, ROBOT_DESCRIPTION

pytestmark = pytest.mark.usefixtures("ros_domain")
LIMIT_S = 180.0  # of a machine with much else to do
DRUM = [
    sys.executable, "-c", "from mech_twin.cli.main import main; main()",
    "run", "winding_drum", "--view", "none", "--no-record", "--processes",
]  # fmt: skip


@pytest.mark.slow
def test_a_run_in_several_processes_tells_frames_and_description() -> None:
    transforms: list[TransformStamped] = []
    described: list[str] = []
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        listener = rclpy.create_node("listener", namespace="/winding_drum")
        listener.create_subscription(TransformStamped, FRAMES.name, transforms.append, EVERY)
        listener.create_subscription(String, ROBOT_DESCRIPTION.name, lambda m: described.append(m.data), LATCHED)
        with subprocess.Popen(DRUM, stdout=subprocess.DEVNULL) as run:
            end = time.monotonic() + LIMIT_S
            while not (transforms and described) and time.monotonic() < end and run.poll() is None:
                rclpy.spin_once(listener, timeout_sec=0.1)
            run.send_signal(signal.SIGINT)
            assert run.wait(LIMIT_S) == 0
        listener.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert described[0].startswith('<robot name="winding_drum">')
    assert transforms[0].child_frame_id.startswith("winding_drum/")


@pytest.mark.slow
def test_a_run_that_is_over_before_its_frames_have_begun_has_ended_well() -> None:
    run = subprocess.run([*DRUM, "--duration", "0.2"], capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert run.returncode == 0, run.stderr

# SPDX-License-Identifier: Apache-2.0
"""A run attended at a terminal: what its status line says, and what its keys do."""

from __future__ import annotations

import os
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from catalogue import NAMES, built

from mech_twin.engine.run import frames
from mech_twin.nodes.run.console import CLEAR, RunStatus, blow_rate
from mech_twin.samples import Event
from mech_twin.studies.simulation import RunMetrics

COMMAND = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
SPAWN = "import os, pty, sys; sys.exit(os.waitstatus_to_exitcode(pty.spawn(sys.argv[1:])))"
IN_TERMINAL = [sys.executable, "-c", SPAWN]
LIMIT_S = 120.0


def blow(time_s: float, impulse_ns: float = 20.0, kind: str = "blow") -> Event:
    return Event(time_s, kind, "tool", 1.5, -0.5, impulse_ns, 1)


def test_the_first_blow_of_a_dying_series_counts_and_only_the_last_seconds() -> None:
    series = [
        event for i in range(10) for event in (blow(0.1 * i), blow(0.1 * i + 0.01, 4.0), blow(0.1 * i + 0.02, 0.8))
    ]
    assert blow_rate(series, 1.0) == pytest.approx(9.0, abs=1.0)
    assert blow_rate(series, 10.0) == 0.0
    assert blow_rate([blow(0.5, kind="touchdown")], 1.0) == 0.0
    assert blow_rate([], 0.0) == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_the_line_says_time_speed_and_state_of_every_machine(name: str, tmp_path: Path) -> None:
    machine = built(name)
    metrics = RunMetrics(lambda: machine)
    status = RunStatus(metrics, tmp_path)
    assert status.line(0.0) == "starting"
    (tmp_path / "bag_0.mcap").write_bytes(bytes(2_500_000))
    for frame in frames(machine, 3 * machine.coupling_step_s):
        metrics.observe(frame)
    linkage = frame.linkage
    line = status.line(100.0)
    assert f"{linkage.time_s:.2f} s" in line
    slides = machine.mechanism is not None and linkage.joints[0] in machine.mechanism.sliding_joints
    assert f"{linkage.joints[0]} {linkage.velocity[0]:.4g} {'m/s' if slides else 'rad/s'} " in line
    assert "2.5 MB" in line
    assert "lag 0.00 s" in line
    assert "lag 1.50 s" in status.line(101.5)
    regimes = machine.linkage.regimes
    assert not regimes or regimes[linkage.regime] in line


def test_the_line_tells_what_the_last_blows_had_and_no_mean_of_the_run() -> None:
    machine = built("mb10_breaker")
    metrics = RunMetrics(lambda: machine)
    for frame in frames(machine, machine.coupling_step_s):
        metrics.observe(frame)
    time_s = frame.linkage.time_s
    metrics.events.extend([blow(time_s), blow(time_s), blow(time_s, 19.4), blow(time_s, 0.31), blow(time_s, 0.15)])
    line = RunStatus(metrics, None).line(0.0)
    assert "last 19.4, 0.31, 0.15 N s" in line
    assert "J a blow" not in line


def test_a_pause_is_no_lag() -> None:
    machine = built("winding_drum")
    metrics = RunMetrics(lambda: machine)
    for frame in frames(machine, machine.coupling_step_s):
        metrics.observe(frame)
    status = RunStatus(metrics, None)
    status.line(0.0)
    status.pause(True)
    assert "paused" in status.line(50.0)
    status.pause(False)
    assert "lag 0.00 s" in status.line(100.0)


class Terminal:
    """A run with a terminal of its own."""

    def __init__(self, *words: str) -> None:
        self.process = subprocess.Popen([*IN_TERMINAL, *COMMAND, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self.process.stdout is not None
        self.shown, self._out = "", self.process.stdout.fileno()

    def until(self, words: str) -> None:
        """Read until the terminal shows this."""
        end = time.monotonic() + LIMIT_S
        while words not in self.shown:
            assert time.monotonic() < end, self.shown[-2000:]
            if select.select([self._out], [], [], 0.5)[0]:
                self.shown += os.read(self._out, 4096).decode("utf-8", "replace")

    def press(self, key: str, answer: str = "") -> None:
        """Press a key and wait for what it says."""
        assert self.process.stdin is not None
        self.shown = ""
        self.process.stdin.write(key.encode())
        self.process.stdin.flush()
        self.until(answer)

    def end(self) -> None:
        """End the terminal and, should it not answer, the run in it."""
        run = psutil.Process(self.process.pid).children(recursive=True) if self.process.poll() is None else []
        for process in (*run, self.process):
            process.kill()
        self.process.wait()


@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
def test_keys_command_the_run() -> None:
    run = Terminal("run", "winding_drum", "--view", "none", "--no-record", "--pace", "max")
    try:
        run.until("lag")
        run.press("-", "speed 90% of rated")
        run.press(" ", "paused")
        run.press(" ", "running")
        run.press("x", "supply off")
        run.press("+", "the motor is off: s starts it")
        run.press("s", "supply on at 0.9")
        run.press("r", "initial state at the next step")
        run.press("q")
        run.process.communicate(timeout=LIMIT_S)
        assert run.process.returncode == 0
    finally:
        run.end()


LOGS = """
import sys
from mech_twin.nodes.run.console import CLEAR, keep_log_apart
keep_log_apart()
import rclpy
rclpy.init(args=[])
node = rclpy.create_node("speaker")
sys.stderr.write(f"{CLEAR}12 s  crank 66 rad/s")
sys.stderr.flush()
node.get_logger().warning("behind by 1 s")
node.destroy_node()
rclpy.shutdown()
"""


@pytest.mark.usefixtures("ros_domain")
def test_a_line_of_the_log_clears_the_status_line_it_would_be_glued_to() -> None:
    words = [*IN_TERMINAL, sys.executable, "-c", LOGS]
    shown = subprocess.run(words, capture_output=True, timeout=LIMIT_S, check=True).stdout.decode()
    assert re.search(rf"66 rad/s(\x1b\[\d+m)?{re.escape(CLEAR)}\[WARN\]", shown), shown  # its colour comes first

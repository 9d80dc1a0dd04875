# SPDX-License-Identifier: Apache-2.0
"""Terminal of a run: a status line, and keys that control the run through its services.

The line has time, speed, blows and their impulses, state, lag, size of the recording.
"""

from __future__ import annotations

import os
import select
import shutil
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from mech_twin.measurements.units import leading_in, sliding_in
from mech_twin.messages.topics import SPEED_COMMAND
from mech_twin.nodes.exchange.spinner import Spinner
from mech_twin.samples import Event, Frame
from mech_twin.studies.simulation import RunMetrics


class TerminalKeys:
    """A context that reads keys without waiting for Enter and without echo; without a terminal it returns none."""

    def __init__(self) -> None:
        self._fd: int | None = None
        self._before: list[Any] = []

    @property
    def listening(self) -> bool:
        """Whether there is a terminal to read keys from."""
        return self._fd is not None

    def __enter__(self) -> TerminalKeys:
        fd = _terminal()
        if fd is not None:
            self._before = termios.tcgetattr(fd)
            tty.setcbreak(fd)
            self._fd = fd
        return self

    def __exit__(self, *_: object) -> None:
        if self._fd is not None:
            with suppress(termios.error):  # the terminal has closed
                termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)
            self._fd = None

    def pressed(self) -> str:
        """Return the keys pressed since the last call."""
        if self._fd is None or not select.select([self._fd], [], [], 0.0)[0]:
            return ""
        try:
            keys = os.read(self._fd, 64)
        except OSError:
            keys = b""
        if not keys:  # the terminal is gone
            self._fd = None
        return keys.decode("ascii", "ignore")


def _terminal() -> int | None:
    """Return the file descriptor of the terminal on standard input; None in a background process."""
    try:
        fd = sys.stdin.fileno()
        return fd if os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp() else None
    except (OSError, ValueError, AttributeError):
        return None


BLOWS = ("blow", "impact")
SPAN_S = 2.0  # simulated time over which blows are counted
LOUD = 0.5  # least share of the largest impulse in the span: of a decaying series of bounces only the first counts
SHOWN_BLOWS = 3
MEGABYTE = 1e6


class RunStatus:
    """Status of a run from its frames.

    Parameters
    ----------
    metrics : RunMetrics
        Metrics of the run.
    directory : Path, optional
        Directory of its recording.
    """

    def __init__(self, metrics: RunMetrics, directory: Path | None) -> None:
        self.notice = ""
        self.paused = False
        self.motor_off = False
        self._metrics, self._directory = metrics, directory
        self._zero_s: float | None = None

    def pause(self, paused: bool) -> None:
        """Register a pause or its end; the lag starts again from zero."""
        self.paused = paused
        self._zero_s = None
        self.notice = ""

    def line(self, now_s: float) -> str:
        """Return the line at a steady time (s)."""
        frame = self._metrics.last
        if frame is None:
            return "starting"
        linkage = frame.linkage
        machine = self._metrics.machine
        joint, unit = leading_in(machine), "m/s" if leading_in(machine) in sliding_in(machine) else "rad/s"
        parts = [
            f"{linkage.time_s:.2f} s",
            f"{joint} {linkage.joint(joint).velocity:.4g} {unit}",
            *self._blows(linkage.time_s),
            self._state(frame),
            f"lag {self._lag_s(linkage.time_s, now_s):.2f} s",
            *self._recorded(),
            self.notice,
        ]
        return "  ".join(filter(None, parts))

    def _blows(self, time_s: float) -> list[str]:
        rate = blow_rate(self._metrics.events, time_s)
        if rate == 0.0:
            return []
        struck = [event.impulse_ns for event in self._metrics.events if event.kind in BLOWS]
        return [f"{rate:.3g} blows/s", f"last {', '.join(f'{impulse:.3g}' for impulse in struck[-SHOWN_BLOWS:])} N s"]

    def _state(self, frame: Frame) -> str:
        if self.paused:
            return "paused"
        return "motor off" if self.motor_off else self._metrics.regime(frame.linkage.regime)

    def _lag_s(self, time_s: float, now_s: float) -> float:
        """Return the lag (s) behind the wall clock since the first status or the last pause."""
        ahead = time_s - now_s
        if self._zero_s is None or ahead > self._zero_s:
            self._zero_s = ahead
        return self._zero_s - ahead

    def _recorded(self) -> list[str]:
        if self._directory is None:
            return []
        size = sum(file.stat().st_size for file in self._directory.glob("*.mcap"))
        return [f"{size / MEGABYTE:.1f} MB"]


def blow_rate(events: Iterable[Event], time_s: float) -> float:
    """Return the blows per second over the last `SPAN_S` of simulated time; 0 if there was none."""
    span = min(SPAN_S, time_s)
    recent = [event for event in events if event.kind in BLOWS and event.time_s > time_s - span]
    hardest = max((event.impulse_ns for event in recent), default=0.0)
    blows = sum(event.impulse_ns > LOUD * hardest for event in recent)
    return blows / span if hardest > 0.0 else 0.0


KEYS = "space: pause or go on, +/-: faster or slower, s: start, x: stop the motor, r: reset, q: quit"
LOOK_S = 0.05
SHOW_S = 0.2
STEP = 0.1  # share of rated speed per key press
LEAST, MOST = 0.1, 1.0
CLEAR = "\r\x1b[2K"
LOG_FORMAT = "RCUTILS_CONSOLE_OUTPUT_FORMAT"


def keep_log_apart() -> None:
    """Make each line of the log clear the status line first; call before rclpy is initialised."""
    if sys.stdin.isatty() and sys.stderr.isatty():
        os.environ.setdefault(LOG_FORMAT, f"{CLEAR}[{{severity}}] [{{time}}] [{{name}}]: {{message}}")


@contextmanager
def attended(
    machine_name: str, metrics: RunMetrics, directory: Path | None, spinner: Spinner
) -> Iterator[Callable[[], bool]]:
    """Provide a callable for a run's loop, which serves the terminal and returns whether the user has quit.

    Without a terminal on standard input nothing is shown and no node is added.
    """
    with TerminalKeys() as keys:
        if not keys.listening or not sys.stderr.isatty():
            yield lambda: False
            return
        node = rclpy.create_node("console", namespace=f"/{machine_name}")
        spinner.add(node)
        console = RunConsole(node, keys, RunStatus(metrics, directory))
        sys.stderr.write(f"{KEYS}\n")
        try:
            yield console.turn
        finally:
            sys.stderr.write(CLEAR)
            spinner.remove(node)
            node.destroy_node()


class RunConsole:
    """Keys and status line of a run.

    Parameters
    ----------
    node : Node
        In the namespace of the run.
    keys : TerminalKeys
        Source of the keys.
    status : RunStatus
        Contents of the line.
    """

    def __init__(self, node: Node, keys: TerminalKeys, status: RunStatus) -> None:
        self._keys, self._status = keys, status
        self._asked = MOST
        self._quit = False
        self._looked_s = self._shown_s = 0.0
        self._speed = node.create_publisher(Float64, SPEED_COMMAND.name, SPEED_COMMAND.qos)
        self._pause = node.create_client(SetBool, "pause")
        self._triggers = {name: node.create_client(Trigger, name) for name in ("start", "stop", "reset")}

    def turn(self) -> bool:
        """Execute the keys pressed, show the line if it is due; return whether the user has quit."""
        now = time.monotonic()
        if now - self._looked_s >= LOOK_S:
            self._looked_s = now
            for key in self._keys.pressed():
                self.obey(key)
        if now - self._shown_s >= SHOW_S:
            self._shown_s = now
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write(f"{CLEAR}{self._status.line(now)[:width]}")
            sys.stderr.flush()
        return self._quit

    def obey(self, key: str) -> None:
        """Execute the command of a key; other keys do nothing."""
        if key == " ":
            self._call(self._pause, SetBool.Request(data=not self._status.paused), self._paused)
        elif key in "+=" or key in "-_":
            self._change_speed(STEP if key in "+=" else -STEP)
        elif key in "sxr":
            name = {"s": "start", "x": "stop", "r": "reset"}[key]
            self._call(self._triggers[name], Trigger.Request(), partial(self._triggered, name))
        elif key == "q":
            self._quit = True

    def _change_speed(self, by: float) -> None:
        if self._status.motor_off:
            self._status.notice = "the motor is off: s starts it"
            return
        self._asked = min(MOST, max(LEAST, round(self._asked + by, 3)))
        self._speed.publish(Float64(data=self._asked))
        self._status.notice = f"speed {self._asked:.0%} of rated"

    def _call(self, client: Any, request: Any, done: Callable[[Any], None]) -> None:
        if not client.service_is_ready():
            self._status.notice = "the run does not answer yet"
            return
        client.call_async(request).add_done_callback(lambda future: done(future.result()))

    def _paused(self, answer: SetBool.Response) -> None:
        self._status.pause(answer.message == "paused")

    def _triggered(self, name: str, answer: Trigger.Response) -> None:
        self._status.notice = answer.message
        if answer.success and name != "reset":
            self._status.motor_off = name == "stop"

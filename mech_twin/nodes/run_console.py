# SPDX-License-Identifier: Apache-2.0
"""A run attended at a terminal: a line that says how it goes, and keys that command it over the run's own services."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from mech_twin.messages.topics import SPEED_COMMAND
from mech_twin.nodes.run_metrics import RunMetrics
from mech_twin.nodes.run_status import RunStatus
from mech_twin.nodes.spinner import Spinner
from mech_twin.nodes.terminal_keys import TerminalKeys

KEYS = "space: pause or go on, +/-: faster or slower, s: start, x: stop the motor, r: reset, q: quit"
LOOK_S = 0.05
SHOW_S = 0.2
STEP = 0.1  # of rated speed, a key press
LEAST, MOST = 0.1, 1.0
CLEAR = "\r\x1b[2K"


@contextmanager
def attended(
    machine_name: str, metrics: RunMetrics, directory: Path | None, spinner: Spinner
) -> Iterator[Callable[[], bool]]:
    """Provide what is called again and again during a run, and returns whether the user has quit.

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
        Where keys come from.
    status : RunStatus
        What the line says.
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
        """Obey the keys pressed, show the line where it is due; return whether the user has quit."""
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
        """Do what a key asks for; other keys do nothing."""
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

# SPDX-License-Identifier: Apache-2.0
"""A machine's nodes as real processes, to be killed, stopped and restarted, with a witness that hears it all."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
import yaml
from catalogue import built
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.engine.run import frames
from mech_twin.messages.cdr import received_message
from mech_twin.messages.step_message import linkage as linkage_messages
from mech_twin.messages.topics import DIAGNOSTICS, EVERY, STEP_LINKAGE, Topic, full_name
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.roles import Machine
from mech_twin.samples import LinkageSample

LIMIT_S = 30.0
PROGRAMS = {"motor": "motor_node", "force_analysis": "force_node", "body": "body_node", "linkage": "linkage_node"}


def parameter_file(folder: Path, machine: Machine, options: RunOptions) -> Path:
    """Return a file with the whole configuration of a run."""
    tree = {"machine": machine.name, **configuration_tree(machine.parameters), "run": configuration_tree(options)}
    path = folder / "parameters.yaml"
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": tree}}), encoding="utf-8")
    return path


def program(role: str, parameters: Path, *arguments: str) -> list[str]:
    """Return the command of a node's program."""
    name = PROGRAMS.get(role, f"{role}_node")
    code = f"from mech_twin.nodes.run.executables import {name}; {name}()"
    return [sys.executable, "-c", code, *arguments, "--ros-args", "--params-file", str(parameters)]


class ProcessRun:
    """Role nodes of a machine in processes of their own.

    The witness keeps the newest linkage sample of each step (its own check of equality can be done at any time and
    forgets what it has checked, so that a long run stays small), and every diagnostics message.

    A witness that does not hear the steps takes next to nothing from the run; its step is the one that the linkage told
    in its diagnostics, and what was recorded is to be checked afterwards.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        recorder: bool = False,
        machine: Machine | None = None,
        hears_steps: bool = True,
        **options: Any,
    ) -> None:
        self.name = name
        self.machine = machine or built(name)
        self.folder = folder
        self.bag = folder / "bag"
        self.options = RunOptions(observer=hears_steps, recorder=recorder, **options)
        self.sim_time = False
        self.step = -1
        self.fresh: list[LinkageSample] = []
        self.repeated = 0
        self._undelivered = False
        self.diagnostics: list[DiagnosticStatus] = []
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._engine = frames(self.machine, 1e6)
        self._hears_steps = hears_steps
        self._parameters = parameter_file(folder, self.machine, self.options)
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.witness = rclpy.create_node("witness", namespace=f"/{name}")
        if hears_steps:
            self._hear_steps()
        self.witness.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, EVERY)
        self._executor = EventsExecutor()
        self._executor.add_node(self.witness)

    # -- what the witness hears -------------------------------------------------------------------------------------

    def _hear_steps(self) -> None:
        # a witness slower than the run would lose what a killed linkage has not delivered yet
        self.witness.create_subscription(JointState, STEP_LINKAGE.name, self._on_linkage, EVERY, raw=True)
        for topic in ("step/motor", "step/forces", "step/body"):
            self.witness.create_subscription(JointState, topic, lambda message: None, 1, raw=True)

    def _on_linkage(self, raw: bytes) -> None:
        sample = linkage_messages.from_message(received_message(raw))
        if sample.step <= self.step:
            self.repeated += 1
        else:
            self.fresh.append(sample)
            self.step = sample.step

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.diagnostics += message.status
        if not self._hears_steps:
            told = self.figure("linkage", "step") or "-"
            self.step = self.step if told == "-" else int(told)

    def checked(self) -> int:
        """Return the newest step, all up to it being the engine's own to the bit; raises where one is not.

        None is missing, but for what a linkage killed since the last check had not yet delivered to the witness.
        """
        for sample in self.fresh:
            expected = next(self._engine).linkage
            if sample.step > expected.step and self._undelivered:
                self._undelivered = False
                expected = next(frame.linkage for frame in self._engine if frame.linkage.step == sample.step)
            assert sample == expected, f"step {sample.step} differs from the engine's step {expected.step}"
        self.fresh.clear()
        self._undelivered = False
        return self.step

    def said(self, role: str, pattern: str) -> bool:
        """Return whether a node's diagnostics ever said this."""
        full = f"/{self.name}/{role}"
        return any(status.name == full and re.search(pattern, status.message) for status in self.diagnostics)

    def figure(self, role: str, key: str) -> str | None:
        """Return the newest value of this key in a node's diagnostics."""
        full = f"/{self.name}/{role}"
        for status in reversed(self.diagnostics):
            if status.name == full:
                return next((pair.value for pair in status.values if pair.key == key), None)
        return None

    # -- time -------------------------------------------------------------------------------------------------------

    def until(self, predicate: Callable[[], bool], limit_s: float = LIMIT_S, what: str = "") -> None:
        """Serve the witness until something holds; fail if it does not within the limit."""
        end = time.monotonic() + limit_s
        while not predicate() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)
        last = {status.name: status.message for status in self.diagnostics[-20:]}
        assert predicate(), f"did not happen within {limit_s:g} s: {what}; step {self.step}; {last}"

    def steps(self, number: int, what: str = "steps") -> None:
        """Serve until so many further steps are taken."""
        goal = self.step + number
        self.until(lambda: self.step >= goal, what=what)

    def spin_for(self, seconds: float) -> None:
        """Serve for a time, whatever happens."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)

    def publisher(self, topic: Topic, **quality: Any) -> Any:
        """Return a matched publisher of the witness on one of the machine's topics."""
        publisher = self.witness.create_publisher(
            topic.type, full_name(self.name, topic), quality.get("qos", topic.qos)
        )
        self.until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    # -- processes --------------------------------------------------------------------------------------------------

    @property
    def roles(self) -> list[str]:
        """Roles of this machine."""
        return [role for role in PROGRAMS if role != "body" or self.machine.body is not None]

    def start(self, role: str, *arguments: str, environment: dict[str, str] | None = None) -> None:
        """Start a node's program; one that was there before is replaced."""
        command = program(role, self._parameters, *arguments)
        if self.sim_time:
            command += ["-p", "use_sim_time:=true"]
        with (self.folder / f"{role}.log").open("ab") as log:
            self.processes[role] = subprocess.Popen(
                command, stdout=log, stderr=log, env={**os.environ, **(environment or {})}
            )

    def start_all(self, environment: dict[str, str] | None = None, limit_s: float = LIMIT_S) -> None:
        """Start every role, and the recorder first if there is one; the first may have to compile."""
        if self.options.recorder:
            self.start("recorder", "--directory", str(self.bag), environment=environment)
        for role in self.roles:
            self.start(role, environment=environment)
        self.until(lambda: self.step >= 0, limit_s, "the first step")

    def kill(self, role: str) -> None:
        """End a node as a power cut would."""
        self.processes[role].kill()
        self.processes[role].wait()
        self._undelivered = self._undelivered or role == "linkage"

    def signal(self, role: str, number: int) -> None:
        """Send a signal to a node."""
        self.processes[role].send_signal(number)

    def finish(self, role: str, limit_s: float = 10.0) -> int:
        """Ask a node to end, and return its exit code."""
        process = self.processes.pop(role)
        process.send_signal(signal.SIGINT)
        return process.wait(limit_s)

    def log(self, role: str) -> str:
        """Return what a node wrote to the terminal."""
        return (self.folder / f"{role}.log").read_text(encoding="utf-8", errors="replace")

    def alive(self) -> bool:
        """Return whether every process still runs."""
        return all(process.poll() is None for process in self.processes.values())

    def __enter__(self) -> ProcessRun:
        return self

    def __exit__(self, *_: object) -> None:
        alive = [process for process in self.processes.values() if process.poll() is None]
        for process in alive:
            process.send_signal(signal.SIGCONT)
        # before they are killed: one killed while it sends keeps a lock, on which a participant that ends may crash
        self._executor.remove_node(self.witness)
        self._executor.shutdown()
        self.witness.destroy_node()
        for process in alive:
            process.kill()
        for process in self.processes.values():
            process.wait()
        rclpy.try_shutdown()

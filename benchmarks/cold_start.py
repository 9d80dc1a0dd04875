# SPDX-License-Identifier: Apache-2.0
"""From the command to the first step, share by share, with compiled kernels on disk.

``python benchmarks/cold_start.py [--write]``: fresh processes, wall clock.  `mech-twin run` is taken apart where it
goes from one part to the next; `mech_twin.rollout` is what a program or a notebook waits for.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence

from comparison import Table, measure

NAME, ROUNDS = "mb10_breaker", 5
MACHINES = ("mb10_breaker", "compaction_press", "vibration_crank", "impact_mass", "roller_former", "winding_drum")
RUN_SHARES = (
    "interpreter, search path of the ROS wheels",
    "command line: typer, options, numpy, numba",
    "configuration: pydantic, YAML, the machine",
    "nodes: rclpy, message types",
    "rclpy.init",
    "nodes made",
    "kernels loaded, a step tried",
    "discovery: until all listen and nobody resumes a run",
)
RUN = f"""
import json, sys, time
begun, marks = float(sys.argv[1]), []
def mark():
    marks.append(time.time())
mark()
from mech_twin.cli import main
import mech_twin.cli.run
mark()
from mech_twin.parameters.load import machine_parameters
parameters = machine_parameters({NAME!r})
mark()
from mech_twin.nodes.run.domain import settle_domain
settle_domain()
import mech_twin.nodes.run.composition
from mech_twin.nodes.roles import role_node
from mech_twin.nodes.run import composition
from mech_twin.nodes.roles.linkage_node import LinkageNode
from mech_twin.nodes.exchange.base_node import RunOptions
mark()
init, try_step, spinner, kernels = composition.rclpy.init, role_node.warm_up, composition.Spinner, []
def timed_init(**options):
    init(**options)
    mark()
def timed_step(machine):
    since = time.time()
    try_step(machine)
    kernels.append(time.time() - since)
def timed_spinner(nodes):
    mark()
    return spinner(nodes)
def first_step(node, sample, repeated=False):
    mark()
    node.done = True
composition.rclpy.init, role_node.warm_up, composition.Spinner = timed_init, timed_step, timed_spinner
LinkageNode._publish = first_step
composition.run_in_process({NAME!r}, parameters, RunOptions(pace="max", exclusive=True), None, None)
made = [b - a for a, b in zip([begun, *marks], marks)]
made[5:6] = [made[5] - sum(kernels), sum(kernels)]
print(json.dumps(made))
"""
ROLLOUT = """
import json, sys, time
begun = float(sys.argv[1])
started = time.time()
import mech_twin
mech_twin.rollout
imported = time.time()
mech_twin.rollout(sys.argv[2], duration_s=1.0, columns=["time_s"])
first = time.time()
mech_twin.rollout(sys.argv[2], duration_s=1.0, columns=["time_s"])
print(json.dumps([started - begun, imported - started, first - imported, time.time() - first]))
"""


def told(script: str, *arguments: str) -> list[float]:
    """Return the numbers (s) a fresh process prints on its last line; it is told when it was started."""
    command = [sys.executable, "-c", script, str(time.time()), *arguments]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300.0)
    if ran.returncode:
        raise SystemExit(f"cold_start: {ran.stderr.strip().splitlines()[-1]}")
    return [float(value) for value in json.loads(ran.stdout.strip().splitlines()[-1])]


def seconds(values: Sequence[float]) -> str:
    """Return median, smallest and greatest of some times as a cell."""
    return f"{statistics.median(values):.2f} ({min(values):.2f} - {max(values):.2f})"


def run_shares() -> Table:
    """Return where the time until the first step of `run` goes."""
    told(RUN)  # the first one compiles what is not compiled yet
    rounds = [told(RUN) for _ in range(ROUNDS)]
    rows = [(name, seconds(taken)) for name, taken in zip(RUN_SHARES, zip(*rounds, strict=True), strict=True)]
    rows.append(("first step", seconds([sum(taken) for taken in rounds])))
    how = f"`mech-twin run {NAME}`, neither recorded nor shown, seconds: median (smallest - greatest) of {ROUNDS}."
    return Table(how, ("share", "s"), rows)


def rollout_calls() -> Table:
    """Return what the first call of `mech_twin.rollout` costs in a fresh process."""
    rows = []
    for name in MACHINES:
        told(ROLLOUT, name)
        _, imports, first, second = zip(*(told(ROLLOUT, name) for _ in range(ROUNDS)), strict=True)
        rows.append((name, seconds(imports), seconds(first), f"{1e3 * statistics.median(second):.0f}"))
    how = f"`mech_twin.rollout`, 1 s of each machine in a fresh process: median (smallest - greatest) of {ROUNDS}."
    return Table(how, ("machine", "imports, s", "first call, s", "second call, ms"), rows)


def measured() -> list[Table]:
    """Return both tables."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(20 + os.getpid() % 30))
    return [run_shares(), rollout_calls()]


if __name__ == "__main__":
    measure("cold_start", measured)

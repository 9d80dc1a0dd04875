# SPDX-License-Identifier: Apache-2.0
"""Steps over topics beside bare nodes with the same messages, and what recorder and view add to a step.

``python benchmarks/topic_loop.py [--write]``.  All nodes in one process, no pacing, start and end left out: in the
first steps each node reads the description, a text.  Times are processor time of the whole process: nothing waits.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from bare_nodes import bare_step
from comparison import Table, measure, ratio, told_in_turn

from mech_twin.engine.coupling import next_body
from mech_twin.engine.run import frames
from mech_twin.messages.step_message import Row, body, force, linkage, motor
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.roles.linkage_node import LinkageNode
from mech_twin.nodes.run.composition import run_in_process
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine
from mech_twin.samples import Frame, LinkageSample

NAME = "mb10_breaker"
CALLS, LOOPS, STEPS, ROUNDS = 500, 7, 2000, 5
BEGIN = 500  # first step that is measured
MARKS = (Row("~revision", 1.0, 17.0), Row("~source", 17.0))
BARE, OURS = "bare nodes, message objects", "role nodes"


def microseconds(call: Callable[[], object]) -> float:
    """Return the processor time of a call, in microseconds: the best of some loops."""
    best = float("inf")
    for _ in range(LOOPS):
        begin = time.process_time()
        for _ in range(CALLS):
            call()
        best = min(best, time.process_time() - begin)
    return best / CALLS * 1e6


def role_share(built: Machine, frame: Frame, before: Frame) -> float:
    """Return the time of the roles of one step."""
    share = microseconds(lambda: built.linkage.advance(before.linkage, before.motor, before.body))
    share += microseconds(lambda: built.motor.respond(frame.linkage, 1.0))
    share += microseconds(lambda: built.forces.analyse(frame.linkage))
    role = built.body
    return share if role is None else share + microseconds(lambda: next_body(role, before.body, frame.forces))


def nodes_step(built: Machine, clock: Callable[[], float], *, recorder: bool = False, viewer: bool = False) -> float:
    """Return the time of a step of the nodes (s)."""
    marks: list[float] = []
    published = LinkageNode._publish

    def publish(node: LinkageNode, sample: LinkageSample, repeated: bool = False) -> None:
        if sample.step in (BEGIN, BEGIN + STEPS):
            marks.append(clock())
        published(node, sample, repeated)

    LinkageNode._publish = publish  # type: ignore[method-assign]
    try:
        with tempfile.TemporaryDirectory() as folder:
            options = RunOptions(
                pace="max",
                duration_s=(BEGIN + STEPS) * built.coupling_step_s,
                exclusive=False,
                recorder=recorder,
                viewer=viewer,
            )
            bag, picture = Path(folder) / "bag", str(Path(folder) / "view.rrd")
            run_in_process(NAME, built.parameters, options, bag if recorder else None, picture if viewer else None)
    finally:
        LinkageNode._publish = published  # type: ignore[method-assign]
    return (marks[-1] - marks[0]) / STEPS


def step_bytes(frame: Frame, *, raw: bool) -> list[object]:
    """Return the messages of a step in the order of the bare nodes: objects, or their bytes."""
    if frame.body is None:
        raise ValueError(f"{NAME} has no body")
    pairs = ((linkage, frame.linkage), (motor, frame.motor), (force, frame.forces), (body, frame.body))
    return [c.to_bytes(s, MARKS) if raw else c.to_message(s) for c, s in pairs]


def rates(built: Machine, frame: Frame, before: Frame) -> Table:
    """Return the time of a step of each kind of nodes, and as what part of bare nodes they go."""
    objects, raws = step_bytes(frame, raw=False), step_bytes(frame, raw=True)
    cpu = time.process_time
    tasks = {
        BARE: lambda: bare_step(objects, STEPS, raw=False).process_s,
        "bare nodes, the same bytes": lambda: bare_step(raws, STEPS, raw=True).process_s,
        "the roles alone, called in a loop": lambda: 1e-6 * role_share(built, frame, before),
        OURS: lambda: nodes_step(built, cpu),
        f"{OURS} and recorder": lambda: nodes_step(built, cpu, recorder=True),
        f"{OURS}, recorder and view into a file": lambda: nodes_step(built, cpu, recorder=True, viewer=True),
    }
    times = told_in_turn(tasks, ROUNDS)
    rows = [
        (
            name,
            f"{1e6 * min(spent):.0f}",
            f"{1.0 / min(spent):.0f}",
            f"{100.0 * min(spent) / built.coupling_step_s:.0f} %",
            ratio(times, BARE, name),
        )
        for name, spent in times.items()
    ]
    how = f"{NAME}, {STEPS} steps of 1 ms, nodes in one process, processor time, best of {ROUNDS} rounds in turn."
    columns = ("nodes", "us a step", "steps a second", "share of a core at 1 kHz", "part of bare nodes (spread)")
    return Table(how, columns, rows)


def measured() -> list[Table]:
    """Return the table."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(20 + os.getpid() % 30))
    built = machine(NAME)
    run = list(frames(built, 0.3))
    return [rates(built, run[-1], run[-2])]


if __name__ == "__main__":
    measure("topic_loop", measured)

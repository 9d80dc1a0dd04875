# SPDX-License-Identifier: Apache-2.0
"""Steps over topics beside bare nodes with the same messages, and where the time of a step goes.

``python benchmarks/topic_loop.py [--write]``.  All nodes in one process, no pacing, start and end left out.  Shares are
processor time: those of our own calls in a loop, those of the middleware from bare nodes that pass on the same bytes;
what is left of a whole step is the bookkeeping of the nodes, their joint states and other topics, and the metrics.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from bare_nodes import BareStep, bare_step
from comparison import Table, measure, ratio, told_in_turn

from mech_twin.engine.coupling import next_body
from mech_twin.engine.run import frames
from mech_twin.messages import body, force, linkage, motor
from mech_twin.messages.joint_state_cdr import Decoder, encoded
from mech_twin.messages.step_head import StepHeadReader
from mech_twin.messages.step_marks import revision_row
from mech_twin.messages.step_message import Row
from mech_twin.nodes.composition import run_in_process
from mech_twin.nodes.linkage_node import LinkageNode
from mech_twin.nodes.options import RunOptions
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine
from mech_twin.samples import Frame, LinkageSample

NAME = "mb10_breaker"
CALLS, LOOPS, STEPS, ROUNDS = 500, 7, 2000, 3
MARKS = (revision_row(1, 17.0), Row("~source", 17.0))
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


def message_shares(built: Machine, frame: Frame) -> dict[str, float]:
    """Return the times of writing and reading the step messages of one step."""
    codecs = [(linkage, frame.linkage), (motor, frame.motor), (force, frame.forces), (body, frame.body)]
    present = [(codec, sample) for codec, sample in codecs if sample is not None]
    raws = [encoded(codec.to_step(sample, MARKS)) for codec, sample in present]
    decode, head = Decoder(), StepHeadReader()
    messages = [decode(raw) for raw in raws]
    shares = {
        "encode: sample to bytes": 0.0,
        "decode: bytes to columns": 0.0,
        "check: columns to sample": 0.0,
        HEAD: 0.0,
    }
    encode_at, decode_at, check_at, head_at = shares
    for (codec, sample), raw, message in zip(present, raws, messages, strict=True):
        shares[encode_at] += microseconds(lambda c=codec, s=sample: c.to_bytes(s, MARKS))
        shares[decode_at] += microseconds(lambda r=raw: decode(r))
        shares[check_at] += microseconds(lambda c=codec, m=message: c.from_message(m, built.coupling_step_s))
        shares[head_at] += microseconds(lambda r=raw: head(r))
    return shares


HEAD = "beside it, in a recorder: head of each message"


def nodes_step(built: Machine, clock: Callable[[], float], *, recorder: bool = False, viewer: bool = False) -> float:
    """Return the time of a step of the nodes (s), from the first step to the last."""
    marks: list[float] = []
    published = LinkageNode._publish

    def publish(node: LinkageNode, sample: LinkageSample, repeated: bool = False) -> None:
        if sample.step in (0, STEPS):
            marks.append(clock())
        published(node, sample, repeated)

    LinkageNode._publish = publish  # type: ignore[method-assign]
    try:
        with tempfile.TemporaryDirectory() as folder:
            options = RunOptions(
                pace="max",
                duration_s=STEPS * built.coupling_step_s,
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
    return [encoded(c.to_step(s, MARKS)) if raw else c.to_message(s) for c, s in pairs]


def rates(built: Machine, frame: Frame) -> Table:
    """Return the steps a second, each as a part of those of bare nodes."""
    objects, raws = step_bytes(frame, raw=False), step_bytes(frame, raw=True)
    wall = time.perf_counter
    tasks = {
        BARE: lambda: bare_step(objects, STEPS, raw=False).wall_s,
        "bare nodes, the same bytes": lambda: bare_step(raws, STEPS, raw=True).wall_s,
        OURS: lambda: nodes_step(built, wall),
        f"{OURS} and recorder": lambda: nodes_step(built, wall, recorder=True),
        f"{OURS}, recorder and view into a file": lambda: nodes_step(built, wall, recorder=True, viewer=True),
    }
    times = told_in_turn(tasks, ROUNDS)
    rows = [
        (name, f"{1.0 / min(spent):.0f}", f"{built.coupling_step_s / min(spent):.2f}", ratio(times, BARE, name))
        for name, spent in times.items()
    ]
    how = f"{NAME}, {STEPS} steps of 1 ms, nodes in one process, wall clock, {ROUNDS} rounds in turn."
    return Table(how, ("nodes", "steps a second", "times real time", "part of bare nodes (spread)"), rows)


def shares(built: Machine, frame: Frame, before: Frame) -> Table:
    """Return where the processor time of a step goes."""
    floors = [bare_step(step_bytes(frame, raw=True), STEPS, raw=True) for _ in range(ROUNDS)]
    bare = BareStep(*(min(values) for values in zip(*floors, strict=True)))
    own = message_shares(built, frame)
    head = own.pop(HEAD)
    parts = {
        "publish: call of the middleware": 1e6 * bare.publish_s,
        "take: executor and callbacks": 1e6 * (bare.thread_s - bare.publish_s),
        "threads of the middleware": 1e6 * (bare.process_s - bare.thread_s),
        **own,
        "role: kernels and their faces": role_share(built, frame, before),
    }
    whole = 1e6 * statistics.median(nodes_step(built, time.process_time) for _ in range(ROUNDS))
    parts["left: nodes' bookkeeping, other topics, metrics"] = whole - sum(parts.values())
    parts["step"] = whole
    rows = [(share, f"{spent:.0f}", f"{100.0 * spent / whole:.0f} %") for share, spent in parts.items()]
    how = f"Processor time of one step of {NAME}, role nodes in one process, microseconds."
    return Table(how, ("share", "us", "of the step"), [*rows, (HEAD, f"{head:.0f}", "")])


def measured() -> list[Table]:
    """Return both tables."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(20 + os.getpid() % 30))
    built = machine(NAME)
    run = list(frames(built, 0.3))
    return [rates(built, run[-1]), shares(built, run[-1], run[-2])]


if __name__ == "__main__":
    measure("topic_loop", measured)

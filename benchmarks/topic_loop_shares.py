# SPDX-License-Identifier: Apache-2.0
"""Where the time of a step over topics goes: ``python benchmarks/topic_loop_shares.py [MACHINE]``.

Each share is the processor time of its own calls in a loop (the smallest of several rounds), beside the processor time
of a whole step of the nodes in one process.  What is left over is the middleware: publishing, its threads, taking.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable

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

CALLS, ROUNDS, STEPS = 500, 7, 2000
MARKS = (revision_row(1, 17.0), Row("~source", 17.0))


def microseconds(call: Callable[[], object]) -> float:
    """Return the processor time of a call, in microseconds."""
    best = float("inf")
    for _ in range(ROUNDS):
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
    shares = {"encode": 0.0, "decode": 0.0, "check": 0.0, "recorder's head": 0.0}
    for (codec, sample), raw, message in zip(present, raws, messages, strict=True):
        shares["encode"] += microseconds(lambda c=codec, s=sample: encoded(c.to_step(s, MARKS)))
        shares["decode"] += microseconds(lambda r=raw: decode(r))
        shares["check"] += microseconds(lambda c=codec, m=message: c.from_message(m, built.coupling_step_s))
        shares["recorder's head"] += microseconds(lambda r=raw: head(r))
    return shares


def step_time(name: str, built: Machine) -> float:
    """Return the processor time of a step of the nodes in one process, in microseconds."""
    marks: list[float] = []
    published = LinkageNode._publish

    def publish(node: LinkageNode, sample: LinkageSample, repeated: bool = False) -> None:
        if sample.step in (0, STEPS):
            marks.append(time.process_time())
        published(node, sample, repeated)

    LinkageNode._publish = publish  # type: ignore[method-assign]
    options = RunOptions(pace="max", duration_s=STEPS * built.coupling_step_s, exclusive=False)
    best = float("inf")
    for _ in range(3):
        marks.clear()
        run_in_process(name, built.parameters, options, None, None)
        best = min(best, marks[-1] - marks[0])
    return best / STEPS * 1e6


def main() -> None:
    """Print the table of one machine."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    name = sys.argv[1] if len(sys.argv) > 1 else "mb10_breaker"
    built = machine(name)
    run = list(frames(built, 0.3))
    shares = {"roles": role_share(built, run[-1], run[-2]), **message_shares(built, run[-1])}
    head = shares.pop("recorder's head")
    whole = step_time(name, built)
    print(f"{name}: processor time of one step over topics, nodes in one process, microseconds")
    for share, spent in {
        **shares,
        "middleware, executor, metrics": whole - sum(shares.values()),
        "step": whole,
    }.items():
        print(f"| {share} | {spent:.0f} | {100.0 * spent / whole:.0f} % |")
    print(f"| beside it, in a recorder: head of each message | {head:.0f} | |")


if __name__ == "__main__":
    main()

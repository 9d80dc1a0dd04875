# SPDX-License-Identifier: Apache-2.0
"""The run goes on when every peer has given its one answer to the step; nothing else counts.  Without ROS."""

from __future__ import annotations

import itertools

import pytest

from mech_twin.nodes.exchange.peers import SteppingBarrier
from mech_twin.samples import BodySample, MotorSample, Named


def motor(step: int, torque_nm: float = 1.0) -> MotorSample:
    return MotorSample(step, step * 1e-3, ("rotor",), (0.0,), (0.0,), (torque_nm,), 1.0)


def body(step: int) -> BodySample:
    return BodySample(step, step * 1e-3, ("tool",), (0.0,), (0.0,), (0.0,), 0, 0.0, Named(), Named())


def test_it_is_complete_when_all_have_answered_in_whatever_order() -> None:
    for order in itertools.permutations((("motor", motor(5)), ("body", body(5)))):
        barrier = SteppingBarrier(("motor", "body"))
        for number, (peer, sample) in enumerate(order):
            assert not barrier.complete
            assert len(barrier.missing()) == 2 - number
            assert barrier.take(peer, sample, 5) is None
        assert barrier.complete
        assert barrier.missing() == ()
        assert barrier.answers == {"motor": motor(5), "body": body(5)}


@pytest.mark.parametrize(
    ("sample", "kind"),
    [
        (motor(4), "repeated"),
        (motor(4, 2.0), "conflicting"),
        (motor(3), "late"),
        (motor(-1), "late"),
        (motor(6), "early"),
        (motor(10**15), "early"),
    ],
)
def test_what_is_not_the_answer_to_the_step_is_named_and_not_kept(sample: MotorSample, kind: str) -> None:
    barrier = SteppingBarrier(("motor",))
    assert barrier.take("motor", motor(4), 4) is None
    barrier.expect_next()
    fault = barrier.take("motor", sample, 5)
    assert fault is not None
    assert fault.kind == kind
    assert not barrier.complete


def test_the_first_answer_stays_whatever_comes_after_it() -> None:
    barrier = SteppingBarrier(("motor",))
    barrier.take("motor", motor(5), 5)
    repeated, conflicting = barrier.take("motor", motor(5), 5), barrier.take("motor", motor(5, 9.0), 5)
    assert repeated is not None
    assert conflicting is not None
    assert (repeated.kind, conflicting.kind) == ("repeated", "conflicting")
    assert barrier.answers == {"motor": motor(5)}

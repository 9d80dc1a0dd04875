# SPDX-License-Identifier: Apache-2.0
"""Steps handed over inside a process and steps sent as bytes are one stream: each once, in order.  No ROS."""

from __future__ import annotations

from collections import deque
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.messages.step_message import ANONYMOUS, SOURCE, Row
from mech_twin.nodes.exchange.direct_exchange import HandedStep, HandOver, Listener, ReceivedBytes, StepChannel
from mech_twin.samples import MotorSample

SIGNED = Row(SOURCE, 17.0)
ACTS = st.sampled_from(["send", "send", "again", "deliver", "later", "drain", "stranger", "subscriber", "not finite"])


def step(number: int, torque_nm: float = 1.0) -> HandedStep:
    sample = MotorSample(number, 1e-3 * number, ("rotor",), (0.0,), (0.0,), (torque_nm,), False)
    return HandedStep(sample, (SIGNED,), lambda content, marks: b"%d %r" % (content.step, content.effort))


class Wire:
    """A topic of the middleware: what is published arrives later, in order, at every subscription."""

    def __init__(self, listeners: list[Listener]) -> None:
        self._here = [(listener, deque[bytes]()) for listener in listeners]
        self.elsewhere: list[bytes] = []
        self.subscribed_elsewhere = self.stranger = False
        self.published = 0
        for listener in listeners:
            listener.publishers = lambda: 1 + self.stranger

    def count(self) -> int:
        return len(self._here) + self.subscribed_elsewhere

    def publish(self, message: bytes) -> None:
        self.published += 1
        for _, queue in self._here:
            queue.append(bytes(bytearray(message)))
        if self.subscribed_elsewhere:
            self.elsewhere.append(message)

    def arrive(self) -> None:
        for listener, queue in self._here:
            while queue:
                listener.hear(queue.popleft(), {"publication_sequence_number": None})


class Bench:
    """A sender and two listeners of one executor."""

    def __init__(self) -> None:
        self.heard: list[list[bytes]] = [[], []]
        take = [lambda found, heard=heard: heard.append(found.raw) for heard in self.heard]
        self.listeners = [Listener("/t", take[place], take[place], patient=place > 0) for place in range(2)]
        self.wire, self.exchange = Wire(self.listeners), HandOver()
        for listener in self.listeners:
            self.exchange.listen(listener)
        self.channel: StepChannel = self.exchange.channel("/t")
        self.channel.senders = 1
        self.send = partial(self.channel.send, subscriptions=self.wire.count, publish=self.wire.publish)

    def deliver_all(self) -> None:
        while self.exchange.waiting:
            self.exchange.deliver()
        self.exchange.deliver_later()

    def settle(self) -> None:
        self.deliver_all()
        self.wire.arrive()
        self.deliver_all()


@given(st.lists(ACTS, max_size=60))
def test_each_step_is_heard_once_and_in_order_however_the_way_changes(acts: list[str]) -> None:
    bench, sent, due_elsewhere = Bench(), list[bytes](), list[bytes]()
    for act in acts:
        if act == "deliver" and bench.exchange.waiting:
            bench.exchange.deliver()
        elif act == "later":
            bench.exchange.deliver_later()
        elif act == "drain":
            bench.wire.arrive()
        elif act == "stranger":
            bench.wire.stranger = not bench.wire.stranger
        elif act == "subscriber":
            bench.wire.subscribed_elsewhere = not bench.wire.subscribed_elsewhere
        elif act in ("send", "again", "not finite"):
            number = max(0, len(set(sent)) - (act == "again"))
            made = step(number, float("nan") if act == "not finite" else 1.0)
            bench.send(made)
            sent.append(made.raw)
            if bench.wire.subscribed_elsewhere:
                due_elsewhere.append(made.raw)
    bench.settle()
    assert bench.heard == [sent, sent]
    assert bench.wire.elsewhere == due_elsewhere


def test_an_error_of_received_bytes_is_raised_where_steps_are_delivered() -> None:
    def refuse(found: object) -> None:
        raise ArithmeticError("no step is short enough")

    listener, exchange = Listener("/t", refuse, refuse), HandOver()
    exchange.listen(listener)
    listener.hear(b"step", {"publication_sequence_number": None})  # called by the executor, which would print a trace
    with pytest.raises(ArithmeticError, match="short enough"):
        exchange.deliver()


def test_no_bytes_are_made_while_all_listen_here() -> None:
    bench = Bench()
    made = [step(number) for number in range(5)]
    for each in made:
        bench.send(each)
    bench.deliver_all()
    assert bench.wire.published == 0


def test_objects_are_handed_again_once_the_stranger_has_gone_and_its_bytes_have_come() -> None:
    bench = Bench()
    bench.wire.stranger = True
    bench.send(step(0))
    bench.wire.stranger = False
    bench.send(step(1))
    assert not bench.exchange.waiting
    bench.wire.arrive()
    bench.send(step(2))
    assert len(bench.exchange.waiting) == len(bench.exchange.later) == 1
    assert bench.wire.published == 2


def test_bytes_that_are_lost_hold_nothing_up() -> None:
    bench = Bench()
    bench.wire.stranger = True
    bench.send(step(0))
    for _, queue in bench.wire._here:
        queue.clear()
    bench.wire.stranger = False
    bench.send(step(1))
    bench.wire.arrive()
    bench.send(step(2))
    bench.deliver_all()
    assert bench.heard == [[step(1).raw, step(2).raw]] * 2


def test_bytes_that_bear_the_number_of_a_sender_here_are_believed_only_if_it_sent_them() -> None:
    bench, number = Bench(), SIGNED.position
    bench.send(step(0))
    bench.wire.stranger = True
    bench.send(step(1))
    for listener in bench.listeners:
        assert listener.believed(number, ReceivedBytes(step(1).raw, None)) == number
        assert listener.believed(number, ReceivedBytes(step(0).raw, None)) == ANONYMOUS, (
            "it was handed over and never published"
        )
        assert listener.believed(number, ReceivedBytes(step(1, 2.0).raw, None)) == ANONYMOUS
        assert listener.believed(number + 1.0, ReceivedBytes(step(1, 2.0).raw, None)) == number + 1.0


def test_what_a_sender_publishes_after_it_has_left_is_believed() -> None:
    bench, number = Bench(), SIGNED.position
    bench.send(step(0))
    bench.channel.left()
    assert [each.believed(number, ReceivedBytes(step(1).raw, None)) for each in bench.listeners] == [number] * 2


def test_who_leaves_is_handed_nothing_more() -> None:
    bench = Bench()
    bench.send(step(0))
    bench.exchange.leave(bench.listeners[0])
    bench.deliver_all()
    assert bench.heard == [[], [step(0).raw]]

# SPDX-License-Identifier: Apache-2.0
"""A sample written straight into bytes is, byte for byte, the message of the sample encoded."""

from __future__ import annotations

import pytest
from catalogue import NAMES, built

from mech_twin.engine.run import frames
from mech_twin.messages import body, force, linkage, motor
from mech_twin.messages.identity import MOST_REMEMBERED, of_the_same
from mech_twin.messages.joint_state_cdr import encoded
from mech_twin.messages.step_marks import revision_row
from mech_twin.messages.step_message import SOURCE, TARGET, Row

SIGNATURE = Row(SOURCE, 2.0**47 + 1.0)
MARKS = [(), (SIGNATURE,), (revision_row(3, 17.0), SIGNATURE), (Row(TARGET, 0.5), SIGNATURE)]


@pytest.mark.parametrize("name", NAMES)
def test_the_bytes_are_those_of_the_message(name: str) -> None:
    for frame in frames(built(name), 0.3):
        for marks in MARKS:
            assert linkage.to_bytes(frame.linkage, marks) == encoded(linkage.to_step(frame.linkage, marks))
            assert motor.to_bytes(frame.motor, marks) == encoded(motor.to_step(frame.motor, marks))
            assert force.to_bytes(frame.forces, marks) == encoded(force.to_step(frame.forces, marks))
            if frame.body is not None:
                assert body.to_bytes(frame.body, marks) == encoded(body.to_step(frame.body, marks))


def test_what_is_remembered_of_names_is_theirs_and_is_bounded() -> None:
    made: list[tuple[str, ...]] = []

    @of_the_same
    def joined(first: tuple[str, ...], second: tuple[str, ...]) -> str:
        made.append(first)
        return " ".join((*first, *second))

    first, second = ("a",), ("b", "c")
    assert [joined(first, second), joined(first, second), joined(second, first)] == ["a b c", "a b c", "b c a"]
    assert len(made) == 2
    for number in range(3 * MOST_REMEMBERED):  # each freed at once: another may come to stand at its place
        assert joined((f"x{number}",), second) == f"x{number} b c"

# SPDX-License-Identifier: Apache-2.0
"""The time left is told by the steps alone: what loads and compiles before the first one does not count."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator

import pytest

from mech_twin.capabilities.progress import tell
from mech_twin.cli.console import progress
from mech_twin.cli.study import progress_of

STEPS, COMPILING_S, STEP_S = 500, 60.0, 0.2
LONG = 10**8  # steps nobody waits for


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the steady time that the program reads, in a list to be set."""
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


def left_s(line: str) -> float:
    found = re.search(r"about (?:(\d+) days, )?(\d+):(\d\d):(\d\d) left at this speed", line)
    assert found, line
    days, hours, minutes, seconds = (float(each or 0) for each in found.groups())
    return ((24.0 * days + hours) * 60.0 + minutes) * 60.0 + seconds


def test_the_time_left_of_an_answer_leaves_out_its_first_step(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    with progress_of("searching"):
        for done in range(1, STEPS):
            clock[0] = COMPILING_S + STEP_S * done
            tell(done, STEPS)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("searching: 12 of about 500 steps, about ")
    assert left_s(line) == pytest.approx(STEPS * STEP_S, rel=0.1)


def test_the_time_left_of_a_run_leaves_out_its_first_step(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    def steps() -> Iterator[int]:
        for done in range(STEPS):
            clock[0] = COMPILING_S + STEP_S * done
            yield done

    with progress(steps(), LONG, "simulating") as items:
        assert sum(1 for _ in items) == STEPS
    (line,) = capsys.readouterr().err.splitlines()
    assert left_s(line) == pytest.approx(LONG * STEP_S, rel=0.1)

# SPDX-License-Identifier: Apache-2.0
"""The time left is told by the steps alone: what loads and compiles before the first one does not count."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator

import pytest

from mech_twin.capabilities.progress import tell
from mech_twin.cli.console import estimate, progress
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
    found = re.search(r"about ([0-9.]+) (s|min|h|days) left at this speed", line)
    assert found, line
    return float(found[1]) * {"s": 1.0, "min": 60.0, "h": 3600.0, "days": 86400.0}[found[2]]


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


@pytest.mark.parametrize(
    ("elapsed_s", "words"),
    [
        (0.1, "about 99.9 s left"),
        (1.0, "about 16.6 min left"),
        (60.0, "about 16.6 h left"),
        (1e4, "about 116 days left"),
    ],
)
def test_a_long_computation_is_estimated_from_its_beginning(elapsed_s: float, words: str) -> None:
    assert words in estimate(1, 1000, elapsed_s)

# SPDX-License-Identifier: Apache-2.0
"""A terminal that closes takes what is written to it with it, and nothing else."""

from __future__ import annotations

import io
import os
import pty
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest

from mech_twin.nodes.run.console import TerminalKeys
from mech_twin.process.terminal_output import outlive_terminal


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], int]]:
    """Put a terminal on all standard streams of this test, once it has begun, and return its far end."""

    streams: list[IO[str]] = []

    def opened() -> int:
        ours, theirs = pty.openpty()
        for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
            streams.append(os.fdopen(os.dup(theirs), mode))
            monkeypatch.setattr(sys, name, streams[-1])
        os.close(theirs)
        return ours

    yield opened
    monkeypatch.undo()
    for stream in streams:
        stream.close()


def test_what_is_written_arrives_while_the_terminal_is_open(terminal: Callable[[], int]) -> None:
    far_end = terminal()
    outlive_terminal()
    sys.stdout.write("torque, N·m\n")
    assert os.read(far_end, 100).decode() == "torque, N·m\r\n"
    assert sys.stderr.isatty()


def test_what_is_written_to_a_closed_terminal_is_lost_and_no_error(terminal: Callable[[], int]) -> None:
    far_end = terminal()
    outlive_terminal()
    os.close(far_end)
    for stream in (sys.stdout, sys.stderr):
        stream.write("nobody reads this\n")
        stream.flush()


def test_another_error_is_still_an_error(terminal: Callable[[], int]) -> None:
    terminal()
    outlive_terminal()
    with Path("/dev/full").open("wb") as full:
        os.dup2(full.fileno(), sys.stdout.fileno())
    with pytest.raises(OSError, match="No space left"):
        sys.stdout.write("too much\n")
    with Path(os.devnull).open("wb") as null:  # takes what the stream still holds
        os.dup2(null.fileno(), sys.stdout.fileno())


def test_a_stream_that_is_no_file_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    before = sys.stdout
    outlive_terminal()
    assert sys.stdout is before


def test_keys_end_quietly_when_the_terminal_has_closed(
    terminal: Callable[[], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    far_end = terminal()
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp())  # the test does not control this terminal
    with TerminalKeys() as keys:
        assert keys.listening
        os.close(far_end)

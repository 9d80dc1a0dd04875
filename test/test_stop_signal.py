# SPDX-License-Identifier: Apache-2.0
"""A signal is a request to stop, or ends what is marked so: also where it came a moment before."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from mech_twin.kernels.kernel import kernel
from mech_twin.process.interruption import StopSignal, closed_first, raising_interrupt

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_that_came_before_ends_what_is_marked_as_it_begins(number: signal.Signals) -> None:
    begun = []
    with StopSignal() as stop:
        os.kill(os.getpid(), number)
        assert stop.asked
        with pytest.raises(SystemExit) as ended, stop.interrupting():
            begun.append(True)
    assert ended.value.code == 128 + number
    assert not begun


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_beside_what_is_marked_asks_to_stop_and_no_more(number: signal.Signals) -> None:
    with StopSignal() as stop:
        with stop.interrupting():
            pass
        os.kill(os.getpid(), number)
        assert stop.asked


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_while_something_opens_lets_it_be_used_and_closed(number: signal.Signals) -> None:
    with StopSignal() as stop, stop.interrupting():
        with closed_first():
            os.kill(os.getpid(), number)
        assert stop.asked


class Sum(NamedTuple):
    """The result of a kernel."""

    value: float


@kernel
def long_sum(count: int) -> Sum:
    """Return a sum that takes a while."""
    value = 0.0
    for index in range(count):
        value += (index * 0.5) % 3.0
    return Sum(value)


@pytest.fixture
def pythons_own_ctrl_c() -> Iterator[None]:
    """Let Ctrl-C do what it does in a new process: the tests before may have turned it off."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("pythons_own_ctrl_c")
def test_ctrl_c_ends_a_row_of_long_kernels_whose_results_are_tuples() -> None:
    """It is seen first where a result is wrapped, which must not be interrupted, each time."""
    long_sum(1)
    started = time.monotonic()
    long_sum(1_000_000)
    count = int(1_000_000 * 0.05 / (time.monotonic() - started))  # 50 ms: ten times what a signal waits for
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    calls = 0
    with pytest.raises(KeyboardInterrupt), raising_interrupt():
        while calls < 200:
            long_sum(count)
            calls += 1
    assert calls < 10

# SPDX-License-Identifier: Apache-2.0
"""A signal is a request to stop, or ends what is marked so: also where it came a moment before."""

from __future__ import annotations

import os
import signal

import pytest

from mech_twin.stop_signal import StopSignal

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

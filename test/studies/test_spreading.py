# SPDX-License-Identifier: Apache-2.0
"""Work spread over processes: nothing of it is left once the results are taken."""

from __future__ import annotations

import os
import signal
import threading
import time
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress

from mech_twin.studies.spreading import NICE, BesideProcess, spread


def test_no_thread_that_holds_semaphores_outlives_the_last_result() -> None:
    """A command ends right after its results; what such a thread held would be called leaked on the terminal."""
    for _ in range(3):
        assert sorted(spread(abs, [-1, 2, -3], 2)) == [1, 2, 3]
        assert "_ExecutorManagerThread" not in {type(thread).__name__ for thread in threading.enumerate()}


def test_what_computes_beside_has_low_priority_and_is_replaced_when_it_dies() -> None:
    beside = BesideProcess()
    try:
        own = os.getpriority(os.PRIO_PROCESS, 0)
        assert beside.submit(os.getpriority, os.PRIO_PROCESS, 0).result(60) == own + NICE
        process = beside.submit(os.getpid).result(60)
        assert process != os.getpid()
        os.kill(process, signal.SIGKILL)
        with suppress(BrokenProcessPool):
            beside.submit(time.sleep, 0.0).result(60)  # it may be sent before the death is seen
        assert beside.submit(os.getpid).result(60) not in (process, os.getpid())
    finally:
        beside.end()

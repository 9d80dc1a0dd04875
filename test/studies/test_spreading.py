# SPDX-License-Identifier: Apache-2.0
"""Work spread over processes: nothing of it is left once the results are taken."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path

import pytest

from mech_twin.studies.spreading import NICE, BesideProcess, spread


@pytest.mark.slow
def test_no_thread_that_holds_semaphores_outlives_the_last_result() -> None:
    """A command ends right after its results; what such a thread held would be called leaked on the terminal."""
    for _ in range(3):
        assert sorted(spread(abs, [-1, 2, -3], 2)) == [1, 2, 3]
        assert "_ExecutorManagerThread" not in {type(thread).__name__ for thread in threading.enumerate()}


def test_a_script_without_a_guard_is_run_once(tmp_path: Path) -> None:
    script = tmp_path / "plain.py"
    script.write_text(
        "from mech_twin.studies.spreading import spread\nprint(sorted(spread(abs, [-1, 2, -3], 2)))\n",
        encoding="utf-8",
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ("[1, 2, 3]\n", "", 0)


def test_a_function_of_the_script_itself_is_found_by_the_workers(tmp_path: Path) -> None:
    script = tmp_path / "guarded.py"
    script.write_text(
        "from functools import partial\n"
        "from mech_twin.studies.spreading import spread\n"
        "def less(a, b): return b - a\n"
        "if __name__ == '__main__': print(sorted(spread(partial(less, 1), [1, 2, 3], 2)))\n",
        encoding="utf-8",
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ("[0, 1, 2]\n", "", 0)


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

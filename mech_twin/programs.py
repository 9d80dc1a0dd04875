# SPDX-License-Identifier: Apache-2.0
"""Entry points of all programs of the package: they install signal handlers before any large import.

Importing the libraries takes up to 1 s.  No file is open then, so a signal ends the process at once; later code sets
its own handlers (`mech_twin.process.interruption`).

A fifth of that time would go into looking for garbage that loading does not leave, so the collector runs less often.

Linear algebra runs in the calling thread unless the user says otherwise: matrices here are small, and further threads
wait for each other, beside a study's own on all cores three times as long as they compute.
"""

import gc
import os
import signal
from functools import partial
from types import FrameType
from typing import Any

from mech_twin.process.interruption import EXIT_CODE_BASE, answered_signals, end_at_once, tell_interrupted
from mech_twin.process.terminal_output import outlive_terminal

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is imported


def end_by_signal() -> None:
    """Let signal N end this process at once with code 128 + N and no traceback, and unblock a pending signal."""
    numbers = answered_signals()
    for number in numbers:
        signal.signal(number, _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


def _begin() -> None:
    end_by_signal()
    outlive_terminal()
    gc.set_threshold(50_000, 20, 50)


def command() -> None:
    """Run the ``mech-twin`` command; after it has closed its files, end without the interpreter's shutdown."""
    _begin()
    from mech_twin.cli.main import main

    try:
        main()
    except SystemExit as end:
        if isinstance(end.code, int):
            end_at_once(end.code)
        raise


def _end(number: int, frame: FrameType | None) -> None:
    if number == signal.SIGINT:
        tell_interrupted()
    end_at_once(EXIT_CODE_BASE + number)


def _node(name: str) -> Any:
    _begin()
    from mech_twin.nodes.run import executables

    return getattr(executables, name)()


motor_node = partial(_node, "motor_node")
linkage_node = partial(_node, "linkage_node")
force_node = partial(_node, "force_node")
body_node = partial(_node, "body_node")
frames_node = partial(_node, "frames_node")
recorder_node = partial(_node, "recorder_node")
viewer_node = partial(_node, "viewer_node")

# SPDX-License-Identifier: Apache-2.0
"""Where every program of the package begins: it answers a signal before anything large is imported.

To import the libraries takes up to a second.  Nothing is open then, so the process ends at once; what comes after sets
handlers of its own (`mech_twin.process.stop_signal`).
"""

from __future__ import annotations

import signal
from functools import partial
from types import FrameType
from typing import Any

from mech_twin.process.interruption import EXIT_CODE_BASE, answered_signals, end_at_once, tell_interrupted
from mech_twin.process.terminal_output import outlive_terminal


def end_by_signal() -> None:
    """From here on end this process at once with 128 + N after signal N, without a trace; also after one held back."""
    numbers = answered_signals()
    for number in numbers:
        signal.signal(number, _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


def command() -> None:
    """Run the ``mech-twin`` command; at its end all is closed, and nothing is waited for."""
    end_by_signal()
    outlive_terminal()
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
    end_by_signal()
    outlive_terminal()
    from mech_twin.nodes.run import executables

    return getattr(executables, name)()


motor_node = partial(_node, "motor_node")
linkage_node = partial(_node, "linkage_node")
force_node = partial(_node, "force_node")
body_node = partial(_node, "body_node")
frames_node = partial(_node, "frames_node")
recorder_node = partial(_node, "recorder_node")
viewer_node = partial(_node, "viewer_node")

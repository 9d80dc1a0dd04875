# SPDX-License-Identifier: Apache-2.0
"""Error reporting: one line on standard error; exit code 2 for errors in the input, 3 for a recording with losses."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mech_twin.process.dependencies import lacking, missing_extra
from mech_twin.process.interruption import EXIT_CODE_BASE, INTERRUPTED_LINE
from mech_twin.process.stop_signal import interruptible
from mech_twin.process.terminal_output import StandardOutputError, give_up_output, printable

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

EXIT_CODE = 2
LOSS_EXIT_CODE = 3
FOUND = 1  # exit code of a verb that found what it looks for: a difference, a fault, a broken residual
STANDARD_ERROR = 2
_NO_MEMORY_LINE = b"mech-twin: not enough memory to clean up\n"
INTERRUPTED = EXIT_CODE_BASE + signal.SIGINT
UNREAD = EXIT_CODE_BASE + signal.SIGPIPE  # of a command whose output nobody reads to its end, as of other tools


class CommandError(Exception):
    """A command that cannot be carried out as given; the message is one line."""


def report_losses(*recordings: Path | None, known: Sequence[str] = ()) -> None:
    """Say what recordings just made have lost, and end with an exit code of its own if anything."""
    made = [recording for recording in recordings if recording is not None]
    losses = list(known)
    if made:
        from mech_twin.recording.bag_reader import lost_messages

        losses += filter(None, map(lost_messages, made))
    for lost in losses:
        sys.stderr.write(f"mech-twin: {lost}\n")
    if losses:
        raise SystemExit(LOSS_EXIT_CODE)


def messages_in(recording: Path | None) -> dict[str, int]:
    """Return how many messages of each topic a recording just made holds; none where there is none to read."""
    if recording is None or not recording.exists():
        return {}
    from mech_twin.recording.bag_reader import bag_info
    from mech_twin.recording.errors import BagError

    try:
        return {name: topic.message_count for name, topic in bag_info(recording).topics.items()}
    except BagError:  # `report_losses` says it
        return {}


def _without_memory(unraisable: UnraisableHookArgs) -> None:
    """Tell of a finalizer or a callback that found no memory in one line, made before; of all others as Python does."""
    if unraisable.exc_type is MemoryError:
        os.write(STANDARD_ERROR, _NO_MEMORY_LINE)
        return
    sys.__unraisablehook__(unraisable)


@contextmanager
def report_cli_errors() -> Iterator[None]:
    """Report errors in the input and signals in one line; internal errors keep their traceback."""
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _without_memory  # to the end of the process: finalizers run at its exit too
    try:
        with interruptible():
            yield
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not disturb the clean-up at exit
        sys.stderr.write(INTERRUPTED_LINE)
        raise SystemExit(INTERRUPTED) from None
    except (BrokenPipeError, SystemExit) as end:  # who reads has had enough, or so the libraries say by an exit
        if isinstance(end, SystemExit) and not isinstance(end.__context__, BrokenPipeError):
            raise
        give_up_output()
        raise SystemExit(UNREAD) from None
    except Exception as error:
        if isinstance(error, StandardOutputError):
            give_up_output()
        message = lacking(error) or _told(error)
        if message is None:
            raise
        sys.stderr.write(f"mech-twin: {printable(' '.join(message.split()))}\n")
        raise SystemExit(EXIT_CODE) from error


def _in_directory() -> bool:
    """Return whether the working directory exists; libraries look for it while they are loaded."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return False
    return True


def _told(error: Exception) -> str | None:
    """Return what is said of an error in the input; None of an internal one."""
    if isinstance(error, ImportError):
        return missing_extra(error)
    if isinstance(error, FileNotFoundError) and not _in_directory():
        return "the working directory does not exist any more: change to another one"
    from mech_twin.declarations.configuration_tree import ConfigurationError
    from mech_twin.errors import MeasurementError, MotionError, RerunSceneError, StudyError, ViewerError
    from mech_twin.files.output_file import OutputError
    from mech_twin.nodes.run.domain import NodeEndedError
    from mech_twin.recording.errors import BagError

    kinds = (CommandError, StandardOutputError, NodeEndedError, ConfigurationError, MotionError, StudyError)
    known = isinstance(error, (*kinds, MeasurementError, BagError, OutputError, RerunSceneError, ViewerError))
    return str(error) if known else None

# SPDX-License-Identifier: Apache-2.0
"""Error reporting: one line on standard error; exit code 2 for errors in the input, 128 + N after signal N."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mech_twin.dependencies import missing_extra
from mech_twin.interruption import EXIT_CODE_BASE, INTERRUPTED_LINE
from mech_twin.stop_signal import interruptible
from mech_twin.surroundings import lacking

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

EXIT_CODE = 2
STANDARD_ERROR = 2
_NO_MEMORY_LINE = b"mech-twin: not enough memory to clean up\n"
INTERRUPTED = EXIT_CODE_BASE + signal.SIGINT


class CommandError(Exception):
    """A command that cannot be carried out as given; the message is one line."""


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
    except Exception as error:
        lack = lacking(error)
        if lack is not None:
            sys.stderr.write(f"mech-twin: {lack}\n")
            raise SystemExit(EXIT_CODE) from error
        if not _is_input_error(error):
            raise
        sys.stderr.write(f"mech-twin: {' '.join(_message(error).split())}\n")
        raise SystemExit(EXIT_CODE) from error


def _message(error: Exception) -> str:
    if isinstance(error, ImportError):
        return missing_extra(error) or str(error)
    return str(error)


def _is_input_error(error: Exception) -> bool:
    if isinstance(error, ImportError):
        return missing_extra(error) is not None
    from mech_twin.capabilities.errors import StudyError
    from mech_twin.configuration_tree import ConfigurationError
    from mech_twin.engine.errors import MotionError
    from mech_twin.measurements.errors import MeasurementError
    from mech_twin.nodes.errors import NodeEndedError
    from mech_twin.output_file import OutputError
    from mech_twin.recording.errors import BagError
    from mech_twin.view.errors import RerunSceneError
    from mech_twin.view.viewer_process import ViewerError

    kinds = (CommandError, NodeEndedError, ConfigurationError, MotionError, StudyError)
    return isinstance(error, (*kinds, MeasurementError, BagError, OutputError, RerunSceneError, ViewerError))

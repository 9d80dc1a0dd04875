# SPDX-License-Identifier: Apache-2.0
"""rerun recording streams to a file."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import rerun as rr

from mech_twin.files.output_file import FILE_MODE
from mech_twin.view.curves import SIM_TIME, STEP
from mech_twin.view.errors import RerunSceneError

FLUSH_S = 0.1  # drawings within this time (s) go into one chunk of the file


def opened_stream(application_id: str, rrd_path: str | Path) -> rr.RecordingStream:
    """Return a new stream to a file.

    Raises
    ------
    RerunSceneError
        The file cannot be created; one line.
    """
    stream = rr.RecordingStream(application_id, batcher_config=rr.ChunkBatcherConfig(flush_tick=FLUSH_S))
    _create_file(Path(rrd_path))
    try:
        stream.set_sinks(rr.FileSink(str(rrd_path)))
    except RuntimeError as reason:
        raise RerunSceneError(f"view: file {rrd_path}: cannot be written: {first_line(reason)}") from reason
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


def set_time(stream: rr.RecordingStream, time_s: float, step: int | None = None) -> None:
    """Set the time (s) and the step of the data logged next."""
    stream.reset_time()
    stream.set_time(SIM_TIME, duration=np.timedelta64(round(time_s * 1e9), "ns"))
    if step is not None:
        stream.set_time(STEP, sequence=step)


def closed_stream(stream: rr.RecordingStream, limit_s: float) -> None:
    """Write the remaining data, and close the file.

    Raises
    ------
    RerunSceneError
        It could not be written completely.
    """
    try:
        stream.flush(timeout_sec=limit_s)
    except (RuntimeError, ValueError) as reason:
        raise RerunSceneError(f"view: the file could not be written completely: {first_line(reason)}") from reason
    finally:
        stream.disconnect()


def first_line(reason: Exception) -> str:
    """Return the first line of an error's message."""
    return str(reason).partition("\n")[0]


def _create_file(path: Path) -> None:
    """Create the file, or check that it is a regular one: rerun itself would follow a symbolic link."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_NOFOLLOW | os.O_WRONLY | os.O_CLOEXEC, FILE_MODE))
    except OSError as reason:
        raise RerunSceneError(f"view: file {path}: cannot be written: {reason.strerror}") from reason

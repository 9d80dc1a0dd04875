# SPDX-License-Identifier: Apache-2.0
"""Recording streams of rerun, into a file or to a running viewer."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import rerun as rr

from mech_twin.output_file import FILE_MODE
from mech_twin.view.curves import SIM_TIME, STEP
from mech_twin.view.errors import RerunSceneError

FLUSH_S = 0.1  # drawings of this time (s) go to the viewer in one message


def opened_stream(application_id: str, grpc_url: str | None, rrd_path: str | Path | None) -> rr.RecordingStream:
    """Return a new stream to a viewer, into a file, or both.

    Raises
    ------
    RerunSceneError
        The file cannot be created; one line.
    """
    stream = rr.RecordingStream(application_id, batcher_config=rr.ChunkBatcherConfig(flush_tick=FLUSH_S))
    if rrd_path is not None:
        _create_file(Path(rrd_path))
    sinks: list[rr.GrpcSink | rr.FileSink] = []
    if grpc_url is not None:
        sinks.append(rr.GrpcSink(grpc_url))
    if rrd_path is not None:
        sinks.append(rr.FileSink(str(rrd_path)))
    try:
        stream.set_sinks(*sinks)
    except RuntimeError as reason:
        target = f"file {rrd_path}" if rrd_path is not None else grpc_url
        raise RerunSceneError(f"view: {target}: cannot be written: {first_line(reason)}") from reason
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


def set_time(stream: rr.RecordingStream, time_s: float, step: int | None = None) -> None:
    """Set the time (s), and the step, of what is logged next."""
    stream.reset_time()
    stream.set_time(SIM_TIME, duration=np.timedelta64(round(time_s * 1e9), "ns"))
    if step is not None:
        stream.set_time(STEP, sequence=step)


def closed_stream(stream: rr.RecordingStream, limit_s: float, *, live: bool) -> bool:
    """Send what is left, wait up to a limit, disconnect; return whether everything was accepted.

    Raises
    ------
    RerunSceneError
        There is no viewer, only a file, and it could not be written completely.
    """
    try:
        stream.flush(timeout_sec=limit_s)
    except (RuntimeError, ValueError) as reason:
        if not live:
            raise RerunSceneError(f"view: the file could not be written completely: {first_line(reason)}") from reason
        return False
    finally:
        stream.disconnect()
    return True


def first_line(reason: Exception) -> str:
    """Return the first line of an error's message."""
    return str(reason).partition("\n")[0]


def _create_file(path: Path) -> None:
    """Create the file, or check that it is a regular one: rerun itself would follow a symbolic link."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_NOFOLLOW | os.O_WRONLY | os.O_CLOEXEC, FILE_MODE))
    except OSError as reason:
        raise RerunSceneError(f"view: file {path}: cannot be written: {reason.strerror}") from reason

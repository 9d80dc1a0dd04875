# SPDX-License-Identifier: Apache-2.0
"""Decompresses files and messages compressed by rosbag2, recognised by their content, not by metadata."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import zstandard

from mech_twin.files.input_file import opened_input
from mech_twin.recording.errors import BagBeyondLimitsError, DamagedBagError, MissingBagError
from mech_twin.recording.mcap_records import MAX_RECORD_BYTES, UnreadableRecordError

ZSTD_SUFFIX = ".zstd"
_FRAME = b"\x28\xb5\x2f\xfd"  # magic number of zstd; a CDR message begins with a zero
_PIECE_BYTES = 1 << 12  # compressed bytes read at once; decompressed at most about 128 MiB
_SHARE_OF_DISK = 0.9  # of the free disk space that may be used


def plain_message(raw: bytes) -> bytes:
    """Return a message, decompressed if it is compressed individually.

    Raises
    ------
    UnreadableRecordError
        It cannot be decompressed, or would be too large.
    """
    if raw[:4] != _FRAME:
        return raw
    try:
        size = zstandard.get_frame_parameters(raw).content_size
        if size != zstandard.CONTENTSIZE_UNKNOWN and size > MAX_RECORD_BYTES:
            raise UnreadableRecordError(f"a compressed message of {size} bytes, more than {MAX_RECORD_BYTES}")
        return zstandard.ZstdDecompressor().decompress(raw, max_output_size=MAX_RECORD_BYTES)
    except (zstandard.ZstdError, MemoryError) as error:
        raise UnreadableRecordError(f"a message that cannot be decompressed ({error})") from error


def plain_file(path: Path, stack: ExitStack, *, partial: bool = False) -> Path:
    """Return the path of a file, or of a decompressed temporary copy if its suffix is `.zstd`.

    Parameters
    ----------
    path : Path
        The file.
    stack : ExitStack
        Deletes the copy when it closes.
    partial : bool
        Accept a damaged file up to the damage.

    Raises
    ------
    DamagedBagError, BagBeyondLimitsError, MissingBagError
        It cannot be decompressed, its content does not fit the disk, or it cannot be read.
    """
    if path.suffix != ZSTD_SUFFIX:
        return path
    directory = stack.enter_context(tempfile.TemporaryDirectory(prefix="mech_twin_bag_"))
    made = Path(directory) / path.with_suffix("").name
    room = _SHARE_OF_DISK * shutil.disk_usage(directory).free
    try:
        with opened_input(path) as source, made.open("wb") as target:
            for piece in _content(path, source, partial):
                room -= len(piece)
                if room < 0:
                    raise BagBeyondLimitsError(path, f"its content does not fit the disk of {directory}")
                target.write(piece)
    except zstandard.ZstdError as error:
        if not partial:
            raise DamagedBagError(path, f"cannot be decompressed ({error})") from error
    except OSError as error:
        raise MissingBagError(path, f"cannot be read ({error.strerror})") from error
    return made


def _content(path: Path, source: BinaryIO, partial: bool) -> Iterator[bytes]:
    """Yield the decompressed content of a file of one or more frames, in pieces."""
    frame = zstandard.ZstdDecompressor().decompressobj()
    while data := source.read(_PIECE_BYTES):
        while data:
            if frame.eof:
                frame = zstandard.ZstdDecompressor().decompressobj()
            yield frame.decompress(data)
            data = frame.unused_data if frame.eof else b""
    if not frame.eof and not partial:
        raise DamagedBagError(path, "ends within its compressed content")

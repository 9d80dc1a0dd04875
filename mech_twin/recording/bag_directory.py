# SPDX-License-Identifier: Apache-2.0
"""Finds, orders, opens and decompresses the files of a rosbag2 directory; refuses files outside it.

Readers hold files open until they are closed.  Compressed files and messages are recognised by their content.
"""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import zstandard

from mech_twin.files.input_file import opened_input
from mech_twin.recording.errors import BagBeyondLimitsError, DamagedBagError, MissingBagError, OutsideBagError
from mech_twin.recording.record_file import MAX_RECORD_BYTES, UnreadableRecordError

ZSTD_SUFFIX = ".zstd"
_FRAME = b"\x28\xb5\x2f\xfd"  # magic number of zstd; a CDR message begins with a zero
_PIECE_BYTES = 1 << 12  # compressed bytes read at once; decompressed at most about 128 MiB
_SHARE_OF_DISK = 0.9  # of the free disk space that may be used
MCAP_SUFFIX = ".mcap"
SQLITE_SUFFIX = ".db3"
MOST_PARTS = 10_000


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


def is_sqlite_bag(path: Path) -> bool:
    """Whether a path is a `.db3` file, or a directory with such files and no MCAP file; compressed ones too."""
    if path.is_dir():
        return bool(parts(path, SQLITE_SUFFIX)) and not parts(path, MCAP_SUFFIX)
    return path.name.removesuffix(ZSTD_SUFFIX).endswith(SQLITE_SUFFIX)


def is_named_as_bag(path: Path) -> bool:
    """Whether a path is named as a recording: a file of one, or a directory with such files; compressed ones too."""
    if path.is_dir():
        return bool(parts(path, MCAP_SUFFIX) or parts(path, SQLITE_SUFFIX))
    return path.name.removesuffix(ZSTD_SUFFIX).endswith((MCAP_SUFFIX, SQLITE_SUFFIX))


def parts(directory: Path, suffix: str) -> list[Path]:
    """Return the files of a bag in order of their number; a plain file is preferred to its compressed copy."""
    plain = list(directory.glob(f"*{suffix}"))
    held = {path.name for path in plain}
    packed = (path for path in directory.glob(f"*{suffix}{ZSTD_SUFFIX}"))
    return sorted((*plain, *(path for path in packed if path.with_suffix("").name not in held)), key=split_order)


def inside(directory: Path, file: Path) -> Path:
    """Return the file, which must lie in this directory also after resolving symbolic links.

    Raises
    ------
    OutsideBagError
        It lies elsewhere.
    """
    try:
        resolved = file.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a null byte
        raise OutsideBagError(file, f"cannot be resolved ({error})") from error
    if resolved.parent != directory.resolve():
        raise OutsideBagError(file, f"leads out of the bag's directory, to {resolved}")
    return file


def bag_files(path: Path, suffix: str = MCAP_SUFFIX) -> list[Path]:
    """Return the files of a bag in order of their number, without consulting `metadata.yaml`.

    Raises
    ------
    MissingBagError, OutsideBagError
        There is no such bag, it has no file of this suffix, or a file of it is a link out of its directory.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise MissingBagError(path, "is not a regular file" if path.exists() else "there is no such bag")
    files = [inside(path, file) for file in parts(path, suffix)]
    if not files:
        raise MissingBagError(path, f"holds no {suffix} file{conversion(path)}")
    return files


def conversion(path: Path) -> str:
    """Return what makes a bag in sqlite3 storage one of MCAP files; empty for another."""
    return "; convert sqlite3 storage with `ros2 bag convert` or `rosbags-convert`" if is_sqlite_bag(path) else ""


def missing_parts(path: Path, files: list[Path]) -> list[str]:
    """Return a line for each gap in the numbers of a bag's files; missing files at the end are not detected."""
    own = {split_order(file)[0]: file for file in files if file.name.startswith(f"{path.name}_")}
    last = max(own, default=-1)
    if last >= MOST_PARTS:
        return []
    ending = "".join(own[last].suffixes[-2:]) if last >= 0 else ""
    ending = ending if ending.endswith(ZSTD_SUFFIX) else ending[ending.rfind(".") :]
    return [f"{path}: its part {path.name}_{number}{ending} is missing" for number in range(last) if number not in own]


def split_order(path: Path) -> tuple[int, str]:
    """Return the sort key of a file by the number at the end of its name."""
    number = Path(path.name.removesuffix(ZSTD_SUFFIX)).stem.rpartition("_")[2]
    return (int(number) if number.isascii() and number.isdigit() and len(number) < 10 else -1, path.name)

# SPDX-License-Identifier: Apache-2.0
"""Finds and orders the files of a rosbag2 directory; refuses files outside it."""

from __future__ import annotations

from pathlib import Path

from mech_twin.recording.compression import ZSTD_SUFFIX
from mech_twin.recording.errors import MissingBagError, OutsideBagError

MCAP_SUFFIX = ".mcap"
SQLITE_SUFFIX = ".db3"
MOST_PARTS = 10_000


def is_sqlite_bag(path: Path) -> bool:
    """Whether a path is a `.db3` file, or a directory with such files and no MCAP file; compressed ones too."""
    if path.is_dir():
        return bool(parts(path, SQLITE_SUFFIX)) and not parts(path, MCAP_SUFFIX)
    return path.name.removesuffix(ZSTD_SUFFIX).endswith(SQLITE_SUFFIX)


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


def bag_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag in order of their number, without consulting `metadata.yaml`.

    Raises
    ------
    MissingBagError, OutsideBagError
        There is no such bag, it has no MCAP file, or a file of it is a link out of its directory.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise MissingBagError(path, "is not a regular file" if path.exists() else "there is no such bag")
    files = [inside(path, file) for file in parts(path, MCAP_SUFFIX)]
    if not files:
        hint = "; convert sqlite3 storage with `ros2 bag convert` or `rosbags-convert`" if is_sqlite_bag(path) else ""
        raise MissingBagError(path, f"holds no .mcap file{hint}")
    return files


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

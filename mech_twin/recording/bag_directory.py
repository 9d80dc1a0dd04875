# SPDX-License-Identifier: Apache-2.0
"""The files of a rosbag2 directory: found, ordered, and never outside it."""

from __future__ import annotations

from pathlib import Path

from mech_twin.recording.errors import MissingBagError, OutsideBagError

SQLITE_SUFFIX = ".db3"


def is_sqlite_bag(path: Path) -> bool:
    """Whether a path is a `.db3` file, or a directory with such files and no MCAP file."""
    if path.is_dir():
        return any(path.glob(f"*{SQLITE_SUFFIX}")) and not any(path.glob("*.mcap"))
    return path.suffix == SQLITE_SUFFIX


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
        raise MissingBagError(path, "there is no such bag")
    files = sorted((inside(path, file) for file in path.glob("*.mcap")), key=split_order)
    if not files:
        hint = (
            "; convert sqlite3 storage with `ros2 bag convert` or `rosbags-convert`" if any(path.glob("*.db3")) else ""
        )
        raise MissingBagError(path, f"holds no .mcap file{hint}")
    return files


def split_order(path: Path) -> tuple[int, str]:
    """Return the sort key of a file by the number at the end of its name."""
    number = path.stem.rpartition("_")[2]
    return (int(number) if number.isascii() and number.isdigit() and len(number) < 10 else -1, path.name)

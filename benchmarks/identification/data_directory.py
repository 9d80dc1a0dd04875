# SPDX-License-Identifier: Apache-2.0
"""Directories of measured data that are no part of this project, given on the command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path


def given_directory(about: str | None, names: Sequence[str]) -> Path:
    """Return the directory that the command line names; end with one line where a file is not in it."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path)
    folder: Path = parser.parse_args().directory
    if missing := [name for name in names if not (folder / name).is_file()]:
        parser.error(f"{folder}: expected {', '.join(names)}, found no {', '.join(missing)}")
    return folder

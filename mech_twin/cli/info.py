"""``mech-twin info``."""

from __future__ import annotations

from pathlib import Path


def show_info(bag: Path, *, as_json: bool) -> None:
    """Write what a recording holds, and what it lost."""
    raise NotImplementedError(bag)

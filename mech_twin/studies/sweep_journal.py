# SPDX-License-Identifier: Apache-2.0
"""Journal of a sweep: stores finished points on disk, so that an interrupted sweep can be resumed.

The file has one JSON document per line: first the question, then each finished point.  A line that was cut off by an
interruption is dropped.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mech_twin.capabilities.errors import StudyError
from mech_twin.studies.sweep_points import Point, Question


class SweepJournal:
    """The finished points of one question; a repeated index is ignored."""

    def __init__(self, path: Path, asked: Question) -> None:
        self._path = path
        self._head = json.loads(json.dumps(asdict(asked)))
        self.finished: dict[int, Point] = {}
        if path.exists():
            self._resume()
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(self._head) + "\n", encoding="utf-8")
        self._stream = path.open("a", encoding="utf-8")

    def _resume(self) -> None:
        text = self._path.read_bytes()
        whole = text[: text.rfind(b"\n") + 1]
        lines = whole.decode("utf-8").splitlines()
        if not lines or json.loads(lines[0]) != self._head:
            raise StudyError(f"{self._path}: holds points of another sweep; remove it or write elsewhere")
        if len(whole) < len(text):
            with self._path.open("r+b") as stream:
                stream.truncate(len(whole))
        for line in lines[1:]:
            found = _point(json.loads(line))
            self.finished.setdefault(found.index, found)

    def add(self, found: Iterable[Point]) -> int:
        """Write points that are new; return their number."""
        fresh = [point for point in found if point.index not in self.finished]
        for point in fresh:
            self.finished[point.index] = point
            numbers = {name: value if math.isfinite(value) else repr(value) for name, value in point.numbers.items()}
            self._stream.write(json.dumps({"index": point.index, "numbers": numbers, "refused": point.refused}) + "\n")
        self._stream.flush()
        return len(fresh)

    def close(self) -> None:
        """Close the file, without removing it."""
        self._stream.close()

    def remove(self) -> None:
        """Close and remove the file, after the table of the sweep was written."""
        self.close()
        self._path.unlink()


def _point(record: dict[str, Any]) -> Point:
    return Point(record["index"], {name: float(v) for name, v in record["numbers"].items()}, record["refused"])

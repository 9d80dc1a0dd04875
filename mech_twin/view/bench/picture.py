# SPDX-License-Identifier: Apache-2.0
"""Pictures as sent to a page: drawing, curves and state of one time, with numbers packed in base 64."""

import base64
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mech_twin.declarations.captions import caption
from mech_twin.samples import Shape

# numbers with these words are shown first; the others follow in the machine's order
FIRST_WORDS = (
    *("blow_energy", "blow_rate", "seated", "contact_share", "missed", "impact_speed", "power_mean", "motor_power"),
    *("torque_peak", "torque_max", "speed_mean"),
)


class Curves(NamedTuple):
    """Curves with common times: names and values of shape (n, k), and the steps where a viewer is to know them."""

    path: str
    names: tuple[str, ...]
    time_s: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]
    step: npt.NDArray[np.int64] | None = None


class Panel(NamedTuple):
    """A plot: its title with the unit, and the entity paths of its curves."""

    title: str
    paths: tuple[str, ...]


def packed_shapes(shapes: Iterable[Shape]) -> dict[str, Any]:
    """Return shapes: kinds, colours, widths, texts, numbers of points, and all points in one array of 32-bit floats."""
    kept = [shape for shape in shapes if shape.points_m]
    points = [point for shape in kept for point in shape.points_m]
    return {
        "kinds": "".join(shape.kind[0] for shape in kept),
        "colours": [shape.colour for shape in kept],
        "widths": [round(shape.width_m, 6) for shape in kept],
        "texts": [shape.text for shape in kept],
        "counts": [len(shape.points_m) for shape in kept],
        "points": packed(np.array(points, dtype=np.float64).reshape(-1, 2), "<f4"),
    }


def packed_curves(curves: Iterable[Curves]) -> dict[str, list[str]]:
    """Return for each path the packed times (float64) and, row by row, the values (float32)."""
    return {each.path: [packed(each.time_s, "<f8"), packed(each.values, "<f4")] for each in curves}


def packed(values: npt.NDArray[np.float64], kind: str) -> str:
    """Return numbers of a NumPy type as base 64 text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def packed_layout(panels: Sequence[Panel], names: Mapping[str, tuple[str, ...]]) -> dict[str, Any]:
    """Return the plots and the names of their curves."""
    shown = [
        {"title": panel.title, "curves": [{"path": path, "names": names[path]} for path in panel.paths]}
        for panel in panels
    ]
    return {"panels": shown}


def metric_rows(numbers: Mapping[str, float]) -> list[list[str]]:
    """Return name, value (four digits) and unit of a run's numbers, sorted: shortest name of each first word first."""
    first = [min((name for name in numbers if word in name), key=len, default="") for word in FIRST_WORDS]
    rows = []
    for name in dict.fromkeys((*filter(None, first), *numbers)):
        words, unit = caption(name)
        rows.append([words, f"{numbers[name]:.4g}", unit])
    return rows


BATCH_BYTES = 1 << 20  # largest size of the pictures in one message


class Pictures:
    """Queue of pictures, bounded in bytes: the oldest are dropped."""

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes, self._bytes = most_bytes, 0
        self._kept: deque[bytes] = deque()

    def add(self, picture: bytes) -> None:
        """Store a picture."""
        self._kept.append(picture)
        self._bytes += len(picture)
        while self._bytes > self.most_bytes and len(self._kept) > 1:
            self._bytes -= len(self._kept.popleft())

    def clear(self) -> None:
        """Remove all pictures."""
        self._kept.clear()
        self._bytes = 0

    def take(self) -> list[bytes]:
        """Remove and return the oldest pictures up to `BATCH_BYTES`, at least one."""
        taken = [self._kept.popleft()]
        size = len(taken[0])
        while self._kept and size + len(self._kept[0]) <= BATCH_BYTES:
            taken.append(self._kept.popleft())
            size += len(taken[-1])
        self._bytes -= size
        return taken

    def __iter__(self) -> Any:
        return iter(self._kept)

    def __len__(self) -> int:
        return len(self._kept)

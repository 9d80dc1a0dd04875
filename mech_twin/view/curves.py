# SPDX-License-Identifier: Apache-2.0
"""Time series of the samples, and how they are logged to rerun.

Curves that belong together (one quantity of all joints, one component of all pins) share one entity, one time column
and one call, which is several times cheaper than one call per curve.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr

from mech_twin.captions import caption, titled
from mech_twin.samples import BodySample, ForceSample, LinkageSample, MotorSample
from mech_twin.view.decimation import extreme_rows, worst_values

SIM_TIME = "sim_time"
STEP = "step"

# legible on dark and light backgrounds, distinguishable by colour-blind readers (after Okabe and Ito)
PALETTE = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 178, 130),
    (204, 121, 167),
    (213, 94, 0),
    (120, 120, 235),
    (178, 168, 40),
    (150, 150, 150),
)
# groups that share a panel with others start at a later palette colour
FIRST_COLOUR = {
    "motor/torque": 4,
    "motor/speed": 4,
    "linkage_sliding/speed": 2,
    "linkage_sliding/position": 2,
    "body/effort": 1,
    "residuals/forces": 3,
    "residuals/body": 6,
}
RESIDUAL_FLOOR = 1e-18
WORST_WINDOWS = 5


class Group(NamedTuple):
    """Curves with common time stamps: entity path, names, and values of shape (n, k).

    With ``worst``, only the largest value of each window is drawn.
    """

    path: str
    names: tuple[str, ...]
    values: npt.NDArray[np.float64]
    worst: bool = False
    unit: str = ""


Sample = TypeVar("Sample", bound=MotorSample | LinkageSample | ForceSample | BodySample)
Groups = list[Group]


class Times(NamedTuple):
    """A time column for rerun; its own ``TimeColumn`` is thirty times slower for durations."""

    name: str
    values: pa.Array

    def timeline_name(self) -> str:
        """Return the name of the timeline."""
        return self.name

    def as_arrow_array(self) -> pa.Array:
        """Return the times."""
        return self.values


def times(time_s: npt.ArrayLike, step: npt.ArrayLike | None = None) -> list[Times]:
    """Return the time columns: simulation time (rounded to nanoseconds) and, if given, the step."""
    nanoseconds = np.round(np.asarray(time_s, dtype=np.float64) * 1e9).astype(np.int64)
    columns = [Times(SIM_TIME, pa.array(nanoseconds).view(pa.duration("ns")))]
    if step is not None:
        columns.append(Times(STEP, pa.array(np.asarray(step, dtype=np.int64))))
    return columns


def motor_groups(samples: Sequence[MotorSample], sliding: frozenset[str] = frozenset()) -> Groups:
    """Return speed and torque of the drive, where it slides its force, and the fraction of rated supply frequency."""
    joints = samples[0].joints
    columns = {
        "torque": _rows([sample.effort for sample in samples]),
        "speed": _rows([sample.velocity for sample in samples]),
    }
    return [
        *_by_unit_of_joint("motor", joints, columns, sliding),
        Group("motor/supply", ("supply fraction",), _rows([(sample.command,) for sample in samples])),
    ]


def linkage_groups(samples: Sequence[LinkageSample], sliding: frozenset[str] = frozenset()) -> Groups:
    """Return position, speed and effort of every joint, those that slide apart (m, not rad), and the residuals."""
    joints = samples[0].joints
    columns = {
        "position": _rows([sample.position for sample in samples]),
        "speed": _rows([sample.velocity for sample in samples]),
        "effort": _rows([sample.effort for sample in samples]),
    }
    return [*_by_unit_of_joint("linkage", joints, columns, sliding), *_residuals("linkage", samples)]


def force_groups(samples: Sequence[ForceSample]) -> Groups:
    """Return magnitude and components of every pin reaction, and the derived quantities, those of one unit together."""
    pins = samples[0].pins
    wrenches = np.array([sample.wrenches for sample in samples], dtype=np.float64).reshape(len(samples), len(pins), 3)
    force_x_n, force_y_n = wrenches[:, :, 0], wrenches[:, :, 1]
    groups = [
        Group("pins/magnitude", pins, np.hypot(force_x_n, force_y_n)),
        Group("pins/force_x", pins, force_x_n),
        Group("pins/force_y", pins, force_y_n),
        Group("body_moment", ("moment on the body",), _rows([(sample.body_moment_nm,) for sample in samples])),
    ]
    names = samples[0].quantities.names
    values = _rows([sample.quantities.values for sample in samples])
    for unit, columns in by_unit(names).items():
        chosen = tuple(caption(names[column])[0] for column in columns)
        groups.append(Group(quantity_path(unit), chosen, values[:, columns], unit=unit))
    return [*groups, *_residuals("forces", samples)]


def body_groups(samples: Sequence[BodySample]) -> Groups:
    """Return position, speed and spring moment of the body, its pressing force, and the residuals."""
    joints = samples[0].joints
    return [
        Group("body/position", joints, _rows([sample.position for sample in samples])),
        Group("body/speed", joints, _rows([sample.velocity for sample in samples])),
        Group("body/effort", joints, _rows([sample.effort for sample in samples])),
        Group("body/pressing_force", ("pressing force",), _rows([(sample.pressing_force_n,) for sample in samples])),
        *_residuals("body", samples),
    ]


def by_unit(names: Sequence[str]) -> dict[str, list[int]]:
    """Return, for each unit, the indices of the names with that unit."""
    places: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        places.setdefault(caption(name)[1], []).append(place)
    return places


def quantity_path(unit: str) -> str:
    """Return the entity path of the derived quantities of a unit: ``quantities/n_m`` for N m."""
    word = unit.replace("²", "2").replace("³", "3").replace("/", " per ").replace("%", "percent").lower()
    return "quantities/" + ("_".join(word.split()) or "number")


def _by_unit_of_joint(
    role: str, joints: tuple[str, ...], columns: Mapping[str, npt.NDArray[np.float64]], sliding: frozenset[str]
) -> Groups:
    """Return the columns of the joints that turn, and under a path of their own those of the joints that slide."""
    groups = []
    for path, slides in ((role, False), (f"{role}_sliding", True)):
        places = [place for place, joint in enumerate(joints) if (joint in sliding) == slides]
        chosen = tuple(joints[place] for place in places)
        groups += [Group(f"{path}/{kind}", chosen, values[:, places]) for kind, values in columns.items()]
    return groups


def _rows(values: Sequence[tuple[float, ...]]) -> npt.NDArray[np.float64]:
    return np.array(values, dtype=np.float64).reshape(len(values), -1)


def _residuals(role: str, samples: Sequence[Any]) -> Groups:
    """Return the decimal logarithm of the residuals, so that 1e-16 and 1e-9 are both visible."""
    names = samples[0].residuals.names
    if not names:
        return []
    values = np.abs(_rows([sample.residuals.values for sample in samples]))
    labels = tuple(f"log10 {titled(name)}" for name in names)
    return [Group(f"residuals/{role}", labels, np.log10(np.maximum(values, RESIDUAL_FLOOR)), worst=True)]


class Track(Generic[Sample]):
    """Buffers the samples of one role, decimates them and sends them to rerun in batches.

    Parameters
    ----------
    stream : rr.RecordingStream
        Destination of the curves.
    groups : callable
        Converts samples with equal names to groups of curves.
    window : int
        Samples per decimation window.
    batch_s : float
        Simulated time per batch.
    shown : callable
        Tells whether the curves of a path are to be sent.
    window_s : float
        Simulated time per decimation window, at least.
    is_open : callable
        Tells whether a batch may be sent now.
    kept_s : float
        Simulated time of samples kept while none may be sent; older ones are dropped.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        groups: Callable[[Sequence[Sample]], Groups],
        *,
        window: int,
        batch_s: float,
        shown: Callable[[str], bool],
        window_s: float = 0.0,
        is_open: Callable[[], bool] = lambda: True,
        kept_s: float = math.inf,
    ) -> None:
        self._stream = stream
        self._groups = groups
        self._shown = shown
        self._window = window
        self._window_s = window_s
        self._batch_s = batch_s
        self._is_open = is_open
        self._kept_s = kept_s
        self._pending: deque[Sample] = deque()
        self.curves: dict[str, tuple[str, ...]] = {}
        self.units: dict[str, str] = {}

    def add(self, sample: Sample) -> bool:
        """Take a sample; return whether a batch was sent because of it."""
        sent = False
        if self._pending and not _same_names(self._pending[0], sample):
            sent = self.flush()
        self._pending.append(sample)
        if sample.time_s - self._pending[0].time_s < self._batch_s:
            return sent
        if not self._is_open():
            while sample.time_s - self._pending[0].time_s > self._kept_s:
                self._pending.popleft()
            return sent
        window = self._rows_of_window()
        return self._send(len(self._pending) - len(self._pending) % window) or sent

    def flush(self) -> bool:
        """Send the remaining samples, including an incomplete window; return whether there were any."""
        return self._send(len(self._pending))

    def _send(self, count: int) -> bool:
        window = self._rows_of_window()
        batch = [self._pending.popleft() for _ in range(count)]
        if not batch:
            return False
        time_s = np.array([sample.time_s for sample in batch])
        step = np.array([sample.step for sample in batch])
        for group in self._groups(batch):
            if not group.names:
                continue
            if self.curves.get(group.path) != group.names:
                self.curves[group.path] = group.names
                self.units[group.path] = group.unit
                self._stream.log(group.path, series_lines(group.names, FIRST_COLOUR.get(group.path, 0)), static=True)
            if self._shown(group.path):
                self._send_group(group, time_s, step, window)
        return True

    def _rows_of_window(self) -> int:
        pending = self._pending
        if len(pending) < 2 or not self._window_s:
            return self._window
        step_s = (pending[-1].time_s - pending[0].time_s) / (len(pending) - 1)
        return max(self._window, round(self._window_s / step_s)) if step_s > 0.0 else self._window

    def _send_group(
        self, group: Group, time_s: npt.NDArray[np.float64], step: npt.NDArray[np.int64], window: int
    ) -> None:
        if group.worst:
            rows, values = worst_values(group.values, WORST_WINDOWS * window)
        else:
            rows = extreme_rows(group.values, window)
            values = group.values[rows]
        send_rows(self._stream, group.path, values, time_s[rows], step[rows])


def send_rows(
    stream: rr.RecordingStream,
    path: str,
    values: npt.NDArray[np.float64],
    time_s: npt.NDArray[np.float64],
    step: npt.NDArray[np.int64] | None = None,
) -> None:
    """Send rows of curves that share an entity, values of shape (n, k)."""
    columns = rr.Scalars.columns(scalars=values.ravel())
    stream.send_columns(path, times(time_s, step), columns.partition(np.full(len(values), values.shape[1])))


def series_lines(
    names: Sequence[str], first_colour: int = 0, colours: Sequence[tuple[int, int, int]] | None = None
) -> rr.SeriesLines:
    """Return names, colours and width of curves; a joint or pin has the same colour in every panel."""
    given = colours or [PALETTE[(first_colour + place) % len(PALETTE)] for place in range(len(names))]
    return rr.SeriesLines(names=list(names), colors=list(given), widths=[1.5] * len(names))


def _same_names(one: Any, other: Any) -> bool:
    """Return whether two samples of a role have the same names and thus belong to the same curves."""
    if isinstance(one, ForceSample):
        same = one.pins is other.pins or one.pins == other.pins
        same = same and (
            one.quantities.names is other.quantities.names or one.quantities.names == other.quantities.names
        )
    else:
        same = one.joints is other.joints or one.joints == other.joints
    if isinstance(one, MotorSample):
        return same
    return same and (one.residuals.names is other.residuals.names or one.residuals.names == other.residuals.names)


def present(curves: Mapping[str, tuple[str, ...]], *prefixes: str) -> list[str]:
    """Return the entity paths that lie under any of the prefixes."""
    return [path for path in curves if any(path == prefix or path.startswith(prefix + "/") for prefix in prefixes)]

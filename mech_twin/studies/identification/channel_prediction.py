# SPDX-License-Identifier: Apache-2.0
"""Predicts the readings of a machine's sensors from a simulation, at the sensors' own instants.

Between coupling steps a position is interpolated by cubic Hermite polynomials, everything else linearly; in a step with
an event both linearly.  A column that jumps at events must not be compared close to one: `ColumnCurves.beside_event`
marks these times.  Events of the model are matched with measured ones: mutually nearest, within a share of their usual
spacing.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from mech_twin.capabilities.blow_gauge import GAUGE_UNITS
from mech_twin.engine.rollout import RollOut
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import Channel, fixed
from mech_twin.measurements.units import TURN, is_angle

EVENT_FIELDS = {  # the last word of an event channel
    "time": "time_s",
    "pre_velocity": "pre_velocity_m_per_s",
    "post_velocity": "post_velocity_m_per_s",
    "impulse": "impulse_ns",
}
POSITION, VELOCITY = ".position", ".velocity"
SHARE = 0.3  # of the usual spacing of events: farther apart, they are different events
SERIES = 0.1  # of the usual spacing: events that follow sooner belong to a series, and only its first is compared


def first_of_series(times_s: Array) -> npt.NDArray[np.bool_]:
    """Return which events begin a series, shape (n,): of chatter, only the first impact counts."""
    if len(times_s) < 3:
        return np.ones(len(times_s), dtype=np.bool_)
    return np.diff(times_s, prepend=-np.inf) > SERIES * usual_spacing(times_s)


def usual_spacing(times_s: Array) -> float:
    """Return the median spacing of events (s), without the bounces within a series."""
    spacing = np.diff(np.unique(times_s))
    long = spacing[spacing > SERIES * spacing.max()] if len(spacing) else spacing
    return float(np.median(long)) if len(long) else np.inf


def matched(measured_s: Array, model_s: Array) -> npt.NDArray[np.int64]:
    """Return the index of the model event matched with each measured one, -1 without a match, shape (measured,).

    Matches are mutually nearest, which keeps the order, and at most `SHARE` of the spacing apart.
    """
    if not len(measured_s) or not len(model_s):
        return np.full(len(measured_s), -1, dtype=np.int64)
    there = _nearest(measured_s, model_s)
    back = _nearest(model_s, measured_s)
    near = np.abs(model_s[there] - measured_s) <= SHARE * min(usual_spacing(measured_s), usual_spacing(model_s))
    return np.where((back[there] == np.arange(len(measured_s))) & near, there, -1)


def _nearest(times_s: Array, among_s: Array) -> npt.NDArray[np.int64]:
    """Return the index of the nearest of ascending times, shape (times,)."""
    after = np.clip(np.searchsorted(among_s, times_s), 1, max(len(among_s) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(among_s) - 1)
    nearer = np.abs(among_s[before] - times_s) <= np.abs(among_s[after] - times_s)
    return np.where(nearer, before, after).astype(np.int64)


class ColumnCurves:
    """The columns of a simulation as functions of time; angles are unwrapped.

    Parameters
    ----------
    rollout : RollOut
        Simulation with all columns that will be evaluated (`needed_columns`).
    """

    def __init__(self, rollout: RollOut) -> None:
        self.rollout = rollout
        self.times_s = rollout["time_s"]
        self._first_s = float(self.times_s[0])
        self._step_s = float(self.times_s[1] - self.times_s[0]) if len(self.times_s) > 1 else 1.0
        self._unwrapped: dict[str, Array] = {}
        self._of_events: dict[tuple[str, str], Array] = {}

    @property
    def step_s(self) -> float:
        """The coupling step."""
        return self._step_s

    @property
    def event_times_s(self) -> Array:
        """Times of all events (s), ascending."""
        return self.rollout.event_numbers.time_s

    @cached_property
    def _eventful(self) -> npt.NDArray[np.bool_]:
        """Whether each coupling step contains an event, shape (samples - 1,)."""
        found = np.zeros(len(self.times_s) - 1, dtype=np.bool_)
        first = round(self._first_s / self._step_s)
        steps = self.rollout.event_numbers.step - first - 1
        found[steps[(steps >= 0) & (steps < len(found))]] = True
        return found

    def at(self, column: str, times_s: Array) -> Array:
        """Return a column at these times, shape (n,); outside the simulated time, its first or last value."""
        values = self._values(column)
        if len(values) < 2:
            return np.full(len(times_s), values[0])
        place = np.clip((times_s - self._first_s) / self._step_s, 0.0, len(values) - 1.0)
        step = np.minimum(place.astype(np.int64), len(values) - 2)
        share = place - step
        rise = values[step + 1] - values[step]
        straight = values[step] + share * rise
        if not column.endswith(POSITION):
            return np.asarray(straight)
        speed = self.rollout[column[: -len(POSITION)] + VELOCITY]
        bend = (self._step_s * speed[step] - rise) * (1.0 - share) - (self._step_s * speed[step + 1] - rise) * share
        return np.asarray(straight + np.where(self._eventful[step], 0.0, share * (1.0 - share) * bend))

    def slope(self, column: str, times_s: Array) -> Array:
        """Return the derivative of a column at these times, a central difference over one coupling step, shape (n,)."""
        half = 0.5 * self._step_s
        return (self.at(column, times_s + half) - self.at(column, times_s - half)) / self._step_s

    def beside_event(self, times_s: Array, guard_s: float) -> npt.NDArray[np.bool_]:
        """Return whether an event lies within ``guard_s`` of each time, shape (n,)."""
        events = self.event_times_s
        if not len(events):
            return np.zeros(len(times_s), dtype=np.bool_)
        after = np.searchsorted(events, times_s)
        to_next = events[np.minimum(after, len(events) - 1)] - times_s
        since = times_s - events[np.maximum(after - 1, 0)]
        return np.asarray(np.minimum(np.abs(to_next), np.abs(since)) <= guard_s)

    def of_events(self, kind: str, field: str) -> Array:
        """Return a value of all events of one kind, in order of time: one of `EVENT_FIELDS`, or a gauge reading.

        It is nan for an event without a gauge reading.
        """
        if (kind, field) not in self._of_events:
            events = self.rollout.event_numbers
            gauged = field in GAUGE_UNITS
            shown = self.rollout.gauge_numbers(kind, field) if gauged else getattr(events, EVENT_FIELDS[field])
            self._of_events[kind, field] = shown if gauged else shown[events.kind == kind]
        return self._of_events[kind, field]

    def _values(self, column: str) -> Array:
        if column not in self._unwrapped:
            values = self.rollout[column]
            angle = column.endswith(POSITION) and is_angle(column)
            self._unwrapped[column] = np.unwrap(values, period=TURN) if angle else values
        return self._unwrapped[column]


def needed_columns(columns: list[str]) -> list[str]:
    """Return the columns that the simulation must record: these, and the speed for each position."""
    speeds = [name[: -len(POSITION)] + VELOCITY for name in columns if name.endswith(POSITION)]
    return list(dict.fromkeys([*columns, *speeds]))


def jumps(column: str) -> bool:
    """Return whether a column can be discontinuous at an event: all but positions."""
    return not column.endswith(POSITION)


def predicted(
    channel: Channel,
    curves: ColumnCurves,
    stamps_s: Array,
    *,
    lag_s: float | None = None,
    zero: float | None = None,
    gain: float | None = None,
) -> Array:
    """Return the predicted readings of a channel at its stamps, in its own unit.

    Parameters
    ----------
    channel : Channel
        Its entry in the map.
    curves : ColumnCurves
        The simulation.
    stamps_s : ndarray
        Shape (n,): stamps of the samples, the lag not subtracted.
    lag_s, zero, gain : float, optional
        Sensor parameters; those of the map if absent (0, 0 and 1 where it has ``free`` or ``per_run``).

    Returns
    -------
    ndarray
        Shape (n,): ``sign * column(stamp - lag) / (gain * unit) + zero``.
    """
    lag = fixed(channel.lag_s, 0.0) if lag_s is None else lag_s
    offset = fixed(channel.zero, 0.0) if zero is None else zero
    factor = fixed(channel.gain, 1.0) if gain is None else gain
    column = curves.at(channel.quantity, stamps_s - lag)
    return np.asarray(channel.sign * column / (factor * channel.si_factor) + offset)

# SPDX-License-Identifier: Apache-2.0
"""The runs of a fit: measured ones, and what simulations predict for them at the sensors' own instants.

Between coupling steps a position is interpolated by cubic Hermite polynomials, everything else linearly; in a step with
an event both linearly.  A column that jumps at events must not be compared close to one: `ColumnCurves.beside_event`
marks these times.  Events of the model are matched with measured ones: mutually nearest, within a share of their usual
spacing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import Channel, fixed
from mech_twin.measurements.quality import NORMAL_MEDIAN, unit_differences
from mech_twin.measurements.runs import MeasuredRun
from mech_twin.measurements.sensors import event_values
from mech_twin.measurements.units import EVENT, TURN, is_angle, is_event
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion, number_at
from mech_twin.studies.named_rollouts import rollouts

COMMANDS = ("motor.command", "linkage.command")
DIFFERENCES = (2, 3, 4, 5, 6)  # orders of the differences that estimate the noise of a channel
FEWEST_DIFFERENCES = 8
MOST_FITTED = 40_000  # samples of a channel in a run: more are evenly decimated
POSITION, VELOCITY = ".position", ".velocity"
SHARE = 0.3  # of the usual spacing of events: farther apart, they are different events
SERIES = 0.1  # of the usual spacing: events that follow sooner belong to a series, and only its first is compared
KEPT = 3  # simulations
LATEST_START_S = 600.0  # a run with a later first stamp cannot begin at the machine's start


@dataclass(frozen=True)
class FitChannel:
    """Samples of one channel in one run, as used in the fit.

    Attributes
    ----------
    channel : Channel
        Its entry in the map.
    times_s, values : ndarray
        Shape (n,): known lag subtracted; SI units of the machine, known zero and gain removed.
    noise : float
        Standard deviation of the sensor noise, given or estimated, SI units; 0 if unknown.
    """

    channel: Channel
    times_s: Array
    values: Array
    noise: float

    @property
    def name(self) -> str:
        """Column of the machine, or event and its field."""
        return self.channel.quantity

    @property
    def of_events(self) -> bool:
        """Whether it holds events."""
        return is_event(self.name)

    @property
    def kind(self) -> str:
        """Kind of event it holds."""
        return self.name.split(".")[1] if self.of_events else ""

    @property
    def field(self) -> str:
        """Field of the event it holds."""
        return self.name.rpartition(".")[2]

    @property
    def of_instants(self) -> bool:
        """Whether its values are the times of events."""
        return self.of_events and self.field == "time"

    @property
    def jumps(self) -> bool:
        """Whether its value can jump at an event of the machine."""
        return not self.of_events and not self.name.endswith(POSITION)

    @property
    def turns(self) -> bool:
        """Whether it is an angle that is known only up to whole turns."""
        return self.name.endswith(POSITION) and is_angle(self.name)


@dataclass(frozen=True)
class FitRun:
    """One measured run.

    Attributes
    ----------
    path : Path
        File of the run.
    channels : tuple of FitChannel
        In the order of the map, without channels of the command.
    command : tuple of pairs
        Time (s) and requested fraction of rated supply frequency from then on; empty: full supply throughout.
    begin_s : float or None
        Time since the machine's start at the run's time 0; None: unknown.
    until_s : float
        The fit ignores samples after it.
    from_s : float
        The fit ignores samples before it.
    """

    path: Path
    channels: tuple[FitChannel, ...]
    command: tuple[tuple[float, float], ...]
    begin_s: float | None
    until_s: float = np.inf
    from_s: float = -np.inf

    @property
    def first_s(self) -> float:
        """Time of the first sample."""
        return min(float(channel.times_s[0]) for channel in self.channels)

    @property
    def last_s(self) -> float:
        """Time of the last sample."""
        return max(float(channel.times_s[-1]) for channel in self.channels)

    @property
    def end_s(self) -> float:
        """Time of the last sample that is used."""
        return min(self.last_s, self.until_s)

    def first_share(self, share: float) -> FitRun:
        """Return the run with only a first share of its used samples."""
        return replace(self, until_s=self.first_s + share * (self.end_s - self.first_s))

    def within(self, from_s: float, until_s: float) -> FitRun:
        """Return the run with only the samples of a time interval used."""
        return replace(self, from_s=from_s, until_s=until_s)


def fit_run(run: MeasuredRun, *, begin_known: bool) -> FitRun:
    """Return a measured run prepared for a fit.

    Parameters
    ----------
    begin_known : bool
        Whether the run's times count from the machine's start; else they count from the first sample, at an unknown
        time after the start.

    Raises
    ------
    MeasurementError
        The run begins before the machine's start or long after it; or it has no channel besides the command.
    """
    channels = tuple(
        fit_channel(each.channel, each.times_s, each.values, max(each.quality.quantum, each.channel.quantum))
        for each in run.channels
        if each.name not in COMMANDS and len(each.times_s)
    )
    commands = [(each.times_s, each.values) for each in run.channels if each.name in COMMANDS]
    return placed_run(run.path, channels, commands[0] if commands else None, begin_known=begin_known)


def placed_run(
    path: Path, channels: Sequence[FitChannel], command: tuple[Array, Array] | None, *, begin_known: bool
) -> FitRun:
    """Return the run from channels, and from times and values of the command; see `fit_run`."""
    if not channels:
        raise MeasurementError(path, "expected a channel beside that of the command")
    first = min(float(each.times_s[0]) for each in channels)
    if begin_known and not -1.0 <= first <= LATEST_START_S:
        raise MeasurementError(
            path,
            f"the first sample stands at {first:.6g} s, and the run is taken to begin with the machine's own start at "
            "0 s; expected --latest-begin TIME",
        )
    shift = 0.0 if begin_known else first
    moved = tuple(_earlier(each, shift) for each in channels)
    changes = tuple(_changes(*command, shift)) if command is not None else ()
    return FitRun(path, moved, changes, 0.0 if begin_known else None)


def fit_channel(channel: Channel, times_s: Array, values: Array, quantum: float) -> FitChannel:
    """Return the samples of a channel in SI units and in order, as used in the fit.

    Parameters
    ----------
    channel : Channel
        Its line of the map.
    times_s, values : ndarray
        Shape (n,): known lag, zero and gain removed.
    quantum : float
        Resolution of the sensor, in its own unit.
    """
    own = abs(fixed(channel.gain, 1.0)) * channel.si_factor
    every = max(1, -(-len(times_s) // MOST_FITTED))
    if channel.sigma is not None:
        noise = own * channel.sigma
    else:
        noise = 0.0 if channel.quantity.startswith(EVENT) else seen_noise(times_s, values)
    return FitChannel(channel, times_s[::every], values[::every], float(np.hypot(noise, own * quantum / 12.0**0.5)))


def seen_noise(times_s: Array, values: Array) -> float:
    """Return the standard deviation of the noise in a series, estimated from its higher differences at its stamps (s).

    Second differences still contain the curvature of a fast motion, higher ones less of it; the least estimate over
    the orders is taken.
    """
    found = (unit_differences(times_s, values, order) for order in DIFFERENCES)
    return min(
        (float(np.median(left)) / NORMAL_MEDIAN for left in found if len(left) >= FEWEST_DIFFERENCES), default=0.0
    )


def _earlier(channel: FitChannel, shift_s: float) -> FitChannel:
    values = channel.values - shift_s if channel.of_instants else channel.values
    return replace(channel, times_s=channel.times_s - shift_s, values=values)


def _changes(times_s: Array, values: Array, shift_s: float) -> Sequence[tuple[float, float]]:
    """Return the times (s) at which the command changes, and its new values, limited to 0 to 1."""
    changed = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    return [(float(times_s[i]) - shift_s, float(np.clip(values[i], 0.0, 1.0))) for i in changed]


def first_of_series(times_s: Array, spacing_s: float) -> npt.NDArray[np.bool_]:
    """Return which events begin a series, shape (n,): of chatter, only the first impact counts.

    ``spacing_s`` is the usual spacing of the measured events, also for those of the model: each with its own would
    count other bounces where the two hold other parts of a run.
    """
    return np.diff(times_s, prepend=-np.inf) > SERIES * (spacing_s if np.isfinite(spacing_s) else 0.0)


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
        Simulation with all columns that will be evaluated (`needed_columns`); its coupling step is ``step_s``.
    """

    def __init__(self, rollout: RollOut) -> None:
        self.rollout = rollout
        self.times_s = rollout["time_s"]
        self.step_s = float(self.times_s[1] - self.times_s[0]) if len(self.times_s) > 1 else 1.0
        self._first_s = float(self.times_s[0])
        self._unwrapped: dict[str, Array] = {}
        self._of_events: dict[tuple[str, str], Array] = {}

    @cached_property
    def _eventful(self) -> npt.NDArray[np.bool_]:
        """Whether each coupling step contains an event, shape (samples - 1,)."""
        found = np.zeros(len(self.times_s) - 1, dtype=np.bool_)
        first = round(self._first_s / self.step_s)
        steps = self.rollout.event_numbers.step - first - 1
        found[steps[(steps >= 0) & (steps < len(found))]] = True
        return found

    def at(self, column: str, times_s: Array) -> Array:
        """Return a column at these times, shape (n,); outside the simulated time, its first or last value."""
        values = self._values(column)
        if len(values) < 2:
            return np.full(len(times_s), values[0])
        place = np.clip((times_s - self._first_s) / self.step_s, 0.0, len(values) - 1.0)
        step = np.minimum(place.astype(np.int64), len(values) - 2)
        share = place - step
        rise = values[step + 1] - values[step]
        straight = values[step] + share * rise
        if not column.endswith(POSITION):
            return np.asarray(straight)
        speed = self.rollout[column[: -len(POSITION)] + VELOCITY]
        bend = (self.step_s * speed[step] - rise) * (1.0 - share) - (self.step_s * speed[step + 1] - rise) * share
        return np.asarray(straight + np.where(self._eventful[step], 0.0, share * (1.0 - share) * bend))

    def slope(self, column: str, times_s: Array) -> Array:
        """Return the derivative of a column at these times, a central difference over one coupling step, shape (n,)."""
        half = 0.5 * self.step_s
        return (self.at(column, times_s + half) - self.at(column, times_s - half)) / self.step_s

    def beside_event(self, times_s: Array, guard_s: float) -> npt.NDArray[np.bool_]:
        """Return whether an event lies within ``guard_s`` of each time, shape (n,)."""
        events = self.rollout.event_numbers.time_s
        if not len(events):
            return np.zeros(len(times_s), dtype=np.bool_)
        after = np.searchsorted(events, times_s)
        to_next = events[np.minimum(after, len(events) - 1)] - times_s
        since = times_s - events[np.maximum(after - 1, 0)]
        return np.asarray(np.minimum(np.abs(to_next), np.abs(since)) <= guard_s)

    def of_events(self, kind: str, field: str) -> Array:
        """Return a value of all events of one kind, see `event_values`."""
        if (kind, field) not in self._of_events:
            self._of_events[kind, field] = event_values(self.rollout, kind, field)
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


Curves = tuple[ColumnCurves, ...]


class ModelRuns:
    """Simulations of a machine with the commands of measured runs, for comparison with them; the last are kept.

    The machine and its free keys are those of the ``question``.
    """

    def __init__(self, question: IdentificationQuestion, runs: Sequence[FitRun]) -> None:
        question.check()
        self.question, self.runs, self.rolled_out = question, tuple(runs), 0
        names = [channel.name for run in runs for channel in run.channels if not channel.of_events]
        self._columns = needed_columns(names)
        self._kept: dict[bytes, Curves | None] = {}

    def over(self, runs: Sequence[FitRun]) -> ModelRuns:
        """Return the same machine with other parts of the runs."""
        return ModelRuns(self.question, runs)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the state to pickle: one thread, no simulations."""
        return ModelRuns, (replace(self.question, cores=1), self.runs)

    def at(self, values: Array) -> Curves | None:
        """Return the columns of each run for these values of the keys; None if they are rejected or a run fails."""
        self.prepare([values])
        return self._kept[values.tobytes()]

    def prepare(self, members: Sequence[Array]) -> None:
        """Compute what `at` will be asked for, at most `KEPT` sets of values, on all cores."""
        lacking = [values for values in members if values.tobytes() not in self._kept]
        if lacking:
            found = zip((values.tobytes() for values in lacking), self.many(lacking), strict=True)
            self._kept = dict([*self._kept.items(), *found][-KEPT:])

    def many(self, members: Sequence[Array]) -> list[Curves | None]:
        """Return the same for several sets of values, computed on all cores."""
        configured = [self._parameters(values) for values in members]
        legal = [each for each in configured if each is not None]
        rolled = zip(*(self._rolled(run, legal) for run in self.runs), strict=True)
        found: list[Curves | None] = []
        for each in configured:
            kept = () if each is None else tuple(curves for curves in next(rolled) if curves is not None)
            found.append(kept if len(kept) == len(self.runs) else None)
        return found

    @property
    def step_s(self) -> float:
        """The coupling step."""
        return number_at(self.question.tree, "coupling.step_s", self.question.machine)

    def _rolled(self, run: FitRun, configured: Sequence[Parameters]) -> list[ColumnCurves | None]:
        if not configured:
            return []
        begin_s = self.question.longest_begin_s if run.begin_s is None else run.begin_s
        duration_s = max(run.end_s, 0.0) + begin_s + 2.0 * self.step_s
        command = run.command or 1.0
        self.rolled_out += len(configured)
        members: Iterable[RollOut]
        if len(configured) == 1 or self.question.cores == 1:  # without the overhead of threads
            entry = catalogue_entry(self.question.machine)
            members = [roll_out(entry.build(each), duration_s, self._columns, None, command) for each in configured]
        else:
            members = rollouts(
                self.question.machine,
                duration_s,
                list(configured),
                columns=self._columns,
                commands=[command] * len(configured),
                cores=self.question.cores,
            )
        return [None if member.error is not None else ColumnCurves(member) for member in members]

    def _parameters(self, values: Array) -> Parameters | None:
        if not np.isfinite(values).all():
            return None
        try:
            return self.question.parameters(values)
        except ConfigurationError:
            return None

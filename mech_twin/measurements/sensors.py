# SPDX-License-Identifier: Apache-2.0
"""Simulated sensors: a run sampled at their own instants, with lag, noise, quantisation and losses.

A sensor samples the machine at ``k / rate_hz`` plus jitter; its stamp is later by the lag::

    reading(stamp) = sign * x(stamp - lag_s) / gain + zero + noise,   rounded to the quantum

Channels of one topic are in one message, so they have the same instants; a column of a table has its own.
Tables are written here too: of the readings, or of every column of the machine.
"""

import csv
import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from mech_twin.capabilities.blow_gauge import GAUGE_UNITS, BlowGauge
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.rollout import RollOut
from mech_twin.engine.trajectory import frame_events, frame_numbers
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import TIME_COLUMN, Channel, MeasurementMap, Source
from mech_twin.measurements.units import EVENT, TIME_UNITS, TURN, is_angle, is_event, joint_column
from mech_twin.process.closing import Closing
from mech_twin.process.dependencies import require_extra
from mech_twin.samples import Event, Frame

LARGEST_JITTER = 0.45  # of the interval, so that stamps stay in order
EVENT_FIELDS = {
    "time": "time_s",
    "pre_velocity": "pre_velocity_m_per_s",
    "post_velocity": "post_velocity_m_per_s",
    "impulse": "impulse_ns",
}


def event_values(run: RollOut, kind: str, field: str) -> Array:
    """Return a value of all events of one kind in a roll-out, in order of time; nan without a gauge reading.

    ``field`` is one of `EVENT_FIELDS`, or a gauge reading.
    """
    if field in GAUGE_UNITS:
        return run.gauge_numbers(kind, field)
    events = run.event_numbers
    return np.asarray(getattr(events, EVENT_FIELDS[field])[events.kind == kind])


class Reading(NamedTuple):
    """Readings of one topic, or one column, at one instant; sources in the order of the values."""

    time_s: float
    sources: tuple[Source, ...]
    values: tuple[float, ...]


@dataclass
class _Clock:
    """Channels that are sampled together, and their next sampling instant (of the machine's time)."""

    channels: list[tuple[int, Channel]]
    random: np.random.Generator
    index: int = 0
    at_s: float = 0.0
    dropped: bool = False

    @property
    def first(self) -> Channel:
        return self.channels[0][1]


@dataclass
class SensorBench:
    """Sensors on a running machine: converts frames to readings, in order of their stamps.

    Parameters
    ----------
    sensors : MeasurementMap
        The channels with their sensor properties; zero, gain and lag of each are numbers.
    step_s : float
        Coupling step: the sampling interval of a channel without a rate.
    seed : int
        Seed of jitter, noise and losses; each channel and each clock has its own generator.

    Raises
    ------
    ConfigurationError
        A zero, gain or lag is not a number; a channel needs a gauge that the machine lacks;
        channels of one topic differ in rate, jitter, loss or lag.
    """

    sensors: MeasurementMap
    columns: Mapping[str, str]
    step_s: float
    seed: int = 0
    gauge: BlowGauge | None = None
    _before: dict[str, float] = field(default_factory=dict)
    _turns: dict[str, float] = field(default_factory=dict)
    _waiting: list[tuple[float, int, Reading]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._number = count()
        _check_sensors(self.sensors, self.gauge)
        sampled = [(i, channel) for i, channel in enumerate(self.sensors.channels) if not is_event(channel.quantity)]
        self._noise = [np.random.default_rng([self.seed, 0, i]) for i in range(len(self.sensors.channels))]
        self._events = [(i, channel) for i, channel in enumerate(self.sensors.channels) if is_event(channel.quantity)]
        groups: dict[str, list[tuple[int, Channel]]] = {}
        for i, channel in sampled:
            groups.setdefault(channel.source.topic or channel.source.label, []).append((i, channel))
        self._clocks = [
            _Clock(group, np.random.default_rng([self.seed, 1, i])) for i, group in enumerate(groups.values())
        ]
        self._needed = {channel.quantity for _, channel in sampled}
        self._angles = {name for name in self._needed if is_angle(name)}
        self._shortest_lag = min((float(channel.lag_s) for channel in self.sensors.channels), default=0.0)
        for clock in self._clocks:
            self._set_instant(clock)

    def observe(self, frame: Frame) -> Iterator[Reading]:
        """Process the next frame of the run; yield the readings that are now complete."""
        events = frame_events(frame)
        now = self._row(frame)
        time_s = now["time_s"]
        for clock in self._clocks:
            while clock.at_s <= time_s + 1e-12:
                if not clock.dropped and clock.at_s >= 0.0:
                    self._sample(clock, now, smooth=not events)
                clock.index += 1
                self._set_instant(clock)
        for event in events:
            self._show_event(event)
        self._before = now
        yield from self._given_out(time_s + self._shortest_lag)

    def rest(self) -> Iterator[Reading]:
        """Yield the remaining readings, at the end of the run."""
        yield from self._given_out(np.inf)

    def _row(self, frame: Frame) -> dict[str, float]:
        """Return the measured columns of a frame, angles unwrapped."""
        row = {name: value for name, value in frame_numbers(frame) if name in self._needed or name == "time_s"}
        for column in self._needed:
            parts = joint_column(column)
            if parts is not None and parts.field == "position":
                sample = getattr(frame, parts.role)
                row[f"{parts.role}.{parts.joint}.velocity"] = float(sample.velocity[sample.joints.index(parts.joint)])
        for name in self._angles:
            jump = row[name] + self._turns.get(name, 0.0) - self._before.get(name, row[name])
            self._turns[name] = self._turns.get(name, 0.0) - TURN * round(jump / TURN)
            row[name] += self._turns[name]
        return row

    def _set_instant(self, clock: _Clock) -> None:
        interval = self.step_s if clock.first.rate_hz is None else 1.0 / clock.first.rate_hz
        jitter = clock.random.standard_normal() * clock.first.jitter_s
        bound = LARGEST_JITTER * interval
        clock.at_s = clock.index * interval + min(max(jitter, -bound), bound)
        clock.dropped = clock.random.random() < clock.first.drop

    def _sample(self, clock: _Clock, now: Mapping[str, float], *, smooth: bool) -> None:
        values = []
        for place, channel in clock.channels:
            value = self._between(channel.quantity, now, clock.at_s, smooth)
            values.append(self._shown(place, channel, value))
        stamp_s = clock.at_s + float(clock.first.lag_s)
        self._push(Reading(stamp_s, tuple(channel.source for _, channel in clock.channels), tuple(values)))

    def _between(self, column: str, now: Mapping[str, float], at_s: float, smooth: bool) -> float:
        """Return a column between the last two frames: cubic Hermite with the speeds; linear if an event is between."""
        before = self._before
        h = now["time_s"] - before.get("time_s", now["time_s"])
        if h <= 0.0 or at_s >= now["time_s"]:
            return now[column]
        s = (at_s - before["time_s"]) / h
        straight = before[column] + s * (now[column] - before[column])
        speed = f"{column[: -len('position')]}velocity"
        if not smooth or not column.endswith(".position") or speed not in now:
            return straight
        rise = now[column] - before[column]
        return straight + s * (1.0 - s) * ((h * before[speed] - rise) * (1.0 - s) - (h * now[speed] - rise) * s)

    def _shown(self, place: int, channel: Channel, value: float) -> float:
        shown = float(channel.shown(value)) + (channel.sigma or 0.0) * float(self._noise[place].standard_normal())
        return round(shown / channel.quantum) * channel.quantum if channel.quantum else shown

    def _show_event(self, event: Event) -> None:
        together: dict[Source, list[tuple[Source, float]]] = {}
        stamp_s = event.time_s
        for place, channel in self._events:
            _, kind, what = channel.quantity.split(".")
            if kind != event.kind or self._noise[place].random() < channel.drop:
                continue
            if what in GAUGE_UNITS and not (self.gauge and self.gauge.has_reading(event)):
                continue
            told = self.gauge.number(event, what) if self.gauge and what in GAUGE_UNITS else None
            value = self._shown(place, channel, getattr(event, EVENT_FIELDS[what]) if told is None else told)
            key = channel.source.model_copy(update={"field": None}) if channel.source.topic else channel.source
            together.setdefault(key, []).append((channel.source, value))
            stamp_s = event.time_s + float(channel.lag_s)
        for shown in together.values():
            self._push(Reading(stamp_s, tuple(source for source, _ in shown), tuple(value for _, value in shown)))

    def _push(self, reading: Reading) -> None:
        heapq.heappush(self._waiting, (reading.time_s, next(self._number), reading))

    def _given_out(self, horizon_s: float) -> Iterator[Reading]:
        while self._waiting and self._waiting[0][0] <= horizon_s:
            yield heapq.heappop(self._waiting)[2]


def _check_sensors(sensors: MeasurementMap, gauge: BlowGauge | None) -> None:
    shared: dict[str, tuple[int, Channel]] = {}
    for place, channel in enumerate(sensors.channels):
        where = f"sensors: key 'channels.{place}"
        for key in ("zero", "gain", "lag_s"):
            value = getattr(channel, key)
            if isinstance(value, str):
                raise ConfigurationError(f"{where}.{key}', value {value!r}: expected a number, a sensor has one")
        if gauge is None and is_event(channel.quantity) and channel.quantity.rpartition(".")[2] in GAUGE_UNITS:
            raise ConfigurationError(
                f"{where}.is', value {channel.quantity!r}: expected a machine with a gauge on a struck rod"
            )
        if channel.source.topic is None or channel.quantity.startswith(f"{EVENT}."):
            continue
        first_place, first = shared.setdefault(channel.source.topic, (place, channel))
        for key in ("rate_hz", "jitter_s", "drop", "lag_s"):
            mine, theirs = getattr(channel, key), getattr(first, key)
            if mine != theirs:
                raise ConfigurationError(
                    f"{where}.{key}', value {mine}: expected {theirs} as in channels.{first_place}, both come in one "
                    f"message of topic {first.source.topic!r}"
                )


ROWS_PER_BATCH = 1 << 16


class TableWriter(Closing):
    """A table in progress, Parquet, CSV or TSV by its suffix; rows are written in batches, in order of time.

    Parameters
    ----------
    time_column, time_factor : str, float
        Name of the time column, and its unit in seconds.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], time_column: str = TIME_COLUMN, time_factor: float = 1.0
    ) -> None:
        self._columns = (time_column, *columns)
        self._place = {name: place for place, name in enumerate(self._columns)}
        self._factor = time_factor
        self._rows: list[list[float | None]] = []
        self._last_s: float | None = None
        self._parquet: Any = None
        self._stream: IO[str] | None = None
        if path.suffix == ".parquet":
            require_extra("tables")
            import pyarrow as pa
            from pyarrow import parquet

            self._schema = pa.schema([(name, pa.float64()) for name in self._columns])
            self._parquet = parquet.ParquetWriter(path, self._schema, compression="zstd")
        else:
            self._stream = path.open("w", newline="", encoding="utf-8")
            self._csv = csv.writer(self._stream, delimiter="\t" if path.suffix == ".tsv" else ",")
            self._csv.writerow(self._columns)

    def close(self) -> None:
        """Write the remaining rows and close the file."""
        self._flush()
        if self._parquet is not None:
            self._parquet.close()
        if self._stream is not None:
            self._stream.close()

    def write(self, time_s: float, values: Sequence[tuple[str, float]]) -> None:
        """Add values at an instant; values of the same instant share a row."""
        if time_s != self._last_s:
            if len(self._rows) >= ROWS_PER_BATCH:
                self._flush()
            self._rows.append([time_s / self._factor, *[None] * (len(self._columns) - 1)])
            self._last_s = time_s
        for name, value in values:
            self._rows[-1][self._place[name]] = value

    def read(self, reading: Reading) -> None:
        """Add a reading of sensors."""
        self.write(reading.time_s, list(zip((source.label for source in reading.sources), reading.values, strict=True)))

    def _flush(self) -> None:
        rows, self._rows, self._last_s = self._rows, [], None
        if self._parquet is not None and rows:
            import pyarrow as pa

            arrays = [pa.array(column, pa.float64()) for column in zip(*rows, strict=True)]
            self._parquet.write_batch(pa.RecordBatch.from_arrays(arrays, schema=self._schema))
        elif rows:
            self._csv.writerows([["" if cell is None else repr(cell) for cell in row] for row in rows])


def sensor_table(path: Path, sensors: MeasurementMap) -> TableWriter:
    """Return a writer of a table with the channels of a sensors file, which is also the map of the table."""
    columns = [channel.source.label for channel in sensors.channels]
    return TableWriter(path, columns, sensors.time.column or TIME_COLUMN, TIME_UNITS[sensors.time.unit])

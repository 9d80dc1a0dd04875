# SPDX-License-Identifier: Apache-2.0
"""Simulated sensors: a simulation sampled at the sensors' instants, with noise, quantisation and losses."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mech_twin.capabilities.cycle import TURN, Array, CycleFeatures
from mech_twin.capabilities.faults import MachineFault, OperatingVariable
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.coupling import Profile
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.errors import StudyError
from mech_twin.machines.catalog import Entry
from mech_twin.measurements.measurement_map import Channel, MeasurementMap
from mech_twin.measurements.sensors import event_values
from mech_twin.measurements.units import is_angle, is_event
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import Machine
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, FeatureVector, feed_channels
from mech_twin.studies.monitoring.diagnosis import USED_CYCLES

DRAWS = 3  # random draws of the sensors' noise
LONGEST_S = 120.0
Seen = dict[str, tuple[Array, Array]]  # column: stamps less the known lag (s), values (SI)


@dataclass(frozen=True)
class SensorFault:
    """Error of a sensor's values or stamps.

    Attributes
    ----------
    bias, gain : float
        The channel shows ``(1 + gain) x + bias``, SI.
    lag_s : float
        Added delay of its values.
    stuck : bool
        Whether it constantly shows its mean.
    """

    column: str
    bias: float = 0.0
    gain: float = 0.0
    lag_s: float = 0.0
    stuck: bool = False


def needed_columns(sensors: MeasurementMap) -> list[str]:
    """Return the columns that the sensors sample, without duplicates and without events."""
    return list(dict.fromkeys(c.quantity for c in sensors.channels if not is_event(c.quantity)))


def first_channels(sensors: MeasurementMap) -> dict[str, Channel]:
    """Return the first channel of each column."""
    found: dict[str, Channel] = {}
    for channel in sensors.channels:
        found.setdefault(channel.quantity, channel)
    return found


def seen_run(
    machine: Machine,
    sensors: MeasurementMap,
    duration_s: float,
    *,
    random: np.random.Generator | None = None,
    command: Profile = 1.0,
    changes: Sequence[tuple[float, Machine]] = (),
    begin_s: float = 0.0,
) -> Seen:
    """Return the sensor signals of a simulation; without noise if no generator is given.

    Raises
    ------
    MotionError
        The simulation cannot continue to the end.
    """
    run = roll_out(machine, duration_s, needed_columns(sensors), None, command, changes)
    if run.error is not None:
        raise run.error
    return seen_roll_out(run, sensors, machine.coupling_step_s, random, begin_s)


def seen_roll_out(
    run: RollOut, sensors: MeasurementMap, step_s: float, random: np.random.Generator | None, begin_s: float = 0.0
) -> Seen:
    """Return the sensor signals of a simulated run from ``begin_s`` on."""
    times_s, clocks = run["time_s"], dict[str, Array]()
    found: Seen = {}
    for column, channel in first_channels(sensors).items():
        if is_event(column):
            found[column] = _seen_events(run, channel, random, begin_s)
            continue
        clock = channel.source.topic or channel.source.label
        if clock not in clocks:
            clocks[clock] = _instants(channel, begin_s, float(times_s[-1]), step_s, random)
        at_s = clocks[clock]
        curve = np.unwrap(run[column], period=TURN) if is_angle(column) else run[column]
        found[column] = (at_s, _shown(np.interp(at_s, times_s, curve), channel, random))
    return found


def with_sensor_fault(seen: Seen, fault: SensorFault, since_s: float = -np.inf) -> Seen:
    """Return the same signals with one sensor faulty from an instant on."""
    times, values = seen[fault.column]
    late = np.interp(times - fault.lag_s, times, values) if fault.lag_s else values
    wrong = (1.0 + fault.gain) * late + fault.bias
    if fault.stuck:
        wrong = np.full_like(values, values.mean())
    return {**seen, fault.column: (times, np.where(times >= since_s, wrong, values))}


def without_noise(sensors: MeasurementMap) -> MeasurementMap:
    """Return the same sensors without noise, quantisation, jitter and losses."""
    exact = {"sigma": None, "quantum": 0.0, "jitter_s": 0.0, "drop": 0.0}
    return sensors.model_copy(update={"channels": tuple(c.model_copy(update=exact) for c in sensors.channels)})


def _instants(
    channel: Channel, begin_s: float, end_s: float, step_s: float, random: np.random.Generator | None
) -> Array:
    interval_s = step_s if channel.rate_hz is None else 1.0 / channel.rate_hz
    at_s = interval_s * np.arange(np.ceil(begin_s / interval_s - 1e-9), np.floor(end_s / interval_s + 1e-9) + 1.0)
    if random is None:
        return at_s
    if channel.jitter_s:
        bound = 0.45 * interval_s
        at_s = at_s + np.clip(channel.jitter_s * random.standard_normal(len(at_s)), -bound, bound)
    return at_s[random.random(len(at_s)) >= channel.drop] if channel.drop else at_s


def _shown(values: Array, channel: Channel, random: np.random.Generator | None) -> Array:
    """Return values with the channel's noise and quantisation, converted back to SI units."""
    shown = channel.shown(values)
    if random is not None and channel.sigma:
        shown = shown + channel.sigma * random.standard_normal(len(values))
    if channel.quantum:
        shown = np.round(shown / channel.quantum) * channel.quantum
    return np.asarray(channel.to_machine(shown), dtype=np.float64)


def _seen_events(
    run: RollOut, channel: Channel, random: np.random.Generator | None, begin_s: float
) -> tuple[Array, Array]:
    _, kind, what = channel.quantity.split(".")
    times_s, values = event_values(run, kind, "time"), event_values(run, kind, what)
    chosen = (times_s >= begin_s) & np.isfinite(values)
    return times_s[chosen], _shown(values[chosen], channel, random)


@dataclass(frozen=True)
class MonitoredMachine:
    """A machine and the sensors that monitor it.

    Attributes
    ----------
    sensors : MeasurementMap
        The channels; zero, gain and lag of each are numbers.
    """

    name: str
    parameters: Parameters
    sensors: MeasurementMap

    @property
    def entry(self) -> Entry:
        """The machine's entry in the catalogue."""
        return catalogue_entry(self.name)

    @property
    def columns(self) -> tuple[str, ...]:
        """Measured columns, without duplicates."""
        return tuple(dict.fromkeys(channel.quantity for channel in self.sensors.channels))

    @property
    def declared(self) -> CycleFeatures:
        """Cycle reference and features that the machine declares.

        Raises
        ------
        StudyError
            The machine declares no features.
        """
        ask = self.entry.capabilities.features
        if ask is None:
            raise StudyError(f"{self.name} declares no features of a cycle; expected a machine that does")
        return ask(self.parameters)

    @property
    def faults(self) -> tuple[MachineFault, ...]:
        """Faults that the machine declares."""
        ask = self.entry.capabilities.faults
        return () if ask is None else ask(self.parameters)

    @property
    def operating(self) -> tuple[OperatingVariable, ...]:
        """Operating variables, which may change while the machine is healthy."""
        ask = self.entry.capabilities.operating
        return () if ask is None else ask(self.parameters)

    def feed(self) -> FeatureFeed:
        """Return a new feed for one run."""
        return FeatureFeed(self.declared, self.columns)

    def vectors(self, seen: Seen, last: int = 0) -> list[FeatureVector]:
        """Return the features of every cycle of a run, or of so many at its end."""
        return feed_channels(self.feed(), seen, last=last)

    def varied(self, changes: Mapping[str, Any]) -> Parameters:
        """Return the healthy configuration with keys changed."""
        return varied(self.parameters, changes)


def mean_period_s(monitored: MonitoredMachine) -> float:
    """Return the mean duration of a cycle (s) in steady running, from a short simulation.

    Raises
    ------
    StudyError
        The simulated machine completes too few cycles.
    """
    exact = MonitoredMachine(monitored.name, monitored.parameters, without_noise(monitored.sensors))
    begin_s = exact.declared.run_up_s
    for duration_s in (begin_s + 3.0, begin_s + 20.0, begin_s + LONGEST_S):
        machine = exact.entry.build(exact.parameters)
        vectors = exact.vectors(seen_run(machine, exact.sensors, duration_s, begin_s=begin_s))
        if len(vectors) > 2:
            return float(np.mean([vector.end_s - vector.begin_s for vector in vectors]))
    raise StudyError(f"{monitored.name}: less than three cycles in {LONGEST_S:g} s of its own run")


class SteadyCycles(NamedTuple):
    """Features in steady running: mean (d,), and covariance (d, d) from cycle to cycle."""

    mean: Array
    covariance: Array


def noisy_draws(monitored: MonitoredMachine, parameters: Parameters, duration_s: float) -> list[Seen]:
    """Return the signals of one simulation under several noise draws, which are the same for all parameters."""
    machine, begin_s = monitored.entry.build(parameters), monitored.declared.run_up_s
    run = roll_out(machine, duration_s, needed_columns(monitored.sensors), None, 1.0)
    if run.error is not None:
        raise run.error
    step_s = machine.coupling_step_s
    return [
        seen_roll_out(run, monitored.sensors, step_s, np.random.default_rng(draw), begin_s) for draw in range(DRAWS)
    ]


def steady_cycles(monitored: MonitoredMachine, draws: Iterable[Seen], names: tuple[str, ...]) -> SteadyCycles | None:
    """Return the statistics of the last cycles' features; None without a cycle or with a missing feature.

    The covariance is about the mean of each draw.
    """
    runs = [np.array([vector.values for vector in monitored.vectors(seen, USED_CYCLES)]) for seen in draws]
    if not all(map(len, runs)):
        return None
    all_names = [feature.name for feature in monitored.feed().features]
    places = [all_names.index(name) for name in names]
    rows = [run[:, places] for run in runs]
    mean = np.concatenate(rows).mean(axis=0)
    if not np.isfinite(mean).all():
        return None
    left = np.concatenate([row - row.mean(axis=0) for row in rows])
    return SteadyCycles(mean, left.T @ left / max(len(left) - len(rows), 1))

# SPDX-License-Identifier: Apache-2.0
"""Signatures by roll-out: what each fault of a machine, and of its sensors, does to the features of a cycle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from mech_twin.capabilities.cycle import Array, CycleFeatures
from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.faults import MachineFault
from mech_twin.capabilities.operating_point import OperatingVariable
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.errors import MotionError
from mech_twin.engine.rollout import roll_out
from mech_twin.machines.catalog import Entry
from mech_twin.measurements.machine_columns import is_event, machine_columns
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.monitoring.baseline import RIDGE, SMALLEST_SPREAD
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, FeatureVector, feed_channels
from mech_twin.studies.monitoring.naming import MODEL_SHARE, Signature
from mech_twin.studies.monitoring.sensing import (
    Seen,
    SensorFault,
    needed_columns,
    seen_roll_out,
    seen_run,
    shifted,
    with_sensor_fault,
    without_noise,
)

STEADY_CYCLES = 80  # simulated beyond the run-up
USED_CYCLES = 60  # at the end, whose mean counts
SCATTER_CYCLES = 80  # instead, where the machine does not repeat itself
LARGE_SCATTER = 9.0  # of the variance of a healthy feature: beyond it the machine does not repeat itself
BEND = 1.0  # squared standard deviations that a response may be off the line between two sizes
HALVINGS = 2  # of the steps about a bend
FACTORS = 4  # of a scatter
DRAWS = 3  # of the sensors' noise
LONGEST_S = 120.0
SENSOR_SHARES = (-1.0, -0.3, -0.1, -0.03, 0.03, 0.1, 0.3, 1.0)
LARGEST_BIAS = 0.3  # of the channel's swing
LARGEST_GAIN = 0.3
LARGEST_LAG = 0.1  # of a cycle
LARGEST_TURN_BIAS_RAD = 0.3


@dataclass(frozen=True)
class MonitoredMachine:
    """A machine with the sensors it is watched by.

    Attributes
    ----------
    name : str
        Of the catalogue.
    parameters : Parameters
        The healthy configuration.
    sensors : MeasurementMap
        The channels, each zero, gain and lag a number.
    """

    name: str
    parameters: Parameters
    sensors: MeasurementMap

    @property
    def entry(self) -> Entry:
        """The machine in the catalogue."""
        return catalogue_entry(self.name)

    @property
    def columns(self) -> tuple[str, ...]:
        """What the sensors measure."""
        return tuple(dict.fromkeys(channel.quantity for channel in self.sensors.channels))

    @property
    def declared(self) -> CycleFeatures:
        """What the machine tells of a cycle.

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
        """What can go wrong with it."""
        ask = self.entry.capabilities.faults
        return () if ask is None else ask(self.parameters)

    @property
    def operating(self) -> tuple[OperatingVariable, ...]:
        """What may differ from day to day while it is healthy."""
        ask = self.entry.capabilities.operating
        return () if ask is None else ask(self.parameters)

    def feed(self) -> FeatureFeed:
        """Return a fresh feed for one run."""
        return FeatureFeed(self.declared, self.columns)

    def vectors(self, seen: Seen) -> list[FeatureVector]:
        """Return the features of every cycle of a run."""
        return feed_channels(self.feed(), seen)

    def varied(self, changes: Mapping[str, Any]) -> Parameters:
        """Return the healthy configuration with keys changed."""
        return varied(self.parameters, changes)


def mean_period_s(monitored: MonitoredMachine) -> float:
    """Return the duration of a cycle in steady running, from a short roll-out.

    Raises
    ------
    StudyError
        The simulated machine does not cycle.
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
    """The features of a machine in steady running: their mean (d,), covariance (d, d) from cycle to cycle, cycles."""

    mean: Array
    covariance: Array
    cycles: int


def machine_signatures(monitored: MonitoredMachine, names: Iterable[str]) -> tuple[Signature, ...]:
    """Return the signatures of every fault of machine and sensors, for these features.

    Healthy and faulty runs are seen with the same noise: features that are not linear in the samples, such as a share
    or a maximum, depend on it, and what is linear loses it in the difference.
    """
    wanted = tuple(names)
    period_s = mean_period_s(monitored)
    duration_s = monitored.declared.run_up_s + STEADY_CYCLES * period_s
    healthy = noisy_draws(monitored, monitored.parameters, 1.0, duration_s)
    reference = steady_cycles(monitored, healthy, wanted)
    if reference is None:
        raise StudyError(
            f"{monitored.name}: the simulated machine gives no steady cycles; expected some after its run-up"
        )
    found = [_of_machine(monitored, fault, reference, duration_s, wanted) for fault in monitored.faults]
    found += _of_sensors(monitored, healthy, reference, wanted, period_s)
    return tuple(signature for signature in found if signature is not None)


def _of_machine(
    monitored: MonitoredMachine, fault: MachineFault, reference: SteadyCycles, duration_s: float, names: tuple[str, ...]
) -> Signature | None:
    """Return the signature of a fault; where its response bends, sizes are added between those declared."""

    def response(size: float) -> SteadyCycles | None:
        try:
            parameters = monitored.varied(fault.changes(monitored.parameters, size))
            found = steady_cycles(monitored, noisy_draws(monitored, parameters, fault.command(size), duration_s), names)
            if found is None or not _scatters(found, reference):
                return found
            longer_s = duration_s + SCATTER_CYCLES / STEADY_CYCLES * (duration_s - monitored.declared.run_up_s)
            draws = noisy_draws(monitored, parameters, fault.command(size), longer_s)
            return steady_cycles(monitored, draws, names, SCATTER_CYCLES) or found
        except (ValidationError, MotionError):
            return None  # this machine cannot have the fault at that size

    responses = {size: found for size in fault.sizes if (found := response(size)) is not None}
    if not responses:
        return None
    responses[0.0] = reference._replace(covariance=np.zeros_like(reference.covariance))
    for _ in range(HALVINGS):
        for size in _between_bends(responses, reference):
            found = response(size)
            if found is not None:
                responses[size] = found
    return _signature_of_cycles(fault, responses, reference)


def _scatters(found: SteadyCycles, reference: SteadyCycles) -> bool:
    """Return whether a machine no longer repeats itself as the healthy one does."""
    own, usual = np.diag(found.covariance), np.diag(covariance_of_cycles(reference))
    return bool((own > LARGE_SCATTER * usual).any())


def covariance_of_cycles(steady: SteadyCycles) -> Array:
    """Return the covariance of the features, kept off zero so that it has a root."""
    floor = np.maximum(SMALLEST_SPREAD * np.abs(steady.mean), 1e-12) ** 2
    return np.asarray(steady.covariance + np.diag(floor + RIDGE * np.diag(steady.covariance)))


def _bends(responses: Mapping[float, SteadyCycles], reference: SteadyCycles) -> dict[float, tuple[Array, float]]:
    """Return by what each response may be off the line between two sizes, and that in the metric of naming, squared.

    A response that its neighbours' line misses by e bends by e/4 between itself and each of them.
    """
    sizes, found = sorted(responses), dict[float, tuple[Array, float]]()
    noise = covariance_of_cycles(reference)
    for before, size, after in zip(sizes, sizes[1:], sizes[2:], strict=False):
        if size == 0.0:
            continue  # faults of either sign are two lines
        share = (size - before) / (after - before)
        line = (1.0 - share) * responses[before].mean + share * responses[after].mean
        off = (responses[size].mean - line) * share * (1.0 - share)
        effect = responses[size].mean - reference.mean
        scatter = (noise + responses[size].covariance) / USED_CYCLES + np.diag((MODEL_SHARE * effect) ** 2)
        found[size] = off, float(off @ np.linalg.solve(scatter, off))
    return found


def _between_bends(responses: Mapping[float, SteadyCycles], reference: SteadyCycles) -> list[float]:
    """Return the sizes halfway from a bend to its neighbours."""
    sizes, found = sorted(responses), dict[float, None]()
    for size, (_, square) in _bends(responses, reference).items():
        place = sizes.index(size)
        if square > BEND:
            found |= dict.fromkeys(0.5 * (size + sizes[place + side]) for side in (-1, 1))
    return list(found)


def _signature_of_cycles(
    fault: MachineFault, responses: Mapping[float, SteadyCycles], reference: SteadyCycles
) -> Signature | None:
    """Return the signature of steady cycles by size: mean change, scatter from cycle to cycle, and where it bends."""
    sizes, bends = sorted(responses), _bends(responses, reference)
    changes = {size: responses[size].mean - reference.mean for size in sizes}
    whole = _signature(fault.name, fault.meaning, fault.unit, changes, fault.key)
    if whole is None:
        return None
    told: dict[str, Any] = {}
    if any(_scatters(responses[size], reference) for size in sizes):
        told["scatter"] = np.array([_factors(responses[size].covariance - reference.covariance) for size in sizes])
        told["cycles"] = np.array([float(responses[size].cycles) for size in sizes])
    if any(square > BEND for _, square in bends.values()):
        told["doubt"] = np.array([bends[size][0] if size in bends else np.zeros(len(reference.mean)) for size in sizes])
    return replace(whole, **told)


def _factors(covariance: Array) -> Array:
    """Return F (q, d) with F'F nearest to a covariance from below."""
    values, vectors = np.linalg.eigh(covariance)
    largest = slice(len(values) - min(FACTORS, len(values)), None)
    return np.asarray((np.sqrt(np.maximum(values[largest], 0.0)) * vectors[:, largest]).T)


def _of_sensors(
    monitored: MonitoredMachine, healthy: list[Seen], reference: SteadyCycles, names: tuple[str, ...], period_s: float
) -> list[Signature | None]:
    found, units = [], machine_columns(monitored.entry.build(monitored.parameters))
    for column in monitored.columns:
        if is_event(column):
            continue
        for kind, unit, fault in _sensor_faults(monitored, column, units, healthy[0], period_s):
            responses = {0.0: np.zeros(len(names))}
            for share in (1.0,) if kind == "stuck" else SENSOR_SHARES:
                wrong = [with_sensor_fault(seen, shifted(fault, share)) for seen in healthy]
                steady = steady_cycles(monitored, wrong, names)
                size = share if kind == "stuck" else share * (fault.bias or fault.gain or fault.lag_s)
                if steady is not None:
                    responses[size] = steady.mean - reference.mean
            meaning = f"the sensor of {column} is stuck" if kind == "stuck" else f"the sensor of {column}: wrong {kind}"
            found.append(_signature(f"sensor_{kind}:{column}", meaning, unit, responses, column))
    return found


def _sensor_faults(
    monitored: MonitoredMachine, column: str, units: Mapping[str, str], healthy: Seen, period_s: float
) -> list[tuple[str, str, SensorFault]]:
    """Return kind, unit of the size, and the largest fault of each kind that a sensor of this column may have."""
    reference = monitored.declared.reference
    turning = column == reference.column and reference.kind == "turn"
    swing = LARGEST_TURN_BIAS_RAD if turning else LARGEST_BIAS * float(np.ptp(healthy[column][1]))
    found = [
        ("bias", units[column], SensorFault(column, bias=swing)),
        ("lag", "s", SensorFault(column, lag_s=LARGEST_LAG * period_s)),
    ]
    if not turning:
        found.append(("gain", "1", SensorFault(column, gain=LARGEST_GAIN)))
    if column != reference.column:
        found.append(("stuck", "1", SensorFault(column, stuck=True)))
    return found


def noisy_draws(monitored: MonitoredMachine, parameters: Parameters, command: float, duration_s: float) -> list[Seen]:
    """Return a run seen a few times, each time through other noise, the same for all parameters."""
    machine, begin_s = monitored.entry.build(parameters), monitored.declared.run_up_s
    run = roll_out(machine, duration_s, needed_columns(monitored.sensors), None, command)
    if run.error is not None:
        raise run.error
    step_s = machine.coupling_step_s
    return [
        seen_roll_out(run, monitored.sensors, step_s, np.random.default_rng(draw), begin_s) for draw in range(DRAWS)
    ]


def steady_cycles(
    monitored: MonitoredMachine, draws: Iterable[Seen], names: tuple[str, ...], used: int = USED_CYCLES
) -> SteadyCycles | None:
    """Return the features of the last cycles, by what the healthy machine declares; None without a cycle.

    The covariance is that about the mean of each draw.
    """
    runs = [np.array([vector.values for vector in vectors[-used:]]) for vectors in map(monitored.vectors, draws)]
    if not all(map(len, runs)):
        return None
    all_names = [feature.name for feature in monitored.feed().features]
    places = [all_names.index(name) for name in names]
    rows = [run[:, places] for run in runs]
    mean = np.concatenate(rows).mean(axis=0)
    if not np.isfinite(mean).all():
        return None
    left = np.concatenate([row - row.mean(axis=0) for row in rows])
    return SteadyCycles(mean, left.T @ left / max(len(left) - len(rows), 1), len(rows[0]))


def _signature(name: str, meaning: str, unit: str, responses: Mapping[float, Array], key: str) -> Signature | None:
    if len(responses) < 2:
        return None
    sizes = sorted(responses)
    return Signature(name, meaning, unit, np.array(sizes), np.array([responses[size] for size in sizes]), key)

# SPDX-License-Identifier: Apache-2.0
"""Signatures by roll-out: what each fault of a machine, and of its sensors, does to the features of a cycle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidationError

from mech_twin.capabilities.cycle import Array, CycleFeatures
from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.faults import MachineFault
from mech_twin.capabilities.variation import varied
from mech_twin.engine.errors import MotionError
from mech_twin.engine.rollout import roll_out
from mech_twin.machines.catalog import Entry
from mech_twin.measurements.machine_columns import is_event, unit_of
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.parameters.load import catalogue_entry
from mech_twin.quantity import Parameters
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, FeatureVector, feed_channels
from mech_twin.studies.monitoring.naming import Signature
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

STEADY_CYCLES = 40  # simulated beyond the run-up
USED_CYCLES = 20  # at the end, whose mean counts
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


def machine_signatures(monitored: MonitoredMachine, names: Iterable[str]) -> tuple[Signature, ...]:
    """Return the signatures of every fault of machine and sensors, for these features.

    Healthy and faulty runs are seen with the same noise: features that are not linear in the samples, such as a share
    or a maximum, depend on it, and what is linear loses it in the difference.
    """
    wanted = tuple(names)
    period_s = mean_period_s(monitored)
    duration_s = monitored.declared.run_up_s + STEADY_CYCLES * period_s
    healthy = _draws(monitored, monitored.parameters, 1.0, duration_s)
    reference = _steady(monitored, healthy, wanted)
    if reference is None:
        raise StudyError(
            f"{monitored.name}: the simulated machine gives no steady cycles; expected some after its run-up"
        )
    found = [_of_machine(monitored, fault, reference, duration_s, wanted) for fault in monitored.faults]
    found += _of_sensors(monitored, healthy, reference, wanted, period_s)
    return tuple(signature for signature in found if signature is not None)


def _of_machine(
    monitored: MonitoredMachine, fault: MachineFault, reference: Array, duration_s: float, names: tuple[str, ...]
) -> Signature | None:
    responses = {0.0: np.zeros(len(names))}
    for size in fault.sizes:
        try:
            parameters = monitored.varied(fault.changes(monitored.parameters, size))
            draws = _draws(monitored, parameters, fault.command(size), duration_s)
        except (ValidationError, MotionError):
            continue  # this machine cannot have the fault at that size
        steady = _steady(monitored, draws, names)
        if steady is not None:
            responses[size] = steady - reference
    return _signature(fault.name, fault.meaning, fault.unit, responses, fault.key)


def _of_sensors(
    monitored: MonitoredMachine, healthy: list[Seen], reference: Array, names: tuple[str, ...], period_s: float
) -> list[Signature | None]:
    found = []
    for column in monitored.columns:
        if is_event(column):
            continue
        for kind, unit, fault in _sensor_faults(monitored, column, healthy[0], period_s):
            responses = {0.0: np.zeros(len(names))}
            for share in (1.0,) if kind == "stuck" else SENSOR_SHARES:
                wrong = [with_sensor_fault(seen, shifted(fault, share)) for seen in healthy]
                steady = _steady(monitored, wrong, names)
                size = share if kind == "stuck" else share * (fault.bias or fault.gain or fault.lag_s)
                if steady is not None:
                    responses[size] = steady - reference
            meaning = f"the sensor of {column} is stuck" if kind == "stuck" else f"the sensor of {column}: wrong {kind}"
            found.append(_signature(f"sensor_{kind}:{column}", meaning, unit, responses, column))
    return found


def _sensor_faults(
    monitored: MonitoredMachine, column: str, healthy: Seen, period_s: float
) -> list[tuple[str, str, SensorFault]]:
    """Return kind, unit of the size, and the largest fault of each kind that a sensor of this column may have."""
    reference = monitored.declared.reference
    turning = column == reference.column and reference.kind == "turn"
    swing = LARGEST_TURN_BIAS_RAD if turning else LARGEST_BIAS * float(np.ptp(healthy[column][1]))
    found = [
        ("bias", unit_of(column), SensorFault(column, bias=swing)),
        ("lag", "s", SensorFault(column, lag_s=LARGEST_LAG * period_s)),
    ]
    if not turning:
        found.append(("gain", "1", SensorFault(column, gain=LARGEST_GAIN)))
    if column != reference.column:
        found.append(("stuck", "1", SensorFault(column, stuck=True)))
    return found


def _draws(monitored: MonitoredMachine, parameters: Parameters, command: float, duration_s: float) -> list[Seen]:
    """Return a run seen a few times, each time through other noise, the same for all parameters."""
    machine, begin_s = monitored.entry.build(parameters), monitored.declared.run_up_s
    run = roll_out(machine, duration_s, needed_columns(monitored.sensors), None, command)
    if run.error is not None:
        raise run.error
    step_s = machine.coupling_step_s
    return [
        seen_roll_out(run, monitored.sensors, step_s, np.random.default_rng(draw), begin_s) for draw in range(DRAWS)
    ]


def _steady(monitored: MonitoredMachine, draws: Iterable[Seen], names: tuple[str, ...]) -> Array | None:
    """Return the mean features of the last cycles, by what the healthy machine declares; None without a cycle."""
    vectors = [vector for seen in draws for vector in monitored.vectors(seen)[-USED_CYCLES:]]
    if not vectors:
        return None
    places = [vectors[0].names.index(name) for name in names]
    mean = np.mean([vector.values[places] for vector in vectors], axis=0)
    return mean if bool(np.isfinite(mean).all()) else None


def _signature(name: str, meaning: str, unit: str, responses: Mapping[float, Array], key: str) -> Signature | None:
    if len(responses) < 2:
        return None
    sizes = sorted(responses)
    return Signature(name, meaning, unit, np.array(sizes), np.array([responses[size] for size in sizes]), key)

# SPDX-License-Identifier: Apache-2.0
"""Effect of each fault of a machine and of its sensors on the features of a cycle, by simulation.

For each size of a fault, the steady machine is simulated.  The signature holds the change of the mean features, their
excess covariance from cycle to cycle, and the error of linear interpolation between neighbouring sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy.linalg import eigh

from mech_twin.capabilities.cycle import Array
from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.faults import MachineFault
from mech_twin.engine.errors import MotionError
from mech_twin.measurements.machine_columns import is_event, machine_columns
from mech_twin.studies.monitoring.baseline import RIDGE, SMALLEST_SPREAD
from mech_twin.studies.monitoring.naming import MODEL_SHARE, USED_CYCLES, Signature
from mech_twin.studies.monitoring.sensing import (
    MonitoredMachine,
    Seen,
    SensorFault,
    SteadyCycles,
    mean_period_s,
    noisy_draws,
    steady_cycles,
    with_sensor_fault,
)

STEADY_CYCLES = 80  # simulated beyond the run-up
LARGE_SCATTER = 9.0  # times the healthy variance: beyond it the machine does not repeat itself
BEND = 1.0  # chi-square of the interpolation error above which sizes are added
HALVINGS = 2  # of the intervals next to a bend
FACTORS = 4  # of the excess covariance, at most
SENSOR_SHARES = np.array([-1.0, -0.3, -0.1, -0.03, 0.03, 0.1, 0.3, 1.0])
LARGEST_BIAS = 0.3  # of the channel's peak-to-peak value
LARGEST_GAIN = 0.3
LARGEST_LAG = 0.1  # of a cycle
LARGEST_TURN_BIAS_RAD = 0.3


class Cause(NamedTuple):
    """A fault of machine or sensor: description, sizes to simulate, and the steady cycles at a size if it has any."""

    name: str
    meaning: str
    unit: str
    key: str
    sizes: tuple[float, ...]
    response: Callable[[float], SteadyCycles | None]


def machine_signatures(monitored: MonitoredMachine, names: Iterable[str]) -> tuple[Signature, ...]:
    """Return the signatures of every fault of machine and sensors, for these features.

    Healthy and faulty runs have the same noise.  It cancels in the difference of features that are linear in the
    samples; other features, such as a share or a maximum, depend on it.
    """
    wanted, period_s = tuple(names), mean_period_s(monitored)
    duration_s = monitored.declared.run_up_s + STEADY_CYCLES * period_s
    healthy = noisy_draws(monitored, monitored.parameters, 1.0, duration_s)
    reference = steady_cycles(monitored, healthy, wanted)
    if reference is None:
        raise StudyError(
            f"{monitored.name}: the simulated machine gives no steady cycles; expected some after its run-up"
        )
    causes = [*_of_machine(monitored, duration_s, wanted), *_of_sensors(monitored, healthy, wanted, period_s)]
    found = (signature_of(cause, reference) for cause in causes)
    return tuple(signature for signature in found if signature is not None)


def signature_of(cause: Cause, reference: SteadyCycles) -> Signature | None:
    """Return the signature of a fault; sizes are added where its response is not linear; None without a response."""
    known = {size: found for size in cause.sizes if (found := cause.response(size)) is not None}
    if not known:
        return None
    known[0.0] = reference
    for _ in range(HALVINGS):
        _, bends = bends_of(known, reference)
        sizes = sorted(known)
        known |= {
            size: found
            for size in {0.5 * (sizes[k] + sizes[k + side]) for k in np.flatnonzero(bends) for side in (-1, 1)}
            if (found := cause.response(size)) is not None
        }
    sizes, (doubt, bends) = sorted(known), bends_of(known, reference)
    scatter = np.array([_factors(known[size].covariance, covariance_of_cycles(reference)) for size in sizes])
    uncertainty: dict[str, Array] = ({"scatter": scatter} if scatter.any() else {}) | (
        {"doubt": doubt} if bends.any() else {}
    )
    responses = np.array([known[size].mean - reference.mean for size in sizes])
    return Signature(cause.name, cause.meaning, cause.unit, np.array(sizes), responses, cause.key, **uncertainty)


def bends_of(known: Mapping[float, SteadyCycles], reference: SteadyCycles) -> tuple[Array, Array]:
    """Return the interpolation error (m, d) near each size, and whether it is significant (m,).

    If the line through the neighbours misses a response at mid-interval by e, the error beside it is e/4.
    """
    sizes = np.array(sorted(known))
    mean, noise = np.array([known[size].mean for size in sizes]), covariance_of_cycles(reference)
    off, seen = np.zeros_like(mean), np.zeros(len(sizes), bool)
    for k in range(1, len(sizes) - 1):
        if sizes[k] == 0.0:
            continue  # each sign of a fault has its own line
        share = (sizes[k] - sizes[k - 1]) / (sizes[k + 1] - sizes[k - 1])
        line = (1.0 - share) * mean[k - 1] + share * mean[k + 1]
        off[k] = (mean[k] - line) * share * (1.0 - share)
        unsure = (noise + known[sizes[k]].covariance) / USED_CYCLES
        scatter = unsure + np.diag((MODEL_SHARE * (mean[k] - reference.mean)) ** 2)
        seen[k] = off[k] @ np.linalg.solve(scatter, off[k]) > BEND
    return off, seen


def covariance_of_cycles(steady: SteadyCycles) -> Array:
    """Return the covariance of the features, regularised to be positive definite."""
    floor = np.maximum(SMALLEST_SPREAD * np.abs(steady.mean), 1e-12) ** 2
    return np.asarray(steady.covariance + np.diag(floor + RIDGE * np.diag(steady.covariance)))


def _factors(covariance: Array, usual: Array) -> Array:
    """Return factors F (q, d), F'F the part of the covariance that is large relative to the usual one."""
    values, vectors = eigh(covariance, usual)
    largest = np.where(values > LARGE_SCATTER, values, 0.0)[-FACTORS:]
    return np.asarray(np.sqrt(largest)[:, None] * (usual @ vectors[:, -FACTORS:]).T)


def _of_machine(monitored: MonitoredMachine, duration_s: float, names: tuple[str, ...]) -> Iterator[Cause]:
    for fault in monitored.faults:

        def response(size: float, fault: MachineFault = fault) -> SteadyCycles | None:
            try:
                parameters = monitored.varied(fault.changes(monitored.parameters, size))
                draws = noisy_draws(monitored, parameters, fault.command(size), duration_s)
                return steady_cycles(monitored, draws, names)
            except (ValidationError, MotionError):
                return None  # the machine cannot have the fault at that size

        yield Cause(fault.name, fault.meaning, fault.unit, fault.key, fault.sizes, response)


def _of_sensors(
    monitored: MonitoredMachine, healthy: list[Seen], names: tuple[str, ...], period_s: float
) -> Iterator[Cause]:
    reference, units = monitored.declared.reference, machine_columns(monitored.entry.build(monitored.parameters))
    for column in filter(lambda each: not is_event(each), monitored.columns):
        turning = column == reference.column and reference.kind == "turn"
        swing = LARGEST_TURN_BIAS_RAD if turning else LARGEST_BIAS * float(np.ptp(healthy[0][column][1]))
        kinds = {"bias": (units[column], swing), "lag_s": ("s", LARGEST_LAG * period_s)}
        kinds |= {} if turning else {"gain": ("1", LARGEST_GAIN)}
        kinds |= {} if column == reference.column else {"stuck": ("1", 1.0)}
        for kind, (unit, largest) in kinds.items():

            def response(size: float, kind: str = kind, column: str = column) -> SteadyCycles | None:
                wrong: dict[str, Any] = {kind: bool(size) if kind == "stuck" else size}
                fault = SensorFault(column, **wrong)
                return steady_cycles(monitored, [with_sensor_fault(seen, fault) for seen in healthy], names)

            name = kind.removesuffix("_s")
            meaning = f"the sensor of {column}" + (" is stuck" if kind == "stuck" else f": wrong {name}")
            sizes = (1.0,) if kind == "stuck" else tuple(largest * SENSOR_SHARES)
            yield Cause(f"sensor_{name}:{column}", meaning, unit, column, sizes, response)

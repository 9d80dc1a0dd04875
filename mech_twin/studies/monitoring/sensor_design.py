# SPDX-License-Identifier: Apache-2.0
"""Evaluates a sensor set by simulation: effect of each fault, delay of its detection, and isolability.

An effect r (d,) of a fault has the Mahalanobis norm w = sqrt(r' D S^-1 D r) in every cycle, D = diag(1 - sum of a_i).
Two faults i and j look alike if j at its best size explains i's effect; the share left unexplained is::

    open_ij = min over s of |r_i - r_j(s)|^2/|r_i|^2      in that metric

For each size of a fault, the steady machine is simulated.  Its signature holds the change of the mean features, their
excess covariance from cycle to cycle, and the error of linear interpolation between neighbouring sizes.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import ceil, isfinite
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy.linalg import eigh

from mech_twin.capabilities.cycle import Array
from mech_twin.capabilities.faults import MachineFault
from mech_twin.errors import MotionError, StudyError
from mech_twin.measurements.units import is_event, machine_columns
from mech_twin.parameters.load import kind_of
from mech_twin.studies.monitoring.baseline import RIDGE, SMALLEST_SPREAD, Baseline, fitted_baseline
from mech_twin.studies.monitoring.charts import ChartLimits, chart_limits, siegmund_run_length
from mech_twin.studies.monitoring.cycle_features import FeatureVector, available_features
from mech_twin.studies.monitoring.diagnosis import MODEL_SHARE, USED_CYCLES, Signature, residual_chi_square
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.monitoring.operating_fit import left_by_point, operating_surface, sister_surface
from mech_twin.studies.monitoring.sensing import (
    MonitoredMachine,
    Seen,
    SensorFault,
    SteadyCycles,
    mean_period_s,
    noisy_draws,
    seen_run,
    steady_cycles,
    with_sensor_fault,
)
from mech_twin.studies.monitoring.sensor_quality import SensorLimits, sensor_limits

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
DESIGN_CYCLES = 300
PROMPT_CYCLES = 50
INVISIBLE = 0.05  # standard deviations a cycle: less is not detected in thousands of cycles


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
    healthy = noisy_draws(monitored, monitored.parameters, duration_s)
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
                return steady_cycles(monitored, noisy_draws(monitored, parameters, duration_s), names)
            except (ValidationError, MotionError):
                return None  # the machine cannot have the fault at that size

        yield Cause(fault.name, fault.meaning, fault.unit, fault.key, fault.sizes, response)


def _of_sensors(
    monitored: MonitoredMachine, healthy: list[Seen], names: tuple[str, ...], period_s: float
) -> Iterator[Cause]:
    reference, units = monitored.declared.reference, machine_columns(monitored.entry.build(monitored.parameters))
    offered = available_features(monitored.declared, monitored.columns)
    needed = {reference.column}.union(*(feature.needs for feature in offered if feature.name in names))
    for column in (each for each in monitored.columns if each in needed and not is_event(each)):
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


class FaultDesign(NamedTuple):
    """How well the sensors detect one fault.

    Attributes
    ----------
    name, meaning, unit : str
        Name, description, and unit of the size.
    size : float
        Size at which the effect is given: the median of the declared sizes, the smaller of two.
    effect_sigma : float
        Norm w of the effect in every cycle, in standard deviations.
    delay_cycles : float
        Expected number of cycles from the fault to the alarm.
    smallest : float
        Smallest size that is detected within `PROMPT_CYCLES`; nan if none is.
    alike : tuple of str
        Faults that explain this one within the model error.
    """

    name: str
    meaning: str
    unit: str
    size: float
    effect_sigma: float
    delay_cycles: float
    smallest: float
    alike: tuple[str, ...]


class SensorDesign(NamedTuple):
    """Evaluation of a sensor set: each fault, and the share of row fault's effect that column fault cannot explain."""

    faults: tuple[FaultDesign, ...]
    isolability: Array
    features: tuple[str, ...]
    period_s: float


def simulated_vectors(monitored: MonitoredMachine, cycles: int, seed: int) -> list[FeatureVector]:
    """Return healthy cycles of the simulated machine, measured with these sensors."""
    begin_s = monitored.declared.run_up_s
    duration_s = begin_s + (cycles + 3) * mean_period_s(monitored)
    machine = monitored.entry.build(monitored.parameters)
    random = np.random.default_rng(seed)
    return monitored.vectors(seen_run(machine, monitored.sensors, duration_s, random=random, begin_s=begin_s))


def arl0_cycles(arl0_h: float, period_s: float) -> float:
    """Return the mean number of cycles between false alarms from that in hours, at least ten."""
    return max(3600.0 * arl0_h / period_s, 10.0)


def fitted_setup(
    monitored: MonitoredMachine,
    vectors: Sequence[FeatureVector],
    arl0_h: float,
    seed: int = 0,
) -> MonitorSetup:
    """Return the setup of a monitor from healthy cycles, for a required mean time between false alarms (h).

    If the machine declares operating variables, charts and signatures use the features with their effect removed.
    """
    return setup_for_cycles(monitored, vectors, lambda period_s: arl0_cycles(arl0_h, period_s), seed)


def setup_for_cycles(
    monitored: MonitoredMachine,
    vectors: Sequence[FeatureVector],
    wanted: float | Callable[[float], float],
    seed: int = 0,
    *,
    named: bool = True,
) -> MonitorSetup:
    """Return the setup for a required number of cycles between false alarms, or a function of the period (s).

    Without ``named`` there are no signatures: changes are detected, but not diagnosed.
    """
    raw, _ = fitted_baseline(vectors)
    surface, runs = operating_surface(monitored, vectors, raw.names), vectors
    if surface is not None:
        surface, runs = left_by_point(surface, vectors)
    baseline, innovations = fitted_baseline(runs)
    arl0 = wanted(baseline.period_s) if callable(wanted) else wanted
    limits = chart_limits(baseline, innovations, arl0, seed)
    signatures = machine_signatures(monitored, raw.names) if named else ()
    if surface is not None:
        signatures = tuple(map(surface.reduced_signature, signatures))
    return MonitorSetup(
        kind_of(monitored.name),
        baseline,
        limits,
        signatures,
        monitored.declared.settling_cycles,
        operating=surface,
        sensors=_sensor_limits(vectors),
    )


def sister_setup(sister: MonitorSetup, vectors: Sequence[FeatureVector]) -> MonitorSetup:
    """Return the setup of a machine with the configuration and sensors of another, from its own healthy cycles.

    Its healthy features and their noise come from its own cycles.  The effects of faults and operating points, and the
    thresholds in standard deviations of that noise, come from the sister.

    Raises
    ------
    StudyError
        Its features differ from its sister's.
    """
    raw, _ = fitted_baseline(vectors)
    surface, runs = sister.operating, vectors
    expected = sister.baseline.names if surface is None else surface.names
    if raw.names != expected:
        raise StudyError(f"features {', '.join(raw.names)}: expected those of its sisters, {', '.join(expected)}")
    if surface is not None:
        surface, runs = left_by_point(sister_surface(surface, vectors), vectors)
    baseline, _ = fitted_baseline(runs)
    return replace(sister, baseline=baseline, operating=surface, sensors=_sensor_limits(vectors))


def _sensor_limits(vectors: Sequence[FeatureVector]) -> dict[str, SensorLimits]:
    return sensor_limits([(vector.end_s - vector.begin_s, vector.quality) for vector in vectors])


def sensor_design(setup: MonitorSetup) -> SensorDesign:
    """Return the expected detection performance of a setup."""
    metric = steady_metric(setup.baseline)
    signatures = setup.signatures
    usual = [_usual(signature) for signature in signatures]
    isolability = np.array([[_share_unexplained(r, other, metric) for other in signatures] for _, r in usual])
    faults = []
    for i, (signature, (size, response)) in enumerate(zip(signatures, usual, strict=True)):
        alike = tuple(
            other.name for j, other in enumerate(signatures) if j != i and isolability[i, j] <= MODEL_SHARE**2
        )
        sizes, responses = signature.fine
        pairs = zip(sizes.ravel(), responses.reshape(-1, len(response)), strict=True)
        prompt = [abs(s) for s, r in pairs if expected_delay(r, setup.baseline, setup.limits) <= PROMPT_CYCLES]
        faults.append(
            FaultDesign(
                signature.name,
                signature.meaning,
                signature.unit,
                size,
                float(np.sqrt(response @ metric @ response)),
                expected_delay(response, setup.baseline, setup.limits),
                float(min(prompt, default=float("nan"))),
                alike,
            )
        )
    return SensorDesign(tuple(faults), isolability, setup.baseline.names, setup.baseline.period_s)


def steady_metric(baseline: Baseline) -> Array:
    """Return D S^-1 D (d, d): the metric by which a lasting change of the features counts in every cycle."""
    return np.asarray(baseline.steady[:, None] * np.linalg.inv(baseline.covariance) * baseline.steady)


def expected_delay(response: Array, baseline: Baseline, limits: ChartLimits) -> float:
    """Return the expected cycles until an alarm: the sooner of jump chart and CUSUM of the most shifted feature.

    The jump chart exceeds its threshold h after n cycles with n w^2 + d >= h, w the norm of the effect.
    """
    weight = float(response @ steady_metric(baseline) @ response)
    shift = float(np.abs(baseline.steady * response / baseline.sigma).max())
    if weight < INVISIBLE**2:
        return float("inf")
    jump = max(1, ceil((limits.alarm[1] - len(response)) / weight))
    drift = siegmund_run_length(limits.alarm[0], shift=shift)
    return float(min(jump, max(1.0, drift)))


def _usual(signature: Signature) -> tuple[float, Array]:
    """Return the median size of a fault, zero left out, and its effect (d,)."""
    places = [i for i in range(len(signature.sizes)) if signature.sizes[i] != 0.0]
    places.sort(key=lambda i: abs(signature.sizes[i]))
    place = places[(len(places) - 1) // 2]
    return float(signature.sizes[place]), signature.responses[place]


def _share_unexplained(response: Array, other: Signature, metric: Array) -> float:
    """Return the least share of an effect that another fault leaves unexplained, over all its sizes."""
    whole = float(response @ metric @ response)
    if whole <= 0.0:
        return 0.0
    share = float(residual_chi_square(response - other.fine[1], metric).min()) / whole
    return share if isfinite(share) else 1.0

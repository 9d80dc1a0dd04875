# SPDX-License-Identifier: Apache-2.0
"""The frozen reference of a healthy machine: mean, autoregression and covariance of its features.

The charts assume values that are independent from cycle to cycle.  So each feature is prewhitened by an
autoregression.  Burg's recursion fits it; the Bayesian information criterion selects the common order p::

    e_t = (x_t - m) - sum_i a_i (x_(t-i) - m),     i = 1 .. p

The residuals e are the innovations; S is their covariance across the features.

Its origin names runs, hashes of configuration and sensors, and the date.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, PlainValidator
from scipy.linalg import cholesky, solve_triangular

from mech_twin.capabilities.cycle import Array
from mech_twin.errors import StudyError
from mech_twin.kernels.kernel import kernel
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.studies.burg import best_order
from mech_twin.studies.monitoring.cycle_features import FeatureVector

APART = 1000  # numbers skipped between two runs, so that their cycles do not count as consecutive
OLD_DAYS = 90.0  # assumed: seasons change oil, bearings and mains
DAY_S = 86400.0
UNCOUNTED = {"source", "rate_hz", "sigma", "quantum", "jitter_s", "drop"}
LARGEST_ORDER = 4
LEAST_CYCLES = 30
CYCLES_PER_FEATURE = 3
SMALLEST_SPREAD = 1e-6  # lower bound of a standard deviation, as a share of the mean
RIDGE = 1e-6  # added to the diagonal, as a share of each variance
LARGEST = 1e30  # magnitude of any number in the file of a setup, SI


def _listed(value: Any) -> Array:
    """Return the numbers of nested lists, as the file of a setup holds them."""
    found = np.array(value)
    if not isinstance(value, list) or found.dtype.kind not in "if" or not (np.abs(found) <= LARGEST).all():
        raise ValueError(f"expected lists of numbers, none beyond {LARGEST:g}")
    return found.astype(np.float64)


def _instant(text: str) -> str:
    if datetime.fromisoformat(text).tzinfo is None:
        raise ValueError("expected an instant with its zone, as 2026-01-31T12:00:00+00:00")
    return text


Numbers = Annotated[Array, PlainValidator(_listed)]
Size = Annotated[float, Field(ge=0.0, le=LARGEST)]
Count = Annotated[int, Field(ge=0, le=2**53)]
Hash = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class BaselineRun(NamedTuple):
    """A healthy run of a baseline, and the number of its cycles used, from its beginning."""

    run: Annotated[str, Field(min_length=1)]
    cycles: Count

    @property
    def path(self) -> Path:
        """Path of the run."""
        return Path(self.run)


class Origin(NamedTuple):
    """Origin of a baseline.

    Attributes
    ----------
    made_utc : str
        Time of creation, ISO 8601.
    configuration, sensors : str
        SHA-256 hashes of the machine's configuration and of its sensors' definitions.
    runs : tuple of BaselineRun
        In the order they were given.
    """

    made_utc: Annotated[str, AfterValidator(_instant)]
    configuration: Hash
    sensors: Hash
    runs: Annotated[tuple[BaselineRun, ...], Field(min_length=1)]

    def age_days(self, now: datetime) -> float:
        """Return the age in days, at least 0, since clocks differ."""
        return max(0.0, (now - datetime.fromisoformat(self.made_utc)).total_seconds() / DAY_S)


def new_origin(now: datetime, parameters: BaseModel, given: MeasurementMap, runs: Iterable[BaselineRun]) -> Origin:
    """Return the origin of a baseline created at ``now``."""
    return Origin(now.isoformat(timespec="seconds"), configuration_hash(parameters), sensors_hash(given), tuple(runs))


def configuration_hash(parameters: BaseModel) -> str:
    """Return the hash of a machine's parameters, independent of how the file writes them."""
    return _hash(parameters.model_dump(mode="json"))


def sensors_hash(given: MeasurementMap) -> str:
    """Return the hash of the measured quantities with unit, zero, gain and lag.

    The topic or column of a channel, its rate and its noise are left out.
    """
    rows = [channel.model_dump(mode="json", exclude=UNCOUNTED) for channel in given.channels]
    return _hash(sorted(rows, key=lambda row: json.dumps(row, sort_keys=True)))


def joined_runs(runs: Sequence[Sequence[FeatureVector]]) -> list[FeatureVector]:
    """Return the cycles of several runs, numbered with a gap between runs."""
    found: list[FeatureVector] = []
    for vectors in runs:
        first = found[-1].number + APART if found else 0
        found += [vector._replace(number=first + vector.number) for vector in vectors]
    return found


def _hash(values: Any) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Baseline:
    """Statistics of the features of a healthy machine; they are not updated after the fit.

    Attributes
    ----------
    names : tuple of str
        Names of the d features.
    mean : ndarray
        Shape (d,), SI: mean of each feature.
    coefficients : ndarray
        Shape (p, d): the autoregression of each feature.
    covariance : ndarray
        Shape (d, d), of the innovations.
    cycles : int
        Number of healthy cycles it was fitted to.
    period_s : float
        Mean duration of these cycles.
    """

    names: tuple[str, ...]
    mean: Numbers
    coefficients: Numbers
    covariance: Numbers
    cycles: Annotated[int, Field(ge=1)]
    period_s: Annotated[float, Field(gt=0.0)]

    def __post_init__(self) -> None:
        """Reshape the coefficients to (p, d), also for order p = 0."""
        object.__setattr__(self, "coefficients", self.coefficients.reshape(-1, len(self.names)))

    @property
    def order(self) -> int:
        """Order of the autoregression."""
        return len(self.coefficients)

    @cached_property
    def sigma(self) -> Array:
        """Standard deviation of the innovations, shape (d,)."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def steady(self) -> Array:
        """Share of a lasting change of each feature that its innovations keep, shape (d,): 1 - sum of a_i."""
        return np.asarray(1.0 - self.coefficients.sum(axis=0))

    def impulse(self, cycles: int) -> Array:
        """Return the response of each feature to an innovation of 1, shape (cycles, d)."""
        return self.features(np.eye(cycles, 1) * np.ones(len(self.names))) - self.mean

    def innovations(self, rows: Array) -> Array:
        """Return the innovations of consecutive cycles, (n, d) to (n - p, d)."""
        return innovations_of(self.coefficients, rows - self.mean)

    def features(self, innovations: Array) -> Array:
        """Return the features (n, d) that innovations produce, starting at the mean: the inverse of `innovations`."""
        return features_of(self.coefficients, innovations) + self.mean

    def whitened(self, innovations: Array) -> Array:
        """Return innovations (n, d) of unit covariance: L^-1 e with S = L L'."""
        factor = cholesky(self.covariance, lower=True)
        return np.asarray(innovations @ solve_triangular(factor, np.eye(len(factor)), lower=True).T)


@kernel
def innovations_of(coefficients: Array, rows: Array) -> Array:
    """Return the innovations (n - p, d) of zero-mean features (n, d); ``coefficients`` is (p, d)."""
    order, (count, width) = len(coefficients), rows.shape
    found = np.empty((max(count - order, 0), width))
    for t in range(len(found)):
        for i in range(width):
            found[t, i] = rows[t + order, i]
        for lag in range(order):
            for i in range(width):
                found[t, i] -= coefficients[lag, i] * rows[t + order - 1 - lag, i]
    return found


@kernel
def features_of(coefficients: Array, innovations: Array) -> Array:
    """Return the zero-mean features (n, d) that innovations produce from zero: the inverse of `innovations_of`."""
    order, found = len(coefficients), np.empty(innovations.shape)
    for t in range(len(found)):
        for i in range(innovations.shape[1]):
            remembered = 0.0
            for lag in range(min(order, t) - 1, -1, -1):
                remembered += coefficients[lag, i] * found[t - 1 - lag, i]
            found[t, i] = innovations[t, i] + remembered
    return found


def feature_runs(vectors: Sequence[FeatureVector], names: Sequence[str]) -> list[Array]:
    """Return one matrix (n, d) for each run of consecutive cycles whose features are all finite."""
    runs: list[list[Array]] = [[]]
    number = None
    for vector in vectors:
        row = vector.row(names)
        whole = bool(np.isfinite(row).all())
        if (number is not None and vector.number != number + 1) or not whole:
            runs.append([])
        if whole:
            runs[-1].append(row)
        number = vector.number
    return [np.array(rows) for rows in runs if rows]


def fitted_baseline(vectors: Sequence[FeatureVector]) -> tuple[Baseline, list[Array]]:
    """Return the baseline fitted to healthy cycles, and its innovations for each run.

    A feature that is finite in at most half of the cycles is left out.

    Raises
    ------
    StudyError
        Too few cycles.
    """
    if not vectors:
        raise StudyError("the baseline holds no complete cycle")
    known = np.isfinite(np.array([vector.values for vector in vectors])).mean(axis=0)
    names = tuple(name for name, share in zip(vectors[0].names, known, strict=True) if share > 0.5)
    least = max(LEAST_CYCLES, CYCLES_PER_FEATURE * len(names))
    runs = [run for run in feature_runs(vectors, names) if len(run) > 2 * LARGEST_ORDER]
    cycles = sum(map(len, runs))
    if cycles < least:
        raise StudyError(f"the baseline holds {cycles} complete cycles; expected at least {least} healthy ones")
    period_s = float(np.mean([vector.end_s - vector.begin_s for vector in vectors]))
    return baseline_of_runs(names, runs, period_s)


def baseline_of_runs(names: tuple[str, ...], runs: Sequence[Array], period_s: float) -> tuple[Baseline, list[Array]]:
    """Return the baseline fitted to matrices of consecutive cycles, (n, d) each, and the innovations of each run."""
    mean = np.concatenate(runs).mean(axis=0)
    coefficients = best_order([run - mean for run in runs], LARGEST_ORDER).coefficients
    found = Baseline(names, mean, coefficients, np.eye(len(names)), sum(map(len, runs)), period_s)
    innovations = [found.innovations(run) for run in runs]
    every = np.concatenate(innovations)
    covariance = regularised(every.T @ every / max(len(every) - 1, 1), mean)
    return replace(found, covariance=covariance), innovations


def regularised(covariance: Array, mean: Array) -> Array:
    """Return a covariance (d, d) of features with this mean (d,), made positive definite."""
    spread = np.maximum(np.diag(covariance), np.maximum(SMALLEST_SPREAD * np.abs(mean), 1e-12) ** 2)
    return np.asarray(covariance + np.diag(spread - np.diag(covariance) + RIDGE * spread))

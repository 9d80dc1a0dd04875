# SPDX-License-Identifier: Apache-2.0
"""Validation of a monitor's setup file, which a user may have edited, cut or made with another program."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from mech_twin.files.output_file import of_plain
from mech_twin.studies.monitoring.baseline import LARGEST_ORDER
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.monitoring.operating import polynomial_terms

LARGEST = 1e30  # magnitude of any number, SI
SMALLEST_VARIANCE = 1e-60
MOST_FEATURES, MOST_SIZES, MOST_SIGNATURES = 1000, 1000, 1000
MOST_CYCLES = 2**53
LONGEST_S = 1e9
MOST_VARIABLES, MOST_TERMS = 20, 2000
LARGEST_BYTES = 64 << 20
MOST_RUNS = 10_000

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Size = Annotated[float, Field(ge=0.0, le=LARGEST)]
Words = Annotated[str, Field(min_length=1, max_length=200)]
Hash = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Row = Annotated[list[Number], Field(max_length=MOST_FEATURES)]
Rows = Annotated[list[Row], Field(max_length=MOST_SIZES)]


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class BaselineRecord(_Record):
    """See `Baseline`."""

    names: Annotated[list[Words], Field(min_length=1, max_length=MOST_FEATURES)]
    mean: Row
    coefficients: Annotated[list[Row], Field(max_length=LARGEST_ORDER)]
    covariance: Rows
    cycles: Annotated[int, Field(ge=1, le=MOST_CYCLES)]
    period_s: Annotated[float, Field(gt=0.0, le=LONGEST_S)]

    @model_validator(mode="after")
    def _fits(self) -> BaselineRecord:
        features = len(self.names)
        if len(set(self.names)) < features:
            raise ValueError("names: expected each once")
        _check_rows("mean", [self.mean], 1, features)
        _check_rows("coefficients", self.coefficients, len(self.coefficients), features)
        _check_rows("covariance", self.covariance, features, features)
        _check_covariance(np.array(self.covariance))
        return self


class _Charts(_Record):
    cusum: Size
    glr: Size
    chi_square: Size


class LimitsRecord(_Record):
    """See `ChartLimits`."""

    alarm: _Charts
    quiet: _Charts
    arl0_cycles: Annotated[float, Field(gt=0.0, le=LARGEST)]
    extrapolated: bool


class SignatureRecord(_Record):
    """See `Signature`."""

    name: Words
    meaning: str
    unit: str
    key: str
    sizes: Annotated[list[Number], Field(min_length=2, max_length=MOST_SIZES)]
    responses: Rows
    scatter: Annotated[list[Rows], Field(max_length=MOST_SIZES)] | None = None
    cycles: list[Number] | None = Field(default=None, max_length=MOST_SIZES, exclude=True)  # of older setups, unused
    doubt: Rows | None = None
    points: Rows | None = None

    @model_validator(mode="after")
    def _fits(self) -> SignatureRecord:
        sizes = len(self.sizes)
        if not (np.diff(self.sizes) > 0.0).all() or 0.0 not in self.sizes:
            raise ValueError("sizes: expected ascending ones, with 0")
        if self.scatter and len(self.scatter) != sizes:
            raise ValueError(f"scatter: expected {sizes}, one of each size")
        return self

    def check_features(self, features: int) -> None:
        """Raise ValueError if its arrays do not have this number of features."""
        sizes = len(self.sizes)
        _check_rows(f"responses of {self.name!r}", self.responses, sizes, features)
        if self.doubt:
            _check_rows(f"doubt of {self.name!r}", self.doubt, sizes, features)
        for rows in self.scatter or ():
            _check_rows(f"scatter of {self.name!r}", rows, len((self.scatter or [rows])[0]), features)


class _Rules(_Record):
    debounce: Annotated[int, Field(ge=1, le=MOST_CYCLES)]
    clear: Annotated[int, Field(ge=1, le=MOST_CYCLES)]
    announce_every_s: Annotated[float, Field(ge=0.0, le=LONGEST_S)]


class OperatingRecord(_Record):
    """See `OperatingSurface`."""

    names: Annotated[list[Words], Field(min_length=2, max_length=MOST_FEATURES)]
    variables: Annotated[list[Words], Field(min_length=1, max_length=MOST_VARIABLES)]
    beyond: Annotated[list[Words], Field(max_length=MOST_VARIABLES)]
    pivots: Annotated[list[Annotated[int, Field(ge=0, lt=MOST_FEATURES)]], Field(max_length=MOST_VARIABLES)]
    ranges: Annotated[list[Annotated[float, Field(gt=0.0, le=10.0)]], Field(max_length=MOST_VARIABLES)]
    mean: Row
    root: Rows
    coefficients: Annotated[list[Row], Field(max_length=MOST_TERMS)]
    doubt: Row
    drift: Row | None = None
    wander: Row
    moved: Row
    transient: Rows
    hold: Annotated[int, Field(ge=1, le=10_000)]

    @model_validator(mode="after")
    def _fits(self) -> OperatingRecord:
        d, q = len(self.names), len(self.variables)
        if len(set(self.names)) < d or len(set(self.pivots)) < q or not all(place < d for place in self.pivots):
            raise ValueError(f"names and pivots: expected each once, pivots below {d}")
        if q >= d or not q == len(self.beyond) == len(self.pivots) == len(self.ranges):
            raise ValueError(f"beyond, pivots, ranges: expected {q}, one of each variable, fewer than names")
        _check_rows("mean", [self.mean], 1, d)
        _check_rows("root", self.root, d, d)
        _check_rows("coefficients", self.coefficients, len(polynomial_terms(q)), d)
        _check_rows("doubt", [self.doubt], 1, d - q)
        self.drift = [0.0] * (d - q) if self.drift is None else self.drift  # an older setup has none
        _check_rows("drift", [self.drift], 1, d - q)
        _check_rows("wander and moved", [self.wander, self.moved], 2, q)
        _check_rows("transient", self.transient, q, d - q)
        slopes = np.array(self.coefficients)[:q][:, self.pivots]
        if not abs(np.linalg.det(slopes / np.maximum(np.abs(slopes).max(axis=0), 1e-300))) > 1e-9:
            raise ValueError("coefficients: expected pivots that tell the variables apart")
        return self


class SensorRecord(_Record):
    """See `SensorLimits`."""

    rate_hz: Annotated[float, Field(gt=0.0, le=LARGEST)]
    spacing_s: Annotated[float, Field(gt=0.0, le=LONGEST_S)]
    lost: Annotated[float, Field(ge=0.0, le=1.0)]
    equal_share: Annotated[float, Field(ge=0.0, le=1.0)]
    isolation: Size


class BaselineRunRecord(_Record):
    """See `BaselineRun`."""

    run: Annotated[str, Field(min_length=1, max_length=4096)]
    cycles: Annotated[int, Field(ge=0, le=MOST_CYCLES)]


class OriginRecord(_Record):
    """See `Origin`."""

    made_utc: Words
    configuration: Hash
    sensors: Hash
    runs: Annotated[list[BaselineRunRecord], Field(min_length=1, max_length=MOST_RUNS)]

    @field_validator("made_utc")
    @classmethod
    def _is_an_instant(cls, text: str) -> str:
        if datetime.fromisoformat(text).tzinfo is None:
            raise ValueError("expected an instant with its zone, as 2026-01-31T12:00:00+00:00")
        return text


class SetupRecord(_Record):
    """See `MonitorSetup`."""

    machine: Words
    baseline: BaselineRecord
    limits: LimitsRecord
    signatures: Annotated[list[SignatureRecord], Field(max_length=MOST_SIGNATURES)]
    settling_cycles: Annotated[int, Field(ge=0, le=MOST_CYCLES)]
    rules: _Rules
    operating: OperatingRecord | None = None
    sensors: Annotated[dict[Words, SensorRecord], Field(max_length=MOST_FEATURES)] = {}
    origin: OriginRecord | None = None

    @model_validator(mode="after")
    def _fits(self) -> SetupRecord:
        names = [signature.name for signature in self.signatures]
        if len(set(names)) < len(names):
            raise ValueError("signatures: expected each name once")
        for signature in self.signatures:
            signature.check_features(len(self.baseline.names))
            if signature.points:
                variables = 0 if self.operating is None else len(self.operating.variables)
                _check_rows(f"points of {signature.name!r}", signature.points, len(signature.sizes), variables)
        if self.operating is not None:
            pivots = {self.operating.names[place] for place in self.operating.pivots}
            if self.baseline.names != [name for name in self.operating.names if name not in pivots]:
                raise ValueError("baseline.names: expected those of operating.names that are no pivots")
        return self

    def setup(self) -> MonitorSetup:
        """Return the validated setup."""
        return of_plain(MonitorSetup, self.model_dump(exclude_none=True))  # type: ignore[no-any-return]


def _check_rows(name: str, rows: list[list[float]], number: int, features: int) -> None:
    if len(rows) != number or any(len(row) != features for row in rows):
        raise ValueError(f"{name}: expected {number} x {features} numbers, as many as names")


def _check_covariance(covariance: Any) -> None:
    if not np.allclose(covariance, covariance.T, rtol=1e-9, atol=0.0):
        raise ValueError("covariance: expected a symmetric matrix")
    spread = np.diag(covariance)
    if not (spread >= SMALLEST_VARIANCE).all():
        raise ValueError(f"covariance: expected variances of at least {SMALLEST_VARIANCE:g}")
    unit = covariance / np.sqrt(np.outer(spread, spread))
    if not np.linalg.eigvalsh(unit)[0] > 0.0:
        raise ValueError("covariance: expected a positive definite matrix")

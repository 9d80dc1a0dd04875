# SPDX-License-Identifier: Apache-2.0
"""Origin of a baseline: its runs, hashes of its configuration and sensors, and its date."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel

from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.studies.monitoring.cycle_features import FeatureVector

APART = 1000  # numbers skipped between two runs, so that their cycles do not count as consecutive
OLD_DAYS = 90.0  # assumed: seasons change oil, bearings and mains
DAY_S = 86400.0
UNCOUNTED = {"source", "rate_hz", "sigma", "quantum", "jitter_s", "drop"}


class BaselineRun(NamedTuple):
    """A healthy run of a baseline, and the number of its cycles used, from its beginning."""

    run: str
    cycles: int

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

    made_utc: str
    configuration: str
    sensors: str
    runs: tuple[BaselineRun, ...]

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

# SPDX-License-Identifier: Apache-2.0
"""Where a baseline comes from: its runs, the configuration and sensors that it was made for, and when."""

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

APART = 1000  # cycles left out between two runs, so that none is taken for the other's next
OLD_DAYS = 90.0  # assumed: seasons change oil, bearings and mains
DAY_S = 86400.0
UNCOUNTED = {"source", "rate_hz", "sigma", "quantum", "jitter_s", "drop"}


class BaselineRun(NamedTuple):
    """A healthy run of a baseline, and the cycles that it gave, the first ones."""

    run: str
    cycles: int

    @property
    def path(self) -> Path:
        """Where it is."""
        return Path(self.run)


class Origin(NamedTuple):
    """Where a baseline comes from.

    Attributes
    ----------
    made_utc : str
        When, as ISO 8601.
    configuration, sensors : str
        Hashes (SHA-256) of the machine's numbers, and of what its sensors measure.
    runs : tuple of BaselineRun
        In the order they were given.
    """

    made_utc: str
    configuration: str
    sensors: str
    runs: tuple[BaselineRun, ...]

    def age_days(self, now: datetime) -> float:
        """Return how old it is; not below 0, as clocks differ."""
        return max(0.0, (now - datetime.fromisoformat(self.made_utc)).total_seconds() / DAY_S)


def new_origin(now: datetime, parameters: BaseModel, given: MeasurementMap, runs: Iterable[BaselineRun]) -> Origin:
    """Return the origin of a baseline that is made now."""
    return Origin(now.isoformat(timespec="seconds"), configuration_hash(parameters), sensors_hash(given), tuple(runs))


def configuration_hash(parameters: BaseModel) -> str:
    """Return the hash of a machine's numbers, however they were written down."""
    return _hash(parameters.model_dump(mode="json"))


def sensors_hash(given: MeasurementMap) -> str:
    """Return the hash of what sensors measure, in which unit, with which zero, gain and lag.

    From which topic or column it is read does not count, and how noisy it is neither.
    """
    rows = [channel.model_dump(mode="json", exclude=UNCOUNTED) for channel in given.channels]
    return _hash(sorted(rows, key=lambda row: json.dumps(row, sort_keys=True)))


def joined_runs(runs: Sequence[Sequence[FeatureVector]]) -> list[FeatureVector]:
    """Return the cycles of several runs, each run's numbered apart from the others'."""
    found: list[FeatureVector] = []
    for vectors in runs:
        first = found[-1].number + APART if found else 0
        found += [vector._replace(number=first + vector.number) for vector in vectors]
    return found


def _hash(values: Any) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()

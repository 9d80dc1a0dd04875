# SPDX-License-Identifier: Apache-2.0
"""Where a baseline comes from: several days joined, hashes of what it was made for, and its age."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from pydantic import ValidationError
from studies.monitoring.synthetic import autoregressive, vectors
from studies.monitoring.test_machines import monitored

from mech_twin.files.output_file import plain
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.monitoring.baseline import (
    BaselineRun,
    configuration_hash,
    fitted_baseline,
    joined_runs,
    new_origin,
    sensors_hash,
)
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.monitoring.setup_record import SETUP

DAYS = 3
NOTHING = np.empty((0, 2))
MADE = datetime(2026, 1, 31, 12, tzinfo=UTC)


def days() -> list[np.ndarray]:
    """Return rows of features of several days, each about a level of its own."""
    return [autoregressive(200, NOTHING, np.eye(2), seed) + 3.0 * seed for seed in range(DAYS)]


def test_days_join_and_no_cycle_follows_one_of_another_day() -> None:
    joined = joined_runs([vectors(rows) for rows in days()])
    numbers = [vector.number for vector in joined]
    assert len(joined) == 600 and len(set(numbers)) == 600
    baseline, innovations = fitted_baseline(joined)
    assert baseline.cycles == 600 and len(innovations) == DAYS
    assert baseline.mean == pytest.approx(np.concatenate(days()).mean(axis=0))
    (one,) = (fitted_baseline(vectors(days()[1]))[0],)
    assert (baseline.covariance.diagonal() + 1e-9 >= one.covariance.diagonal()).all()


def test_a_number_of_the_machine_changes_the_hash_and_the_order_of_settings_does_not() -> None:
    plain = machine_parameters("impact_mass")
    heavier = machine_parameters("impact_mass", None, {"restitution": 0.4})
    assert configuration_hash(plain) == configuration_hash(machine_parameters("impact_mass"))
    assert configuration_hash(plain) != configuration_hash(heavier)
    same = [machine_parameters("impact_mass", None, dict(each)) for each in (SETTINGS, SETTINGS[::-1])]
    assert configuration_hash(same[0]) == configuration_hash(same[1])


SETTINGS = [("restitution", 0.4), ("phase1_force_n", 500.0)]


@pytest.mark.parametrize(
    ("changed", "counts"), [({"zero": 1.0}, True), ({"lag_s": 0.01}, True), ({"sigma": 9.0}, False)]
)
def test_what_sensors_measure_counts_and_how_noisy_they_are_does_not(changed: dict[str, float], counts: bool) -> None:
    given = monitored("impact_mass").sensors
    first, *others = given.channels
    other = given.model_copy(update={"channels": (*others, first.model_copy(update=changed))})
    assert (sensors_hash(given) != sensors_hash(other)) is counts


@pytest.mark.slow
def test_the_origin_is_kept_in_the_file_and_nonsense_in_it_is_refused() -> None:
    baseline, innovations = fitted_baseline(joined_runs([vectors(rows) for rows in days()]))
    machine = monitored("impact_mass")
    runs = [BaselineRun(f"/runs/{day}.csv", 200) for day in range(DAYS)]
    origin = new_origin(MADE, machine.parameters, machine.sensors, runs)
    limits = chart_limits(baseline, innovations, 1000.0)
    record = json.loads(json.dumps(plain(replace(MonitorSetup("none", baseline, limits), origin=origin))))
    assert SETUP.validate_json(json.dumps(record)).origin == origin
    for key, value in (
        ("made_utc", "yesterday"),
        ("made_utc", "2026-01-31T12:00:00"),
        ("configuration", "x"),
        ("runs", []),
    ):
        wrong = record | {"origin": record["origin"] | {key: value}}
        with pytest.raises(ValidationError, match=f"origin.{key}"):
            SETUP.validate_json(json.dumps(wrong))


def test_a_baseline_ages() -> None:
    machine = monitored("impact_mass")
    origin = new_origin(MADE, machine.parameters, machine.sensors, [BaselineRun("a", 1)])
    assert origin.age_days(MADE + timedelta(days=41)) == pytest.approx(41.0, abs=0.1)
    assert origin.age_days(MADE - timedelta(days=1)) == 0.0

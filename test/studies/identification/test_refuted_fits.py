# SPDX-License-Identifier: Apache-2.0
"""What the noise refutes, in runs of any length, and which error of a sensor is told as the likely cause."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import Channel
from mech_twin.measurements.sensors import event_values
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.fit_quality import channel_noise
from mech_twin.studies.identification.fit_runs import (
    ColumnCurves,
    FitRun,
    fit_channel,
    needed_columns,
    placed_run,
)
from mech_twin.studies.identification.identification import Identification, identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.staged_fit import AGREEING
from mech_twin.studies.named_rollouts import rollout

CRANK, SLIDER, TORQUE = "linkage.crank.position", "linkage.slider.position", "motor.motor.effort"
SIGMAS = {CRANK: 0.002, SLIDER: 3e-4, TORQUE: 2.0}
TRUE = {"crank_m": 0.131, "masses.tree_kg": 58.0}


def channel(name: str, sigma: float, times_s: Array, values: Array, **given: Any) -> Any:
    source = {"source": {"column": name}, "is": name, "sigma": sigma}
    return fit_channel(Channel.model_validate({**source, **given}), times_s, values, 0.0)


def crank_run(lags_s: Mapping[str, float], zeros: Mapping[str, float], clock: float, hum_nm: float = 0.0) -> FitRun:
    """Return a run of a crank whose sensors have errors that their map does not tell."""
    curves = ColumnCurves(rollout("vibration_crank", 1.6, TRUE, columns=needed_columns(list(SIGMAS))))
    random, channels = np.random.default_rng(3), []
    for name, sigma in SIGMAS.items():
        times = np.arange(0.05, 1.5, 0.005)
        true = curves.at(name, times - lags_s.get(name, 0.0))
        true += hum_nm * np.sin(251.0 * times) if name == TORQUE else 0.0
        shown = true + zeros.get(name, 0.0) + sigma * random.standard_normal(len(true))
        channels.append(channel(name, sigma, times * (1.0 + clock), shown, zero="free" if name == CRANK else 0.0))
    return placed_run(Path("run"), channels, None, begin_known=True)


def fitted(run: FitRun) -> Identification:
    question = IdentificationQuestion("vibration_crank", machine_parameters("vibration_crank"), tuple(TRUE), cores=1)
    return identified(question, [run])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("errors", "told", "size"),
    [
        ({"zeros": {TORQUE: 20.0}}, f"a zero of {TORQUE} that is off by", 20.0),
        ({"lags_s": {SLIDER: 0.004}}, f"a lag of {SLIDER} that is off by", 0.004),
        ({"clock": 0.002}, "a clock", 0.2),
        ({"lags_s": dict.fromkeys(SIGMAS, -0.004)}, "a run that begins", 0.004),
        ({"lags_s": dict.fromkeys(SIGMAS, 0.004)}, "a run that begins", 0.004),
    ],
)
def test_an_error_of_a_sensor_that_the_map_does_not_tell_is_the_cause_that_is_told(
    errors: dict[str, Any], told: str, size: float
) -> None:
    """A constant offset is white about its mean, and refutes the fit all the same."""
    found = fitted(crank_run(**{"lags_s": {}, "zeros": {}, "clock": 0.0, **errors}))
    assert {key.verdict for key in found.keys} == {"model_error"}
    assert found.search.starts < AGREEING  # no search of the keys for what they do not explain
    _, _, words = found.keys[0].reason.partition(f"{told} ")
    assert float(words.split()[0]) == pytest.approx(size, rel=0.03)
    assert "what noise does not" in words


@pytest.mark.slow
@pytest.mark.parametrize("deviation_kg", [0.02, 0.2, 1.0])
def test_a_prior_that_the_run_contradicts_is_told_with_the_value_of_the_run(deviation_kg: float) -> None:
    """Without the prior the keys would explain the residuals, and nothing is left for a sensor."""
    base, wrong = machine_parameters("vibration_crank"), {"masses.tree_kg": (50.0, deviation_kg)}
    question = IdentificationQuestion("vibration_crank", base, tuple(TRUE), {}, wrong, cores=1)
    for key in identified(question, [crank_run({}, {}, 0.0)]).keys:
        _, _, words = key.reason.partition("a prior of masses.tree_kg about ")
        assert float(words.split()[0]) == pytest.approx(TRUE["masses.tree_kg"], rel=0.01)
        assert " or " not in words


@pytest.mark.slow
def test_keys_are_searched_further_where_a_cause_explains_only_a_part() -> None:
    """The zero takes the residual of the torque from 4.2 to 3.6 N m, within twice its noise; the hum stays."""
    found = fitted(crank_run({}, {TORQUE: 2.0}, 0.0, 4.3))
    assert found.search.starts >= AGREEING
    assert "would explain" not in found.keys[0].reason


def test_an_error_within_the_noise_is_told_beside_the_keys_that_it_moves() -> None:
    """A clock of 0.012 % moves the crank by 1.4 standard deviations at the end: no fit is refuted by that."""
    found = fitted(crank_run({}, {}, 1.2e-4))
    for key in found.keys:
        assert key.verdict == "identified"
        _, _, words = key.reason.partition("; but a clock ")
        assert float(words.split()[0]) == pytest.approx(0.012, rel=0.25)


def test_keys_are_identified_where_the_map_tells_all() -> None:
    found = fitted(crank_run({}, {}, 0.0))
    for key in found.keys:
        assert key.verdict == "identified"
        assert ";" not in key.reason
        assert abs(key.estimate - TRUE[key.key]) <= 2.0 * (key.high_95 - key.estimate)


@pytest.mark.parametrize(("name", "rate"), [("event.blow.time", 1.0), (CRANK, 100.0)])
def test_what_a_channel_may_be_off_does_not_grow_with_the_length_of_its_run(name: str, rate: float) -> None:
    """Times of events and angles of a crank rise steadily: their spread is the length of the run, not a size."""
    noises = []
    for duration_s in (2.0, 200.0):
        times = np.arange(0.04, duration_s, 0.04)
        run = placed_run(Path("run"), [channel(name, 1e-9, times, rate * times)], None, begin_known=True)
        noises.append(channel_noise((run,), 0)[0])
    assert noises[0] == pytest.approx(noises[1], rel=1e-9)


@pytest.mark.slow
def test_bounces_of_a_series_count_alike_in_a_run_and_in_the_part_of_it_that_is_fitted() -> None:
    """The usual spacing of events differs between the two; which bounces follow closely must not."""
    true = {"restitution": 0.36, "phase1_duration_s": 0.035, "mass_kg": 1.1}
    run = rollout("impact_mass", 0.8, true, columns=needed_columns(["linkage.mass.position"]))
    random = np.random.default_rng(0)
    times = np.arange(0.0, 0.8, 5e-4)
    shown = ColumnCurves(run).at("linkage.mass.position", times) + 2e-4 * random.standard_normal(len(times))
    impacts = event_values(run, "impact", "time")
    impacts = np.sort(impacts + 1e-5 * random.standard_normal(len(impacts)))
    channels = [
        channel("linkage.mass.position", 2e-4, times, shown),
        channel("event.impact.time", 1e-5, impacts, impacts),
    ]
    question = IdentificationQuestion("impact_mass", machine_parameters("impact_mass"), tuple(true), cores=1)
    found = identified(question, [placed_run(Path("run"), channels, None, begin_known=True)], share=0.2)
    assert {key.verdict for key in found.keys} == {"identified"}
    assert found.better


@pytest.mark.slow
def test_times_of_events_tell_a_wrong_clock_too() -> None:
    """A clock is told of events as of samples: the same share of the time since the start."""
    true = {"restitution": 0.36, "mass_kg": 1.1}
    impacts = 1.002 * event_values(rollout("impact_mass", 0.4, true), "impact", "time")
    only = channel("event.impact.time", 1e-5, impacts, impacts)
    question = IdentificationQuestion("impact_mass", machine_parameters("impact_mass"), tuple(true), cores=1)
    found = identified(question, [placed_run(Path("run"), [only], None, begin_known=True)])
    assert "a clock 0." in found.keys[0].reason
    assert "too fast" in found.keys[0].reason


def test_a_run_with_events_where_the_model_has_none_is_refuted() -> None:
    """The mass first strikes after 29 ms."""
    impacts = np.array([0.005, 0.012, 0.02])
    only = channel("event.impact.time", 1e-5, impacts, impacts)
    question = IdentificationQuestion("impact_mass", machine_parameters("impact_mass"), ("restitution",), cores=1)
    found = identified(question, [placed_run(Path("run"), [only], None, begin_known=True)])
    assert found.keys[0].verdict in ("model_error", "not_converged", "not_excited")

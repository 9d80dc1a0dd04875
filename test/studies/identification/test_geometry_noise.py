# SPDX-License-Identifier: Apache-2.0
"""Lengths from positions of unequal noise: each channel counts by its own, and what is not seen stays."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from mech_twin.measurements.measurement_map import Channel
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.geometry_fit import (
    GeometryData,
    GeometryModel,
    GeometryProblem,
    geometry_report,
    own_errors,
    weighted,
)
from mech_twin.studies.identification.keyed_configuration import declared_bounds

MACHINE, PLATE, PENDULUM = "compaction_press", "linkage.plate.position", "linkage.pendulum.position"
TRUE = {"linkage.crank_m": 0.062, "linkage.coupler_m": 0.52, "linkage.pendulum_m": 0.31}
SAMPLES = 400


def model(*keys: str) -> GeometryModel:
    return GeometryModel(MACHINE, machine_parameters(MACHINE), keys, columns=(PLATE, PENDULUM))


def measured(seed: int, sigmas: tuple[float, float]) -> GeometryData:
    """Return a run of the true press, its two angles with noise of their own."""
    random, times = np.random.default_rng(seed), np.linspace(0.0, 1.0, SAMPLES)
    curves, channels = model(*TRUE).positions(list(TRUE.values())), list[Any]()
    for name, sigma in zip((PLATE, PENDULUM), sigmas, strict=True):
        given = Channel.model_validate({"source": {"column": name}, "is": name})
        shown = curves[name](10.0 * np.pi * times) + sigma * random.standard_normal(SAMPLES)
        channels.append(SimpleNamespace(name=name, channel=given, times_s=times, values=shown))
    return GeometryData(CubicSpline(times, 10.0 * np.pi * times), 0.0, 1.0, 0.0, tuple(channels))


@pytest.mark.slow
@pytest.mark.parametrize("sigmas", [(3e-4, 1e-2), (1e-2, 3e-4)])
def test_errors_are_those_of_weighted_least_squares_where_one_channel_is_much_noisier(
    sigmas: tuple[float, float],
) -> None:
    """By hand: derivatives of the true curves over each channel's noise, and the inverse of their squares."""
    keyed, values = model(*TRUE), np.array(list(TRUE.values()))
    angles, columns = 10.0 * np.pi * np.linspace(0.0, 1.0, SAMPLES), []
    for i in range(len(values)):
        step = 1e-5 * np.eye(len(values))[i]
        ends = keyed.positions(values + step), keyed.positions(values - step)
        pairs = zip((PLATE, PENDULUM), sigmas, strict=True)
        columns.append(np.concatenate([(ends[0][n](angles) - ends[1][n](angles)) / 2e-5 / s for n, s in pairs]))
    rows = np.array(columns)
    by_hand = np.sqrt(np.diag(np.linalg.inv(rows @ rows.T)))
    for seed in range(3):
        runs = [measured(seed, sigmas)]
        problem = GeometryProblem(keyed, runs)
        fit = weighted(keyed, runs, problem.solved())
        assert own_errors(fit, len(values), problem.key_scale()) == pytest.approx(by_hand, rel=0.2)
        assert np.all(np.abs(fit.keys - values) < 4.0 * by_hand)


@pytest.mark.slow
def test_a_noisy_channel_is_no_other_mechanism_and_a_key_that_moves_nothing_stays() -> None:
    """The pendulum swings by 0.15 rad: noise of 0.02 rad leaves a fit below 90 %."""
    unmoved = "drive.speed_rpm"
    report, found = geometry_report(model(*TRUE, unmoved), [measured(1, (3e-4, 2e-2))], None)
    assert min(report.fit_percent.values()) < 90.0
    keys = {key.key: key for key in report.keys}
    assert {keys[key].verdict for key in TRUE} == {"identified"}
    assert (keys[unmoved].estimate, keys[unmoved].verdict) == (keys[unmoved].before, "not_excited")
    bounds = declared_bounds(type(found.base), unmoved)
    assert (keys[unmoved].low_95, keys[unmoved].high_95) == bounds
    assert found.keys == (*TRUE, unmoved)

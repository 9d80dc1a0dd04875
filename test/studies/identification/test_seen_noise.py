# SPDX-License-Identifier: Apache-2.0
"""The noise of a sensor is told from its samples, however fast the motion bends between them."""

from __future__ import annotations

import numpy as np
import pytest

from mech_twin.measurements.blocks import NO_DELAYS, Block
from mech_twin.measurements.quality import QualityGauge
from mech_twin.studies.identification.fit_runs import seen_noise

SIGMA = 8e-5


@pytest.mark.parametrize("rate_hz", [500.0, 1000.0, 4000.0])
def test_a_flight_of_constant_acceleration_adds_nothing_to_the_noise(rate_hz: float) -> None:
    """Second differences of it are 1 mm at 1 kHz, twelve times the noise."""
    times = np.arange(0.0, 1.0, 1.0 / rate_hz)
    flights = 500.0 * (times % 0.05) ** 2
    shown = flights + SIGMA * np.random.default_rng(1).standard_normal(len(times))
    assert seen_noise(times, shown) == pytest.approx(SIGMA, rel=0.25)


def test_a_swing_of_few_samples_adds_little_to_the_noise() -> None:
    times = np.arange(0.0, 4.0, 0.005)
    shown = 0.1 * np.sin(15.0 * times) + SIGMA * np.random.default_rng(2).standard_normal(len(times))
    assert seen_noise(times, shown) < 1.3 * SIGMA


@pytest.mark.parametrize(("jitter", "kept"), [(0.0, 1.0), (0.2, 1.0), (0.0, 0.9), (0.2, 0.7)])
def test_jitter_and_losses_of_a_turning_shaft_add_nothing_to_the_noise(jitter: float, kept: float) -> None:
    """A fifth of 2 ms at 33 rad/s is 13 mrad, thirteen times the noise; a sample less is 66 mrad."""
    random = np.random.default_rng(3)
    times = 0.002 * (np.arange(5000) + np.clip(jitter * random.standard_normal(5000), -0.45, 0.45))
    times = times[random.random(5000) < kept]
    shown = 33.0 * times + 1e-3 * random.standard_normal(len(times))
    assert seen_noise(times, shown) == pytest.approx(1e-3, rel=0.08)
    gauge = QualityGauge()
    for part in np.array_split(np.arange(len(times)), 7):
        gauge.add(Block(0, times[part], shown[part], NO_DELAYS))
    assert gauge.quality().noise == pytest.approx(1e-3, rel=0.05)

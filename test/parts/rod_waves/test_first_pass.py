# SPDX-License-Identifier: Apache-2.0
"""The share of the first wave: what is led tends to the closed form, whose greatest values are the known ones."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from mech_twin.parts.rod_waves.blow import (
    STRIKERS,
    share_of_mass,
    share_of_rectangle,
    simulated_share_of_mass,
    simulated_share_of_rectangle,
    simulated_share_of_steps,
)


@pytest.mark.parametrize("x", [0.1, 1.0, 10.0])
def test_what_is_led_is_the_closed_form(x):
    assert simulated_share_of_rectangle(x) == pytest.approx(share_of_rectangle(x), rel=1e-4)
    assert simulated_share_of_mass(x) == pytest.approx(share_of_mass(x), rel=1e-4)


def test_the_greatest_shares_are_those_of_the_literature():
    best = minimize_scalar(
        lambda x: -share_of_rectangle(x), bounds=(0.1, 5.0), method="bounded", options={"xatol": 1e-9}
    )
    assert best.x == pytest.approx(1.25643, abs=5e-6)
    assert -best.fun == pytest.approx(0.81453, abs=5e-6)
    assert share_of_mass(1.0) == pytest.approx(0.54134, abs=5e-6)
    assert share_of_mass(1.0 + 1e-7) == pytest.approx(share_of_mass(1.0), rel=1e-10)


def share_by_transform(steps, x, dt=5e-4, count=2**16):
    """Return the share of a stepped striker from its impedance under the Laplace transform, inverted numerically.

    A free striker is a source of the speed 1/s with the impedance Y of its sections, the tool a resistance of 1, the
    wall a spring k behind it: F = 2 p/(1 + s/k), p = (1/s) Y/(1 + Y).  No cell, no grid.
    """
    k = 0.5 * x
    a = 8.0 / (count * dt)
    s = a + 2j * np.pi * np.fft.fftfreq(count, dt)
    seen = np.zeros(count, dtype=complex)
    for part, z in steps:
        tanh = np.tanh(s * part)
        seen = z * (seen + z * tanh) / (z + seen * tanh)
    wall = 2.0 / s * seen / (1.0 + seen) / (1.0 + s / k)
    time = dt * np.arange(count)
    force = np.exp(a * time) * np.fft.ifft(wall).real / dt
    first = force[time < 12.0].max()
    return first**2 / (2.0 * k) / (0.5 * sum(part * z for part, z in steps))


@pytest.mark.parametrize("steps", [((1.0, 1.0),), *STRIKERS.values()], ids=["uniform", *STRIKERS])
@pytest.mark.parametrize("x", [0.3, 1.25643, 4.0])
def test_a_striker_gives_what_its_transform_gives(steps, x):
    expected = share_by_transform(steps, x)
    assert simulated_share_of_steps(steps, x) == pytest.approx(expected, rel=2e-4)
    if steps == ((1.0, 1.0),):
        assert expected == pytest.approx(share_of_rectangle(x), rel=2e-4)

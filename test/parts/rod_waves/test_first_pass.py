# SPDX-License-Identifier: Apache-2.0
"""The share of the first wave: what is led tends to the closed form, whose greatest values are the known ones."""

import pytest
from scipy.optimize import minimize_scalar

from mech_twin.parts.rod_waves.first_pass import (
    led_share_of_mass,
    led_share_of_rectangle,
    share_of_mass,
    share_of_rectangle,
)


@pytest.mark.parametrize("x", [0.1, 1.0, 10.0])
def test_what_is_led_is_the_closed_form(x):
    assert led_share_of_rectangle(x) == pytest.approx(share_of_rectangle(x), rel=1e-4)
    assert led_share_of_mass(x) == pytest.approx(share_of_mass(x), rel=1e-4)


def test_the_greatest_shares_are_those_of_the_literature():
    best = minimize_scalar(
        lambda x: -share_of_rectangle(x), bounds=(0.1, 5.0), method="bounded", options={"xatol": 1e-9}
    )
    assert best.x == pytest.approx(1.25643, abs=5e-6)
    assert -best.fun == pytest.approx(0.81453, abs=5e-6)
    assert share_of_mass(1.0) == pytest.approx(0.54134, abs=5e-6)
    assert share_of_mass(1.0 + 1e-7) == pytest.approx(share_of_mass(1.0), rel=1e-10)

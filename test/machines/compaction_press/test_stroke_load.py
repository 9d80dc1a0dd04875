# SPDX-License-Identifier: Apache-2.0
"""Force of the layer: its law, its work as the force's integral, and what it is at the ends."""

import numpy as np
import pytest
from scipy.integrate import quad

from mech_twin.machines.compaction_press.dynamics import StrokeLoad, layer_force, layer_work


def drawn(random, exponent):
    bottom = float(random.uniform(-1.0, 1.0))
    return StrokeLoad(float(random.uniform(1.0, 1e5)), bottom + float(random.uniform(1e-3, 0.3)), bottom, exponent)


@pytest.mark.parametrize("exponent", [0.0, 0.3, 1.0, 1.7, 5.0])
def test_work_is_the_integral_of_the_force_over_depth(exponent):
    random = np.random.default_rng(int(10.0 * exponent))
    for _ in range(20):
        load = drawn(random, exponent)
        y = float(random.uniform(load.bottom_y_m, load.contact_y_m))
        work, _ = quad(lambda at, load=load: layer_force(load, at), y, load.contact_y_m, epsabs=0.0, epsrel=1e-10)
        assert layer_work(load, y) == pytest.approx(work, rel=1e-7)


@pytest.mark.parametrize("exponent", [0.0, 0.3, 1.0, 5.0])
def test_the_force_is_the_peak_at_the_bottom_and_grows_with_depth(exponent):
    load = drawn(np.random.default_rng(4), exponent)
    assert layer_force(load, load.bottom_y_m) == pytest.approx(load.peak_n, rel=1e-15)
    forces = [layer_force(load, y) for y in np.linspace(load.contact_y_m, load.bottom_y_m, 50)]
    assert (np.diff(forces) >= 0.0).all()


def test_a_layer_half_pressed_resists_by_its_exponent():
    for exponent in (0.5, 1.0, 2.0):
        assert layer_force(StrokeLoad(800.0, 0.3, 0.1, exponent), 0.2) == pytest.approx(800.0 * 0.5**exponent)


def test_above_first_contact_there_is_no_work_and_no_force_but_of_a_layer_without_slope():
    load = StrokeLoad(1e4, 0.2, 0.1, 1.0)
    for y in (0.2, 0.25, 3.0):
        assert layer_work(load, y) == 0.0
        assert layer_force(load, y) == 0.0
    # exponent 0 has the whole peak at first contact; whether it is in contact is the regime's to say
    assert layer_force(load._replace(exponent=0.0), 0.2) == 1e4


def test_the_whole_work_is_peak_times_depth_over_exponent_plus_one():
    for exponent in (0.0, 1.0, 3.0):
        assert layer_work(StrokeLoad(6e3, 0.25, 0.05, exponent), 0.05) == pytest.approx(6e3 * 0.2 / (exponent + 1.0))

# SPDX-License-Identifier: Apache-2.0
"""A flywheel keeps the speed between its bounds and touches both; the simpler formulas are its limits."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.parts.flywheel import (
    exact_inertia,
    mertsalov_inertia,
    non_uniformity,
    start_speed,
    textbook_inertia,
    wittenbauer,
)

TURN = np.linspace(0.0, 2.0 * math.pi, 721)
deltas = st.floats(0.001, 0.5)
speeds = st.floats(1.0, 100.0)
phases = st.floats(0.0, 2.0 * math.pi)


def machine(swing, phase):
    """Work and reduced inertia over a turn: the work swings enough that every flywheel here is above zero.

    It is counted from anywhere: only its differences matter.
    """
    inertia = 2.0 + swing * np.cos(2.0 * TURN + phase)
    return 700.0 + 2e4 * np.sin(TURN + phase) + 3e3 * np.sin(3.0 * TURN), inertia


def speeds_of_a_run(work, inertia, flywheel, first):
    """Kinetic energy changes by the work: speed at each position."""
    energy = 0.5 * (flywheel + inertia[0]) * first * first + work - work[0]
    return np.sqrt(2.0 * energy / (flywheel + inertia))


@settings(deadline=None)
@given(st.floats(0.0, 1.9), phases, deltas, speeds)
def test_a_run_with_the_flywheel_touches_both_bounds_and_leaves_neither(swing, phase, delta, mean):
    work, inertia = machine(swing, phase)
    flywheel = exact_inertia(work, inertia, delta, mean)
    run = speeds_of_a_run(work, inertia, flywheel, start_speed(work, inertia, delta, mean, flywheel))
    assert run.max() == pytest.approx(mean * (1.0 + 0.5 * delta), rel=1e-9)
    assert run.min() == pytest.approx(mean * (1.0 - 0.5 * delta), rel=1e-9)


@settings(deadline=None)
@given(st.floats(0.0, 1.9), phases, deltas, speeds)
def test_the_tangents_touch_the_diagram_and_hold_it_between_them(swing, phase, delta, mean):
    work, inertia = machine(swing, phase)
    found = wittenbauer(work, inertia, delta, mean)
    steep, flat = 0.5 * (mean * (1.0 + 0.5 * delta)) ** 2, 0.5 * (mean * (1.0 - 0.5 * delta)) ** 2
    slack = 1e-9 * (3e4 + 4.0 * steep)
    assert np.all(work <= found.upper_j + steep * inertia + slack)
    assert np.all(work >= found.lower_j + flat * inertia - slack)
    above, below = found.upper_position, found.lower_position
    assert work[above] == pytest.approx(found.upper_j + steep * inertia[above], abs=slack)
    assert work[below] == pytest.approx(found.lower_j + flat * inertia[below], abs=slack)


@settings(deadline=None)
@given(st.floats(0.0, 1.9), phases, deltas, speeds)
def test_the_textbook_s_flywheel_is_exact_for_squared_speeds_as_far_from_the_mean_square(swing, phase, delta, mean):
    """Bounds w_m^2 (1 +- delta) of the square are a mean and a non-uniformity of their own."""
    work, inertia = machine(swing, phase)
    fast, slow = mean * math.sqrt(1.0 + delta), mean * math.sqrt(1.0 - delta)
    middle = 0.5 * (fast + slow)
    exact = exact_inertia(work, inertia, (fast - slow) / middle, middle)
    assert textbook_inertia(work, inertia, delta, mean) == pytest.approx(exact, rel=1e-8, abs=1e-8)


@settings(deadline=None)
@given(st.floats(0.0, 1.9), phases, speeds)
def test_mertsalov_s_flywheel_is_the_limit_of_a_small_non_uniformity(swing, phase, mean):
    work, inertia = machine(swing, phase)
    simple, exact = (rule(work, inertia, 1e-6, mean) for rule in (mertsalov_inertia, exact_inertia))
    assert abs(simple - exact) <= 1.01 * inertia.max() + 1e-9 * simple
    assert simple >= exact


@settings(deadline=None)
@given(deltas, speeds)
def test_with_constant_inertia_all_of_it_counts_as_flywheel(delta, mean):
    work, inertia = 5e4 * np.sin(TURN), np.full_like(TURN, 3.0)
    whole = 1e5 / (delta * mean * mean)
    assert exact_inertia(work, inertia, delta, mean) == pytest.approx(whole - 3.0, rel=1e-9)
    assert textbook_inertia(work, inertia, delta, mean) == pytest.approx(whole - 3.0, rel=1e-9)
    assert mertsalov_inertia(work, inertia, delta, mean) == pytest.approx(whole, rel=1e-9)


@settings(deadline=None)
@given(st.floats(0.0, 1.9), phases, st.floats(0.001, 1.9), speeds)
def test_non_uniformity_is_the_inverse_of_the_flywheel(swing, phase, delta, mean):
    work, inertia = machine(swing, phase)
    flywheel = exact_inertia(work, inertia, delta, mean)
    assert non_uniformity(work, inertia, mean, flywheel) == pytest.approx(delta, rel=1e-8)


def test_without_a_flywheel_the_machine_s_own_inertia_gives_its_non_uniformity_or_it_stops():
    inertia = np.full_like(TURN, 3.0)
    assert non_uniformity(np.sin(TURN), inertia, 10.0) == pytest.approx(2.0 / 300.0, rel=1e-9)
    assert non_uniformity(1e5 * np.sin(TURN), inertia, 10.0) == 2.0
    assert non_uniformity(0.0 * TURN, inertia, 10.0, 1.0) <= 1e-9

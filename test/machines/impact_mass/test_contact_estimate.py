# SPDX-License-Identifier: Apache-2.0
"""Peak force, contact time and loss of a compliant contact, against its own equation of motion integrated anew."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mech_twin.engine.run import frames
from mech_twin.machines.impact_mass.forces import contact_estimate, merging_speed
from mech_twin.parameters.load import machine, machine_parameters


def integrated(m, v, r, k, p):
    """Return peak force, contact time, penetration, speed at leaving and loss of the hysteretic contact, by DOP853."""
    scale = math.sqrt(m / k)
    options = {"rtol": 1e-12, "atol": 1e-14 * v * scale, "method": "DOP853"}

    def turning(_, y):
        return y[1]

    turning.terminal, turning.direction = True, -1.0
    load = solve_ivp(
        lambda _, y: (y[1], (p - k * y[0]) / m),
        (0.0, 4.0 * scale),
        (0.0, v),
        events=turning,
        max_step=0.2 * scale,
        **options,
    )
    deepest, loading = load.y[0, -1], load.t[-1]
    stays = (1.0 - r * r) * deepest

    def leaving(_, y):
        return y[0] - stays

    leaving.terminal, leaving.direction = True, -1.0
    back = solve_ivp(
        lambda _, y: (y[1], (p - k / r**2 * (y[0] - stays)) / m),
        (0.0, 4.0 * scale * r),
        (deepest, 0.0),
        events=leaving,
        max_step=min(0.2 * scale * r, r * v * m / abs(p)),
        **options,
    )
    speed = -back.y[1, -1]
    loss = 0.5 * m * (v * v - speed * speed) + p * stays
    return k * deepest, loading + back.t[-1], deepest, speed, loss


RANDOM = np.random.default_rng(4)
CASES = [
    (
        10.0 ** RANDOM.uniform(-1, 3),
        10.0 ** RANDOM.uniform(-1, 1.5),
        RANDOM.uniform(0.05, 0.95),
        10.0 ** RANDOM.uniform(5, 9),
        RANDOM.uniform(-1, 1) * 10.0 ** RANDOM.uniform(0, 5),
    )
    for _ in range(24)
]


@pytest.mark.parametrize(("m", "v", "r", "k", "p"), [*CASES, (1, 13, 0.3, 1e7, 1e3), (1, 0.01, 0.3, 1e6, 500)])
def test_the_closed_form_is_the_integrated_contact_and_leaves_with_r_times_the_speed(m, v, r, k, p):
    peak, time_s, depth, speed, loss = integrated(m, v, r, k, p)
    found = contact_estimate(m, v, r, k, p)
    assert found.peak_force_n == pytest.approx(peak, rel=1e-8)
    assert found.contact_time_s == pytest.approx(time_s, rel=1e-7)
    assert found.penetration_m == pytest.approx(depth, rel=1e-8)
    assert found.loss_j == pytest.approx(loss, rel=1e-7, abs=1e-7 * m * v * v)
    assert speed == pytest.approx(r * v, rel=1e-7)


def test_a_stiff_stop_has_the_peak_and_time_of_a_free_impact():
    found = contact_estimate(2.0, 5.0, 0.5, 1e12, 300.0)
    assert found.peak_force_n == pytest.approx(5.0 * math.sqrt(2e12), rel=1e-3)
    assert found.contact_time_s == pytest.approx(0.5 * math.pi * 1.5 * math.sqrt(2e-12), rel=1e-3)
    assert found.loss_j == pytest.approx(0.5 * 2.0 * 25.0 * 0.75, rel=1e-3)


def test_at_the_merging_speed_flight_and_contact_last_as_long():
    for mass in (0.4, 1.0, 2.5):
        v = merging_speed(mass, 0.3, 1e8, 1000.0)
        flight = 2.0 * 0.3 * v / (1000.0 / mass)
        assert flight == pytest.approx(contact_estimate(mass, v, 0.3, 1e8, 0.0).contact_time_s, rel=1e-12)
    for force in (0.0, -500.0):
        assert merging_speed(1.0, 0.3, 1e8, force) == 0.0


def test_a_run_shows_peak_force_time_and_loss_of_its_impacts_and_moves_as_before():
    soft = list(frames(machine("impact_mass", overrides={"contact_stiffness_n_per_m": 1e8}), 0.3))
    rigid = list(frames(machine("impact_mass"), 0.3))
    assert [f.linkage.position for f in soft] == [f.linkage.position for f in rigid]
    seen = 0
    for frame in soft:
        blows = [e for e in frame.linkage.events if e.kind == "impact"]
        shown = frame.forces.quantities
        if not blows:
            assert shown["peak_contact_force_n"] == 0.0
            continue
        seen += 1
        hardest = max(blows, key=lambda e: e.pre_velocity_m_per_s)
        force = 1000.0 if hardest.time_s - hardest.period * 0.05 <= 0.035 else -500.0
        expected = contact_estimate(1.0, hardest.pre_velocity_m_per_s, 0.3, 1e8, force)
        assert shown["peak_contact_force_n"] == expected.peak_force_n
        assert shown["contact_time_s"] == expected.contact_time_s
        assert shown["contact_loss_j"] == expected.loss_j
    assert seen > 5
    assert all(f.forces.quantities["peak_contact_force_n"] == 0.0 for f in rigid)


def test_the_report_gives_the_contact_of_a_cycle_and_nothing_for_a_rigid_stop():
    changes = {"period_s": 0.2166, "phase1_duration_s": 0.05, "phase1_force_n": 606.0, "phase2_force_n": -26.0}
    report = machine("impact_mass", overrides={**changes, "contact_stiffness_n_per_m": 1e8}).report()
    speed = report["one_impact_phase2_speed_m_per_s"]
    found = contact_estimate(1.0, speed, 0.3, 1e8, -26.0)
    assert report["one_impact_phase2_peak_force_n"] == found.peak_force_n
    assert report["one_impact_phase2_contact_time_s"] == found.contact_time_s
    assert report["one_impact_phase2_contact_loss_j"] == found.loss_j
    assert "one_impact_phase2_peak_force_n" not in machine("impact_mass", overrides=changes).report()
    assert machine_parameters("impact_mass").contact_stiffness_n_per_m is None

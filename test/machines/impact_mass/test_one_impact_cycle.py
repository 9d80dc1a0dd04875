# SPDX-License-Identifier: Apache-2.0
"""Laws of the one-impact cycle: closure, closed form, multipliers and limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.machines.impact_mass.dynamics import IMPACT, impact_system, initial_motion, next_event
from mech_twin.machines.impact_mass.one_impact_cycle import (
    CycleSpec,
    least_stability_number,
    multipliers,
    one_impact_cycle,
    phase1_chatter_share,
    synthesised_cycle,
)


@given(st.floats(0.1, 10.0), st.floats(0.01, 2.0), st.floats(-0.9, 0.9), st.floats(0.5, 50.0), st.floats(0.05, 0.95))
def test_a_synthesised_cycle_closes(m, d, share, v, r):
    v0 = share * r * v
    c = synthesised_cycle(CycleSpec(m, 0.0, -d, v0, v, r))
    t1, t2 = c.phase1_duration_s, c.period_s - c.phase1_duration_s
    a1, a2 = c.phase1_force_n / m, c.phase2_force_n / m
    assert v0 + a1 * t1 == pytest.approx(v, rel=1e-12)
    assert v0 * t1 + 0.5 * a1 * t1 * t1 == pytest.approx(d, rel=1e-12)
    recoil_scale = max(1.0, c.period_s / t2)  # t2 is formed from T and t1 here
    assert abs(-r * v + a2 * t2 - v0) <= 1e-12 * v * recoil_scale
    assert abs(-r * v * t2 + 0.5 * a2 * t2 * t2 + d) <= 1e-12 * d * recoil_scale
    cycle = one_impact_cycle(impact_system((c.period_s, t1), (a1, a2), r, 0.0), 1)
    assert cycle is not None
    assert cycle.impact_speed_m_per_s == pytest.approx(v, rel=1e-11)


@given(st.floats(0.05, 0.95), st.floats(1.0, 50.0))
def test_the_synthesis_from_rest_lands_on_the_border(r, v):
    c = synthesised_cycle(CycleSpec(1.0, 0.0, -0.5, 0.0, v, r))
    assert c.phase2_force_n == pytest.approx(r * r * c.phase1_force_n, rel=1e-12)
    forces = c.phase1_force_n, c.phase2_force_n
    cycle = one_impact_cycle(impact_system((c.period_s, c.phase1_duration_s), forces, r, 0.0), 1)
    assert cycle is not None
    assert abs(cycle.position_share) < 1e-9


@pytest.mark.parametrize(
    ("changes", "inequality"),
    [
        ({"restitution": 1.0}, "0 < restitution < 1"),
        ({"initial_velocity_m_per_s": 6.0}, r"initial_velocity_m_per_s < restitution \* impact_speed"),
        ({"initial_velocity_m_per_s": -20.0}, "initial_velocity_m_per_s > -impact_speed"),
        ({"initial_position_m": 0.1}, "initial_position_m < stop_position_m"),
        ({"impact_speed_m_per_s": 0.0}, "impact_speed_m_per_s > 0"),
        ({"mass_kg": 0.0}, "mass_kg > 0"),
    ],
)
def test_a_synthesis_without_solution_names_its_inequality(changes, inequality):
    spec = {
        "mass_kg": 1.0,
        "stop_position_m": 0.0,
        "initial_position_m": -0.5,
        "initial_velocity_m_per_s": 0.0,
        "impact_speed_m_per_s": 20.0,
        "restitution": 0.3,
    }
    with pytest.raises(ValueError, match=inequality):
        synthesised_cycle(CycleSpec(**(spec | changes)))


@given(st.floats(0.05, 0.95), st.floats(-1.5, 1.5))
def test_the_multipliers_are_stable_exactly_within_the_limits(r, q):
    pair = multipliers(q, r)
    assert abs(pair[0] * pair[1]) == pytest.approx(r * r, rel=1e-12)
    assert (pair[0] + pair[1]).real == pytest.approx((1 + r) ** 2 * q - 2 * r, abs=1e-12)
    low = least_stability_number(r)
    if min(abs(q - low), abs(q - 1.0)) > 1e-9:
        assert (abs(pair[0]) < 1.0) == (low < q < 1.0)


def start_after(period_s, t1, a1, a2, r, gap, velocity):
    system = impact_system((period_s, t1), (a1, a2), r, 0.0)
    motion = initial_motion(gap, velocity, system)
    while motion.period < 1.0:
        _, motion = next_event(motion, system)
    return np.array([motion.gap_m, motion.velocity_m_per_s])


@pytest.mark.parametrize("p2", [-20.0, 30.0, -5.0])
def test_the_multipliers_are_those_of_the_period_map(p2):
    period, t1, r = 0.05 + 1 / 6, 0.05, 0.3
    a1 = (26.0 - p2 * (period - t1)) / t1
    cycle = one_impact_cycle(impact_system((period, t1), (a1, p2), r, 0.0), 1)
    assert cycle is not None
    at = np.array([cycle.start_gap_m, cycle.start_velocity_m_per_s])
    fixed = start_after(period, t1, a1, p2, r, *at)
    assert fixed == pytest.approx(at, rel=1e-12)
    columns = []
    for i, h in enumerate((1e-6, 1e-5)):
        step = np.eye(2)[i] * h
        ahead, behind = (start_after(period, t1, a1, p2, r, *(at + sign * step)) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * h))
    measured = np.linalg.eigvals(np.array(columns).T)
    order = lambda z: (round(abs(z), 6), z.imag)  # noqa: E731
    assert sorted(measured, key=order) == pytest.approx(sorted(cycle.multipliers, key=order), abs=1e-6)


@given(st.floats(0.1, 0.9), st.floats(-0.99, 0.99), st.floats(0.05, 0.95))
def test_a_phase_2_motion_exists_where_the_page_says(r, ratio, s):
    a1, a2 = 1.0, ratio
    cycle = one_impact_cycle(impact_system((1.0, s), (a1, a2), r, 0.0), 1)
    if s * a1 + (1 - s) * a2 <= 1e-6:
        return
    assert cycle is not None
    rho = r / (1 + r)
    square = rho * rho - a2 * (1 - 2 * rho) / (a1 - a2)
    inside = square >= 0 and abs(s - rho) <= math.sqrt(square)
    border = square < 1e-9 or abs(abs(s - rho) - math.sqrt(square)) < 1e-9
    if not border:
        assert (cycle.position_share >= 0.0) == inside
        assert cycle.position_share <= 1.0  # or the blow would come after the next phase 1 has begun
    if inside and not border:
        assert a2 <= r * r * a1


def test_phase_1_chatter_completes_from_the_stated_duration():
    share = phase1_chatter_share(impact_system((0.05, 0.035), (1000.0, -500.0), 0.3, 0.0))
    for factor, complete in ((1.001, True), (0.97, False)):
        t1 = 0.05 * share * factor / (1 + share * factor)
        system = impact_system((0.05, t1), (1000.0, -500.0), 0.3, 0.0)
        motion = initial_motion(0.0, 0.0, system)
        completed = []
        for _ in range(30):
            ends, number = 0, motion.period
            while motion.period == number:
                event, motion = next_event(motion, system)
                ends += event.kind == IMPACT + 1.0
            completed.append(ends)
        assert all(completed[1:]) == complete
    assert phase1_chatter_share(impact_system((0.05, 0.035), (1.0, 1.0), 0.3, 0.0)) == math.inf

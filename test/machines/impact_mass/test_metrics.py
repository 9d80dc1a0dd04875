# SPDX-License-Identifier: Apache-2.0
"""Running metrics: energy over live changes, the steady impact speed, counts; and what the residuals notice."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from mech_twin.capabilities.variation import varied
from mech_twin.engine.compiled_roles import NO_NUMBERS
from mech_twin.engine.compiled_steps import work_for
from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.engine.run import frames
from mech_twin.engine.sample_vectors import EVENT_WIDTH, row_of
from mech_twin.machines.impact_mass import PARAMETERS, build
from mech_twin.machines.impact_mass.observer import CompensatedSum
from mech_twin.machines.impact_mass.roles import RESIDUAL_LIMITS
from mech_twin.machines.impact_mass.step import BalanceResiduals, StepBalance, mass_on_stop, residuals
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.roles import RESIDUALS


def first_step(parameters):
    """Return sums, errors of the balances and speed (m/s) of the step of 0.049 s from rest, 0.5 m before the stop."""
    twin = build(varied(parameters, {"coupling.step_s": 0.049}))
    start, model = twin.linkage.start(), twin.linkage.model
    row, motor, work = row_of(start), row_of(twin.motor.respond(start, 1.0)), work_for(model)
    out = np.empty_like(row)
    mass_on_stop(model, 0, row, motor, NO_NUMBERS, out, np.empty((4, EVENT_WIDTH)), work)
    done = twin.linkage.layout.sample(1, 0.049, out.tolist(), ())
    return StepBalance(*work.numbers), done.residuals.values, done.velocity[0]


def run_with_changes(changes_at):
    """Return the frames of a second of the default machine whose parameters change at these steps."""
    parameters = machine_parameters("impact_mass")
    twin = build(parameters)
    frame = complete_frame(twin, twin.linkage.start(), None, 1.0)
    run = [frame]
    for step in range(1000):
        if step in changes_at:
            parameters = PARAMETERS.model_validate({**parameters.model_dump(), **changes_at[step]})
            twin = build(parameters)
            frame = complete_frame(twin, frame.linkage, None, 1.0)
            run[-1] = frame
        frame = next_frame(twin, frame, 1.0)
        run.append(frame)
    return run


CHANGES = {
    150: {"mass_kg": 3.0},
    333: {"mass_kg": 0.5, "restitution": 0.6},
    501: {"phase1_force_n": 700.0, "phase2_force_n": -450.0},
    777: {"mass_kg": 1.7, "restitution": 0.2, "phase2_force_n": -300.0},
}


def test_the_energy_of_a_run_closes_over_live_changes_only_with_their_work():
    run = run_with_changes(CHANGES)
    observer = machine("impact_mass").observer()
    for frame in run:
        observer.observe(frame)
    numbers = observer.numbers()
    assert abs(numbers["energy_unbalanced_j"]) < 1e-9 * numbers["drive_work_j"]
    expected = sum(
        0.5 * (after - before) * run[step].linkage.velocity[0] ** 2
        for step, before, after in ((150, 1.0, 3.0), (333, 3.0, 0.5), (777, 0.5, 1.7))
    )
    assert abs(expected) > 1.0
    assert numbers["change_work_j"] == pytest.approx(expected, rel=1e-12)


def test_the_work_of_the_force_is_that_of_force_and_path_of_the_samples():
    """Phases change at multiples of the step here, so the force is constant in each step."""
    run = list(frames(machine("impact_mass", overrides={"coupling.step_s": 0.0005}), 0.5))
    work = 0.0
    for step, (before, after) in enumerate(pairwise(run)):
        force = 1000.0 if step % 100 < 70 else -500.0
        work += force * (after.linkage.position[0] - before.linkage.position[0])
    booked = sum(frame.forces.quantities["drive_work_j"] for frame in run)
    assert booked == pytest.approx(work, rel=1e-9)


def test_momentum_over_a_change_of_mass_closes_with_what_the_change_brought():
    run = run_with_changes(CHANGES)
    given = sum(f.forces.quantities["change_momentum_ns"] - f.forces.quantities["stop_impulse_ns"] for f in run)
    drive = impulse_of_force(0.0, 0.501, 1000.0, -500.0)
    drive += impulse_of_force(0.501, 0.777, 700.0, -450.0) + impulse_of_force(0.777, 1.0, 700.0, -300.0)
    momentum = 1.7 * run[-1].linkage.velocity[0]
    assert momentum == pytest.approx(drive + given, rel=1e-9)


def test_the_impulse_of_a_period_in_which_the_mass_changes_is_that_of_its_steps():
    run = run_with_changes({520: {"mass_kg": 3.0}})
    steps = sum(f.forces.quantities["stop_impulse_ns"] for f in run[501:551])
    assert run[551].forces.quantities["last_period_impulse_ns"] == pytest.approx(steps, rel=1e-9)


def impulse_of_force(begin_s, end_s, p1, p2):
    """Return the impulse of the two-level force between two times, N s."""

    def upto(t):
        periods, tau = divmod(t, 0.05)
        return periods * (p1 * 0.035 + p2 * 0.015) + p1 * min(tau, 0.035) + p2 * max(tau - 0.035, 0.0)

    return upto(end_s) - upto(begin_s)


def test_the_steady_impact_speed_leaves_out_start_and_small_impacts():
    observer = machine("impact_mass").observer()
    for frame in frames(machine("impact_mass"), 1.5):
        observer.observe(frame)
    numbers = observer.numbers()
    assert numbers["steady_impact_speed_m_per_s"] == pytest.approx(12.990381, abs=5e-7)
    assert numbers["steady_impact_speed_spread_m_per_s"] == 0.0
    assert numbers["steady_impact_periods"] == 20.0
    assert numbers["mean_blow_m_per_s"] < 1.0


def test_a_motion_of_several_periods_shows_the_spread_of_its_impacts():
    twin = machine("impact_mass", overrides={"phase1_duration_s": 0.03})
    observer = twin.observer()
    for frame in frames(twin, 3.0):
        observer.observe(frame)
    assert observer.numbers()["steady_impact_speed_spread_m_per_s"] > 1.0


def test_summed_impacts_are_counted_one_by_one():
    changes = {"restitution": 0.99999, "initial_position_m": -1e-12, "phase2_force_n": 50.0}
    twin = machine("impact_mass", overrides=changes)
    observer = twin.observer()
    for frame in frames(twin, 0.1):
        observer.observe(frame)
    numbers = observer.numbers()
    assert numbers["impacts"] == pytest.approx(math.log(1e-12) / math.log(0.99999), rel=1e-3)
    assert 0.0 < numbers["mean_blow_m_per_s"] < 1e-3


def test_a_sum_with_compensation_keeps_what_a_plain_sum_loses():
    kept, plain = CompensatedSum(), 0.0
    for term in (1e16, *(1.0,) * 1000, -1e16):
        kept.add(term)
        plain += term
    assert kept.value == 1000.0
    assert plain != 1000.0


def test_the_residuals_are_those_of_the_dictionary_and_each_has_a_limit():
    assert set(BalanceResiduals._fields) == set(RESIDUAL_LIMITS) <= set(RESIDUALS)


@pytest.mark.parametrize(
    ("lost", "broken"),
    [
        ({"stop_impulse_m_per_s": 0.999}, "momentum_balance"),
        ({"drive_impulse_m_per_s": 1.001}, "momentum_balance"),
        ({"stop_loss_m2_per_s2": 0.999}, "energy_balance"),
        ({"drive_work_m2_per_s2": 1.001}, "energy_balance"),
    ],
)
def test_a_balance_that_misses_a_thousandth_breaks_its_limit(lost, broken):
    parameters = machine_parameters("impact_mass")
    balance, errors, speed = first_step(parameters)
    assert all(abs(value) < 1e-12 for value in errors)
    for name, factor in lost.items():
        wrong = balance._replace(**{name: getattr(balance, name) * factor})
        found = residuals(wrong, 0.0, speed)._asdict()
        assert abs(found[broken]) > RESIDUAL_LIMITS[broken]


def test_a_walk_with_the_wrong_restitution_would_break_the_momentum_balance():
    """The speed after an impact enters the walk and the balance on different ways: the sample shows a mismatch."""
    parameters = machine_parameters("impact_mass")
    balance, _, speed = first_step(parameters)
    found = residuals(balance, 0.0, speed * 1.0001)
    assert abs(found.momentum_balance) > RESIDUAL_LIMITS["momentum_balance"]

# SPDX-License-Identifier: Apache-2.0
"""Running metrics: means from the work done, cycles cut where they belong, a run's numbers under a run's names."""

import math

import numpy as np
import pytest
from machines.mb10_breaker.pressed_body_cases import walked_cycle

from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker.dynamics import masses_at, striker
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.run_metrics import striker_energy
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.live_change import ChangingMachine, live_changes
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.samples import EffortCommand
from mech_twin.studies.simulation import RunMetrics, Simulation

HALF_SINE = {
    "excitation.kind": "approximated",
    "body.inertia_kg_m2": 0.35,
    "body.spring_rate_n_per_m": 3108.0,
    "body.preload_deflection_m": 0.0483,
}


def observed(duration_s, **overrides):
    twin = machine("mb10_breaker", overrides=overrides)
    observer, taken = twin.observer(), []
    for frame in frames(twin, duration_s):
        observer.observe(frame)
        taken.append(frame)
    return twin, taken, observer.numbers()


@pytest.fixture(scope="module")
def together():
    return observed(5.0)


@pytest.mark.slow
@pytest.mark.parametrize("preload_m", [0.0483, 0.0193, 0.0868])
def test_under_the_half_sine_the_body_is_cut_into_its_own_cycles(preload_m):
    """The observer sees steps and events; the chain of pieces, walked without a run, has the same cycle."""
    twin, _, found = observed(5.0, **HALF_SINE | {"body.preload_deflection_m": preload_m})
    p = twin.parameters
    expected = walked_cycle(pressed_body(p.body, p.excitation), 40)
    assert found["steady_body_cycle_rate_hz"] == pytest.approx(10.0, rel=1e-12)
    assert found["steady_gap_at_blow_m"] == pytest.approx(expected.gap_at_blow_m, rel=1e-9)
    assert found["steady_contact_share"] == pytest.approx(expected.rested_s * 10.0, rel=1e-6)
    assert found["steady_largest_return_speed_m_per_s"] == pytest.approx(expected.return_speed_m_per_s, rel=1e-9)
    assert found["steady_settled_at_fraction"] == pytest.approx(expected.settled_s * 10.0, rel=1e-6)
    force_n = p.body.spring_rate_n_per_m * (0.2 * expected.top_rad + p.body.preload_deflection_m)
    assert found["steady_largest_spring_force_n"] == pytest.approx(force_n, rel=1e-4)


def test_the_reported_case_has_its_gap_and_contact():
    _, _, found = observed(5.0, **HALF_SINE)
    assert found["steady_gap_at_blow_m"] == pytest.approx(0.456e-3, abs=0.5e-6)
    assert found["steady_contact_share"] == pytest.approx(0.709, abs=5e-4)
    assert found["steady_blow_rate_hz"] == pytest.approx(10.44, abs=0.005)  # the linkage's own


def test_without_a_collar_there_is_no_contact():
    _, _, found = observed(2.0, **HALF_SINE | {"body.contact": "none"})
    assert found["steady_contact_share"] == 0.0


@pytest.mark.slow
def test_mean_power_is_what_the_blows_and_the_losses_take(together):
    """Over a cycle that repeats the motor's work is that of wall, blow and collar, and of the gear."""
    _, taken, found = together
    blows = [f.linkage for f in taken if any(e.kind == "blow" for e in f.linkage.events)]
    names = ("blow_loss_j", "wall_work_j", "reseating_loss_j", "collar_loss_j")
    first, last = (sum(sample.memory.as_dict()[name] for name in names) for sample in (blows[-21], blows[-1]))
    at_crank = (last - first) / 20.0 * found["steady_blow_rate_hz"]
    assert at_crank < 0.97 * found["steady_motor_power_w"] * 1.001
    assert found["steady_motor_power_w"] == pytest.approx(at_crank / 0.97, rel=0.02)


@pytest.mark.slow
def test_figures_of_a_blow_are_of_the_blows_that_hit_and_their_rate_counts_no_miss():
    twin, taken, found = observed(6.0, **{"body.preload_deflection_m": 0.002, "tool.wall_force_n": 0.0})
    events = [event for frame in taken for event in frame.linkage.events if event.kind in {"blow", "missed"}]
    passes = events[-20:]
    blows = [event for event in passes if event.kind == "blow"]
    assert len(blows) < len(passes)
    assert found["steady_blows"] == len(blows)
    span_s = passes[-1].time_s - events[-21].time_s
    assert found["steady_blow_rate_hz"] == pytest.approx(len(blows) / span_s, rel=1e-12)
    energies = [event.impulse_ns**2 / (2.0 * twin.parameters.tool.mass_kg) for event in blows]
    assert found["steady_blow_energy_j"] == pytest.approx(sum(energies) / len(blows), rel=1e-12)
    gaps = [twin.parameters.body.tool_radius_m * event.pre[1].position for event in blows]
    assert found["steady_gap_at_blow_m"] == pytest.approx(sum(gaps) / len(blows), rel=1e-12)
    assert found["run_largest_gap_at_blow_m"] < twin.parameters.tool.overtravel_m


def test_means_do_not_depend_on_the_samples(together):
    """Integrals cut at the blows differ between steps by the scheme's error, not by how the samples fall."""
    _, _, fine = together
    _, _, coarse = observed(5.0, **{"coupling.step_s": 0.002})
    for name in ("motor_torque_nm", "motor_power_w"):
        assert coarse[f"steady_{name}"] == pytest.approx(fine[f"steady_{name}"], rel=2e-5)
    assert coarse["steady_motor_rms_torque_nm"] == pytest.approx(fine["steady_motor_rms_torque_nm"], rel=5e-3)


@pytest.mark.slow
def test_means_of_the_motor_do_not_depend_on_the_step_while_the_supply_rises():
    """Torque, power and heat are taken at the supply of each instant, not at that of the step's end."""
    ramp = {"supply.initial_fraction": 0.0, "supply.rate_per_s": 0.45}
    coarse, fine = (observed(2.0, **ramp | {"coupling.step_s": step_s})[2] for step_s in (0.002, 0.00025))
    for name in ("motor_torque_nm", "motor_power_w", "motor_rms_torque_nm", "motor_rotor_loss_w"):
        assert coarse[f"steady_{name}"] == pytest.approx(fine[f"steady_{name}"], rel=1e-5)


@pytest.mark.slow
def test_a_commanded_effort_is_the_mean_torque_and_heats_no_rotor():
    twin = machine("mb10_breaker")
    observer = twin.observer()
    for frame in frames(twin, 3.0, target=lambda step: 1.0 if step < 1000 else EffortCommand(effort=3.0)):
        observer.observe(frame)
    found = observer.numbers()
    assert found["steady_motor_torque_nm"] == pytest.approx(3.0, rel=1e-6)
    assert found["steady_motor_rms_torque_nm"] == pytest.approx(3.0, rel=1e-6)
    assert found["steady_motor_rotor_loss_w"] == 0.0


def test_effective_torque_and_heat_are_shares_of_the_rating(together):
    twin, _, found = together
    motor = twin.parameters.motor
    rated = motor.rated_power_w / (motor.rated_speed_rpm * math.pi / 30.0)
    rms = found["steady_motor_rms_torque_nm"]
    assert rms >= found["steady_motor_torque_nm"]
    assert found["steady_motor_rms_torque_over_rated"] == pytest.approx(rms / rated)
    # at small slip the Kloss torque is proportional to slip: heat goes as the square of the torque, at a fifth of the
    # slope of the rated point's chord
    share = (rms / rated) ** 2
    assert share * 0.9 < found["steady_motor_rotor_loss_over_rated"] < share * 1.1


def test_a_run_has_its_extremes_under_names_of_its_own(together):
    _, _, found = together
    assert found["run_largest_spring_force_n"] >= found["steady_largest_spring_force_n"]
    assert found["run_crank_bearing_between_blows_peak_n"] >= found["steady_crank_bearing_between_blows_peak_n"]
    assert not any(name.startswith(("largest_", "crank_", "rocker_")) for name in found)


def test_contact_of_finite_stiffness_is_given_only_where_a_stiffness_is(together):
    _, _, found = together
    assert not any("contact_peak" in name for name in found)
    _, _, stiff = observed(3.0, **{"tool.contact_stiffness_n_per_m": 2e8})
    assert stiff["steady_contact_peak_force_n"] == pytest.approx(53e3, abs=500.0)
    assert stiff["steady_contact_time_s"] == pytest.approx(0.5e-3, abs=0.5e-4)


def test_long_runs_hold_no_more_than_short_ones():
    twin = machine("mb10_breaker")
    observer = twin.observer()
    for frame in frames(twin, 4.0):
        observer.observe(frame)
    assert observer.numbers()["steady_blows"] == 20.0


def test_the_striker_brings_the_energy_of_the_mass_that_the_mechanism_has_at_the_tool():
    """The mass by the jump of a rigid blow is that of the mass matrix at the striker: w . M^-1 w = 1/m."""
    parameters = machine_parameters("mb10_breaker")
    b = breaker(parameters)
    blow = next(e for f in frames(machine("mb10_breaker"), 1.0) for e in f.linkage.events if e.kind == "blow")
    crank, body = blow.pre[:2]
    _, slope, _ = striker(b, crank.position)
    m = masses_at(b, crank.position, body.position)
    w, matrix = np.array([slope, -b.tool_radius_m]), np.array([[m.m11, m.m12], [m.m12, m.m22]])
    mass = 1.0 / (w @ np.linalg.solve(matrix, w))
    assert striker_energy(blow) == pytest.approx(0.5 * mass * blow.pre_velocity_m_per_s**2, rel=1e-9)


def test_a_bearing_s_peak_in_a_blow_is_far_above_that_between_blows():
    """Within a blow the bearing follows the contact: its peak is to its impulse as the contact's is to the blow's."""
    with_contact = machine("mb10_breaker", overrides={"tool.contact_stiffness_n_per_m": 2e8})
    observer = with_contact.observer()
    for frame in frames(with_contact, 3.0):
        observer.observe(frame)
    found = observer.numbers()
    ratio = found["steady_rocker_bearing_blow_peak_n"] / found["steady_rocker_bearing_impulse_peak_ns"]
    assert ratio == pytest.approx(found["steady_contact_peak_force_n"] / found["steady_blow_impulse_ns"], rel=0.02)
    assert found["steady_rocker_bearing_blow_peak_n"] > 50.0 * found["steady_rocker_bearing_between_blows_peak_n"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("body.spring_rate_n_per_m", 47970.0),
        ("body.preload_deflection_m", 0.0125),
        ("gear.efficiency", 0.87),
    ],
)
def test_after_a_live_change_the_last_cycles_are_those_of_a_machine_that_was_made_so(key, value):
    """Of the spring's force and the motor's power, which follow from live keys."""
    twin = machine("mb10_breaker")
    changing, observer = ChangingMachine(twin, live_changes([f"{key}={value}@0.5"])), twin.observer()
    for frame in frames(twin, 5.0, changing.command, changing.at):
        observer.observe(frame)
    found, (_, _, made) = observer.numbers(), observed(5.0, **{key: value})
    for name in ("steady_largest_spring_force_n", "steady_motor_power_w", "steady_motor_torque_nm"):
        assert found[name] == pytest.approx(made[name], rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("change", ["tool_mass=+15%", "supply_voltage=-5%", "rotor_resistance=+15%"])
def test_after_a_fault_or_another_operating_point_the_last_cycles_are_those_of_a_machine_that_was_made_so(change):
    twin = machine("mb10_breaker")
    changing = ChangingMachine(twin, live_changes([f"{change}@0.5"]))
    made = changing.revisions[-1][1]
    found, expected = Simulation(twin, changing.at), Simulation(made)
    for simulation, run in (
        (found, frames(twin, 5.0, changing.command, changing.at)),
        (expected, frames(made, 5.0)),
    ):
        for frame in run:
            simulation.observe(frame)
    for name in ("steady_blow_energy_j", "steady_motor_rms_torque_nm", "steady_motor_rotor_loss_w"):
        assert found.numbers()[name] == pytest.approx(expected.numbers()[name], rel=1e-4)


def test_a_run_that_is_watched_tells_the_numbers_of_one_that_is_simulated():
    twin = machine("mb10_breaker")
    changing = ChangingMachine(twin, live_changes(["tool_mass=+15%@0.5"]))
    watched, simulated = RunMetrics(lambda: twin, changing.at), Simulation(twin, changing.at)
    for frame in frames(twin, 1.0, changing.command, changing.at):
        watched.observe(frame)
        simulated.observe(frame)
    told, expected = watched.numbers(), simulated.numbers()
    assert told["blows"] > 0.0
    assert told == {name: expected[name] for name in told}

# SPDX-License-Identifier: Apache-2.0
"""Laws of the roller former's motion: order of coupling, convergence, energy, stall, holding at rest, live change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from draws.outcomes import run
from hypothesis import example, given, settings
from hypothesis import strategies as st
from roller_former_cases import joints_of, machine_for, parameters_for
from scipy.integrate import solve_ivp

from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.engine.run import frames
from mech_twin.machines.roller_former.cart_statics import load_moment, shaft_terms
from mech_twin.machines.roller_former.dynamics import Modes, start_modes, state_array
from mech_twin.machines.roller_former.metrics import former_metrics, turn_metrics
from mech_twin.machines.roller_former.parameters import former_of
from mech_twin.machines.roller_former.steady import start_motion, steady_turn, turned
from mech_twin.parts.induction_motor import motor_torque
from mech_twin.roles import Machine
from mech_twin.samples import Frame

CARTS = (1, 2, 3, 4)
AT_SPEED = {"start.speed_fraction": 1.0, "start.load_from_fraction": 0.0}
LOADED = {"start.load_from_fraction": 0.0}


def strongly_coupled(carts: int, duration_s: float, overrides: Mapping[str, Any]) -> np.ndarray:
    """Return the state after a run with motor and mechanism solved together, rated supply."""
    linkage = machine_for(carts, overrides).linkage
    start, former = linkage.start(), linkage.model.former
    y = state_array(joints_of(start.position).crank, joints_of(start.velocity).crank)
    modes = np.array(start.memory.values[: len(Modes._fields)])
    done, _ = turned(former, 1.0, 0.0, duration_s, 1, np.inf, y, modes)
    assert done.status >= 0
    return y


def last_frame(machine: Machine, duration_s: float, target: float = 1.0) -> Frame:
    *_, frame = frames(machine, duration_s, lambda step: target)
    return frame


def state_of(frame: Frame) -> np.ndarray:
    position, velocity = frame.linkage.position, frame.linkage.velocity
    return np.array([position[1], position[2], velocity[1], velocity[2]])


@pytest.mark.slow
@pytest.mark.parametrize("carts", CARTS)
def test_motion_does_not_depend_on_the_coupling_step(carts):
    """Steps of 10 and of 0.5 ms end where motor and mechanism do that are integrated without one."""
    tight = {"integrator.tolerance": 1e-12}
    exact = strongly_coupled(carts, 0.8, tight)[:4]
    for step in (0.01, 0.0005):
        found = state_of(last_frame(machine_for(carts, {**tight, "coupling.step_s": step}), 0.8))
        assert found == pytest.approx(exact, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("carts", CARTS)
def test_a_tolerance_ten_times_tighter_moves_no_answer_by_1e_8(carts):
    found = []
    for tolerance in (1e-9, 1e-10):
        former = former_of(parameters_for(carts, {"integrator.tolerance": tolerance}))
        turn = steady_turn(former)
        assert turn is not None
        found.append((turn_metrics(turn, former), strongly_coupled(carts, 3.0, {"integrator.tolerance": tolerance})))
    (metrics, state), (tight_metrics, tight_state) = found
    for name, value in metrics.items():
        if name != "steady_turns_taken":
            assert value == pytest.approx(tight_metrics[name], rel=1e-8), name
    assert state == pytest.approx(tight_state, rel=1e-8)


def test_a_heavy_shaft_comes_to_the_turn_that_it_would_take_thousands_of_turns_to_reach():
    """Its speed hardly swings, so that more inertia changes neither mean speed nor work; what comes in goes out."""
    turns = [steady_turn(former_of(parameters_for(3, {"carts.crank_inertia_kg_m2": j}))) for j in (1e5, 1e6)]
    heavy, heavier = turns
    assert heavy is not None
    assert heavier is not None
    assert heavier.mean_speed_rad_per_s == pytest.approx(heavy.mean_speed_rad_per_s, rel=1e-7)
    for turn in (heavy, heavier):
        works = turn.works
        out = works.load_work_j + works.damping_work_j + works.friction_work_j
        assert out == pytest.approx(works.motor_work_j, rel=1e-8)
        assert turn.change < 1.001e-11


@pytest.mark.parametrize("load", ["none", "reversing", "rectified", "resist", "printed"])
def test_the_motion_is_that_of_a_general_integrator(load):
    overrides = {**AT_SPEED, "load": load, "motor.torque_curve": "starting_corrected"}
    former = former_of(parameters_for(3, overrides))

    def slope(_: float, y: np.ndarray) -> list[float]:
        crank, twist, speed, rate = y
        inertia, half, _moment = shaft_terms(former.bank, crank, np.ones(3), 1.0)
        shaft = motor_torque(former.motor, (speed + rate) * former.ratio, 1.0)
        moment = shaft * former.ratio * (former.efficiency if shaft > 0.0 else 1.0 / former.efficiency)
        passed = former.stiffness_nm_per_rad * twist + former.damping_nms_per_rad * rate
        ahead = (passed - load_moment(former.bank, crank, 1.0) - half * speed * speed) / inertia
        return [speed, rate, ahead, (moment - passed) / former.motor_inertia_kg_m2 - ahead]

    start = machine_for(3, overrides).linkage.start()
    peer = solve_ivp(
        slope, (0.0, 0.5), [0.0, 0.0, start.velocity[1], 0.0], "DOP853", rtol=1e-10, atol=1e-13, max_step=1e-3
    )
    assert strongly_coupled(3, 0.5, overrides)[:4] == pytest.approx(peer.y[:, -1], rel=1e-7, abs=1e-10)


def test_energy_is_kept_where_nothing_feeds_or_takes_it():
    free = {**AT_SPEED, "load": "none", "drive.damping_nms_per_rad": 0.0, "supply.initial_fraction": 0.0}
    machine = machine_for(2, free)
    worst = 0.0
    for frame in frames(machine, 2.0, lambda step: 0.0):
        memory = frame.linkage.memory.as_dict()
        assert (memory["motor_work_j"], memory["damping_work_j"], memory["load_work_j"]) == (0.0, 0.0, 0.0)
        worst = max(worst, abs(frame.linkage.residuals["energy_balance"]))
    assert worst < 1e-10
    assert frame.linkage.velocity[1] != pytest.approx(frame.linkage.velocity[0], abs=1e-6)  # it does swing


def test_a_loaded_start_stalls_and_says_so_at_the_exact_time():
    machine = machine_for(2, LOADED)
    regimes = machine.linkage.regimes
    events = []
    for frame in frames(machine, 2.0):
        events += frame.linkage.events
        if events and events[-1].kind == "stall":
            assert regimes[frame.linkage.regime] == "stalled"
    assert [event.kind for event in events][-1] == "stall"
    assert events[-1].time_s == pytest.approx(machine.parameters.stall.time_s, abs=0.3)
    assert abs(frame.linkage.velocity[0]) < 0.01
    assert former_metrics(machine.parameters, former_of(machine.parameters))["start_stalls_1"] == 1.0


def test_the_catalogue_starting_torque_would_start_it():
    machine = machine_for(2, {**LOADED, "motor.torque_curve": "starting_corrected"})
    report = machine.report()
    assert report["start_stalls_1"] == 0.0
    frame = last_frame(machine, 4.0)
    assert frame.linkage.velocity[1] > 0.95 * report["steady_speed_rad_per_s"]


def test_a_slow_frequency_ramp_starts_it_under_load_too():
    ramp = {**LOADED, "supply.initial_fraction": 0.0, "supply.rate_per_s": 0.5}
    frame = last_frame(machine_for(2, ramp), 4.0)
    assert frame.linkage.velocity[1] > 9.5
    assert machine_for(2, ramp).linkage.regimes[frame.linkage.regime] == "running"


@pytest.mark.parametrize("load", ["resist", "reversing"])
def test_at_rest_the_load_holds_the_shaft_up_to_its_size(load):
    machine = machine_for(2, {**LOADED, "load": load, "start.crank_deg": 40.0, "supply.initial_fraction": 0.01})
    limit = load_moment(machine.linkage.model.former.bank, np.radians(40.0), 1.0)
    for frame in frames(machine, 0.5, lambda step: 0.01):
        linkage = frame.linkage
        assert machine.linkage.regimes[linkage.regime] == "held"
        assert linkage.velocity[1] == 0.0
        assert linkage.position[1] == np.radians(40.0)
        assert 0.0 <= linkage.effort[1] < limit
        assert frame.forces.quantities["crank_acceleration_rad_per_s2"] == pytest.approx(0.0, abs=1e-9)
    assert linkage.effort[1] > 1.0
    assert linkage.effort[1] == pytest.approx(linkage.effort[0], rel=0.05)  # the motor's moment is all held


def test_a_machine_switched_off_under_load_stops_and_stays():
    machine = machine_for(2, {**AT_SPEED, "supply.rate_per_s": 1e4})
    kinds = [event.kind for frame in frames(machine, 3.0, lambda step: 0.0) for event in frame.linkage.events]
    frame = last_frame(machine, 3.0, 0.0)
    assert kinds[-1] == "held"
    assert frame.linkage.velocity[1] == 0.0
    assert abs(frame.linkage.velocity[0]) < 1e-6
    assert frame.motor.effort == (0.0,)
    assert "stall" not in kinds


def test_the_load_comes_on_at_its_speed_and_rises_in_its_time():
    machine = machine_for(2)
    shares = {}
    for frame in frames(machine, 2.0):
        for event in frame.linkage.events:
            if event.kind == "load_engaged":
                shares["from"] = event.time_s
        shares[frame.linkage.time_s] = frame.linkage.memory["load_share_1"]
    on = shares.pop("from")
    for time, share in shares.items():
        assert share == pytest.approx(min(1.0, max(0.0, (time - on) / machine.parameters.start.load_rise_s)), abs=1e-9)


def test_parameters_may_change_between_any_two_steps():
    """The energy book closes over a change: what the change itself puts in is not the motion's work."""
    soft, stiff = (
        machine_for(2),
        machine_for(
            2,
            {
                "drive.stiffness_nm_per_rad": 200000.0,
                "drive.damping_nms_per_rad": 3000.0,
                "carts.roller_force_x_n": 2500.0,
            },
        ),
    )
    frame = complete_frame(soft, soft.linkage.start(), None, 1.0)
    for step in range(1, 3001):
        frame = next_frame(stiff if step > 1500 else soft, frame, 1.0)
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-8
    assert frame.linkage.effort[2] == pytest.approx(200000.0 * frame.linkage.position[2], rel=1e-12)
    assert frame.forces.quantities["load_moment_nm"] > 1.2 * 593.0


@pytest.mark.parametrize("carts", CARTS)
def test_forces_come_from_the_joints_alone_and_agree_with_the_motion(carts):
    machine = machine_for(carts, AT_SPEED)
    past: list[Frame] = []
    for frame in frames(machine, 0.3):
        stripped = frame.linkage._replace(memory=frame.linkage.memory._replace(names=(), values=()), regime=0)
        assert machine.forces.analyse(stripped) == frame.forces
        past.append(frame)
    speeds = np.array([frame.linkage.velocity[1] for frame in past])
    found = np.array([frame.forces.quantities["crank_acceleration_rad_per_s2"] for frame in past])
    difference = (speeds[2:] - speeds[:-2]) / (2.0 * machine.coupling_step_s) - found[1:-1]
    assert np.median(np.abs(difference)) < 1e-4 * np.max(np.abs(found))  # a few differences span a dead centre
    assert frame.linkage.position[0] == pytest.approx(frame.linkage.position[1] + frame.linkage.position[2], rel=1e-14)


def test_three_carts_and_four_shake_the_frame_less_than_their_sum():
    """The first harmonic of the shaking force cancels for carts evenly spread; two carts at 90 degrees keep it."""
    most = {}
    for carts in CARTS:
        machine = machine_for(carts, {**AT_SPEED, "load": "none"})
        run = [frame.forces.quantities["shaking_force_x_n"] for frame in frames(machine, 1.3)][600:]
        most[carts] = max(abs(force) for force in run) / carts
    assert most[3] < 0.1 * most[1]
    assert most[4] < 0.1 * most[1]
    assert most[2] > 0.5 * most[1]


def test_odd_arrangements_run():
    odd = {
        "carts.offsets_deg": [0.0, -75.0, 200.0],
        "carts.masses_kg": [197.3333, 150.0, 400.0],
        "carts.states": ["loaded", "empty", "missing"],
        "guide_friction": "rail_change",
    }
    machine = machine_for(3, {**AT_SPEED, **odd})
    for frame in frames(machine, 1.0):
        for name, value in frame.linkage.residuals.as_dict().items():
            assert abs(value) <= machine.linkage.residual_limits[name]
        for name, value in frame.forces.residuals.as_dict().items():
            assert abs(value) <= machine.forces.residual_limits[name]
    assert frame.linkage.velocity[1] > 10.0


@pytest.mark.parametrize("load", ["reversing", "resist", "rectified", "printed", "none"])
@pytest.mark.parametrize("kinematics", ["exact", "expanded"])
def test_every_load_and_kinematics_keeps_the_proofs(load, kinematics):
    machine = machine_for(2, {"load": load, "kinematics": kinematics})
    for frame in frames(machine, 1.5):
        for role, sample in ((machine.linkage, frame.linkage), (machine.forces, frame.forces)):
            for name, value in sample.residuals.as_dict().items():
                assert abs(value) <= role.residual_limits[name], (name, value, frame.linkage.time_s)


def test_steady_numbers_of_a_run_are_those_of_the_summary():
    machine = machine_for(2)
    observer = machine.observer()
    for frame in frames(machine, 4.0):
        observer.observe(frame)
    seen, said = observer.numbers(), machine.report()
    for name in ("elastic_moment_min_nm", "elastic_moment_max_nm", "coupling_moment_max_nm", "twist_range_rad"):
        assert seen[f"last_turn_{name}"] == pytest.approx(said[name], rel=1e-3), name
    for name, steady in (("speed_rad_per_s", "steady_speed_rad_per_s"), ("coupling_moment_rms_nm", None)):
        assert seen[f"last_turn_{name}"] == pytest.approx(said[steady or name], rel=1e-5), name
    assert seen["load_engaged_at_s"] < said["startup_time_s"]


@settings(deadline=None)
@given(st.floats(0.0, 7.0), st.lists(st.floats(0.0, 360.0), min_size=2, max_size=2), st.sampled_from([0.1, 0.4]))
@example(0.0, [0.1, 179.9], 0.4)
@example(0.0, [90.0, 270.0], 0.4)
def test_the_expansion_misses_the_linkage_by_no_more_than_its_transfer_function_does(crank_rad, offsets_deg, crank_m):
    """Cart by cart: also where their inertia moments cancel in the sum, near dead centres and opposite each other."""
    expanded = {"kinematics": "expanded", "load": "none", "carts.crank_m": crank_m, "carts.offsets_deg": offsets_deg}
    machine = machine_for(2, {**expanded, "carts.rod_mass_kg": 1.0})
    start, limit = machine.linkage.start(), machine.forces.residual_limits["drive_torque_routes"]
    turned_to, rest = (crank_rad, crank_rad, *start.position[2:]), (0.0,) * (len(start.joints) - 2)
    sample = start._replace(position=turned_to, velocity=(100.0, 100.0, *rest), effort=(0.0, 0.0, *rest))
    forces = machine.forces.analyse(sample)
    assert limit == pytest.approx(0.2 * (crank_m / 0.8) ** 3)
    assert abs(forces.residuals["drive_torque_routes"]) <= limit


def test_the_limit_of_an_expansion_is_never_below_rounding():
    machine = machine_for(2, {"kinematics": "expanded", "carts.rod_m": 100.0, "carts.crank_m": 0.05})
    assert machine.forces.residual_limits["drive_torque_routes"] == 1e-10


def test_a_small_crank_in_dry_friction_of_its_shaft_keeps_its_residuals():
    changes = {
        "carts.crank_m": 0.04690310364803357,
        "carts.rod_mass_kg": 1.6643721682638273,
        "carts.roller_force_x_n": 0.0,
        "carts.weight_n": 365.18956793064604,
        "carts.friction": 0.18488586312433702,
        "carts.gravity_m_per_s2": 9.81,
        "carts.states": ["loaded", "empty", "empty"],
        "guide_friction": "signed",
        "kinematics": "expanded",
        "drive.gear_loss": "printed",
        "drive.inertia_factor": 1.0,
        "drive.ratio": 0.8443576597824098,
        "friction.coulomb_nm": 7720.572455470508,
        "friction.viscous_nms_per_rad": 0.0,
        "supply.initial_fraction": 0.5961993734876235,
        "supply.rate_per_s": 0.29269894482845266,
        "start.speed_fraction": 1.0,
        "start.load_from_fraction": 0.9,
        "start.load_rise_s": 0.5,
        "stall.time_s": 1e-06,
        "integrator.tolerance": 1e-07,
    }
    assert run(machine_for(3, changes), (1.0, 0.644665381531002, 0.0, 1.0))[0] == ""


def test_a_crank_that_stands_after_several_turns_in_one_section_of_its_start_is_timed_without_it() -> None:
    former, speed = machine_for(3, {}).linkage.model.former._replace(coulomb_nm=1e9), 5e4
    y = state_array(0.0, speed)
    _, _, steady = start_motion(former, (1.0, 1.0), 10.0, 0.5, y, np.array(start_modes(former, speed)))
    assert y[0] > 4.0 * np.pi and y[2] == 0.0
    assert not steady

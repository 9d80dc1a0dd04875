# SPDX-License-Identifier: Apache-2.0
"""Laws of the drive: the gear loses in both directions, friction of the shaft, weight of the rods, steps and motor."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from pydantic import ValidationError
from roller_former_cases import joints_of, machine_for, parameters_for

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.coupling import next_frame
from mech_twin.engine.run import frames
from mech_twin.errors import MotionError
from mech_twin.machines.roller_former.parameters import former_of, longest_step_s
from mech_twin.machines.roller_former.roles import FormerMemory
from mech_twin.machines.roller_former.sizing import motor_verdict
from mech_twin.samples import Frame

AT_SPEED = {"start.speed_fraction": 1.0, "start.load_from_fraction": 0.0}
OFF = {"load": "none", "supply.initial_fraction": 0.0}


def memory_of(frame: Frame) -> FormerMemory:
    return FormerMemory(*frame.linkage.memory.values)


def gear_losses(gear_loss: str) -> np.ndarray:
    """Return the energy (J) lost in the gear up to each step of a run braked by its motor, from the motor's samples."""
    braked = {**AT_SPEED, "load": "none", "drive.gear_loss": gear_loss, "drive.efficiency": 0.7}
    run = list(frames(machine_for(2, braked), 1.0, lambda step: 0.4))
    power = np.array([frame.motor.effort[0] * frame.motor.velocity[0] for frame in run])
    step_s = run[1].linkage.time_s
    given = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * step_s)])
    assert given[-1] < -1000.0  # the motor does take energy back
    return given - np.array([memory_of(frame).motor_work_j for frame in run])


def test_a_gear_never_creates_energy():
    losses = gear_losses("power")
    assert np.all(np.diff(losses)[2:] > 0.0)  # the first steps hold the torque, having no two samples yet
    assert losses[-1] > 500.0
    assert gear_losses("printed")[-1] < -500.0  # the rule as printed does create it


@pytest.mark.parametrize(("carts", "share"), [(2, 0.3056), (3, 0.4471), (4, 0.4597)])
def test_the_coupling_on_the_motors_side_carries_the_loss_of_the_gear_too(carts, share):
    """T/(u eta): 152.8, 223.6 and 229.8 N m of the rated 500, where T/u has 137.5, 201.2 and 206.9."""
    report = machine_for(carts).report()
    assert report["coupling_load_of_rated_1"] == pytest.approx(share, abs=1e-4)
    expected = report["coupling_moment_max_nm"] / (9.8 * 0.9)
    assert report["coupling_moment_at_motor_max_nm"] == pytest.approx(expected, rel=1e-12)


def test_a_braking_motor_has_less_in_its_coupling_than_the_crank_gives():
    machine = machine_for(2, {**AT_SPEED, "load": "none"})
    ratios = set()
    for frame in frames(machine, 0.6, lambda step: 0.3):
        quantities = frame.forces.quantities
        transmitted, at_motor = quantities["coupling_moment_nm"], quantities["coupling_moment_at_motor_nm"]
        if abs(transmitted) > 1.0:
            ratios.add(round(at_motor / transmitted * 9.8, 9))
    assert ratios == {round(0.9, 9), round(1.0 / 0.9, 9)}


def test_a_gear_of_poor_efficiency_holds_a_stalled_drive_still():
    """At rest the gear passes on anything between eta u M and u M/eta: the twist neither swings nor creeps."""
    stalled = {"start.load_from_fraction": 0.0, "drive.efficiency": 0.5, "drive.damping_nms_per_rad": 0.0}
    run = list(frames(machine_for(2, stalled), 2.0))
    last = run[-1].linkage
    assert machine_for(2, stalled).linkage.regimes[last.regime] == "stalled"
    assert joints_of(last.velocity).drive == 0.0
    assert joints_of(last.position).twist == joints_of(run[-200].linkage.position).twist
    assert memory_of(run[-1]).drive_direction_1 == 0.0


def test_a_start_is_judged_by_the_run_to_its_end():
    """With the printed loads the empty start succeeds, and the load then stalls the motor."""
    machine = machine_for(2, {"parameter_set": "printed"})
    report = machine.report()
    events = {event.kind: event.time_s for frame in frames(machine, 6.0) for event in frame.linkage.events}
    assert events["load_engaged"] < events["stall"] < 6.0
    assert (report["start_stalls_1"], report["start_steady_1"]) == (1.0, 0.0)
    assert report["start_stall_at_s"] == pytest.approx(events["stall"], abs=2e-3)
    assert not motor_verdict(parameters_for(2, {"parameter_set": "printed"})).starts_as_configured


def test_a_start_that_ends_without_its_load_is_none():
    never = machine_for(2, {"friction.viscous_nms_per_rad": 60.0, "start.load_from_fraction": 0.999})
    report = never.report()
    assert (report["start_stalls_1"], report["start_steady_1"]) == (0.0, 0.0)


def test_coulomb_friction_brings_a_machine_without_supply_to_rest():
    """Its work is C times the angle turned, and what is left at rest is the twist that friction holds."""
    rest = {**OFF, "start.speed_fraction": 0.3, "friction.coulomb_nm": 150.0}
    machine = machine_for(2, rest)
    run = list(frames(machine, 3.0, lambda step: 0.0))
    last, memory = run[-1].linkage, memory_of(run[-1])
    assert machine.linkage.regimes[last.regime] == "held"
    assert joints_of(last.velocity).crank == 0.0
    assert [event.kind for frame in run for event in frame.linkage.events][-1] == "held"
    assert memory.friction_work_j == pytest.approx(150.0 * joints_of(last.position).crank, rel=1e-9)
    energy = memory_of(run[0]).stored_energy_j
    lost = memory.friction_work_j + memory.damping_work_j
    assert energy == pytest.approx(lost + memory.stored_energy_j, rel=1e-10)
    assert memory.stored_energy_j < 0.5 * 150.0**2 / 110000.0


def test_a_motor_too_weak_for_the_friction_of_the_shaft_does_not_turn_it():
    """At standstill 39.85 N m reach the crank as 39.85 9.8 0.9 = 351.5 N m, twice that as the spring overshoots."""
    for friction, held in ((340.0, False), (704.0, True)):
        machine = machine_for(2, {"load": "none", "friction.coulomb_nm": friction, "drive.gear_loss": "printed"})
        *_, frame = frames(machine, 0.3)
        assert (joints_of(frame.linkage.position).crank == 0.0) is held, friction


def test_friction_of_the_shaft_is_in_the_forces():
    viscous = {**AT_SPEED, "friction.coulomb_nm": 20.0, "friction.viscous_nms_per_rad": 3.0}
    machine = machine_for(3, viscous)
    for frame in frames(machine, 0.5):
        speed = joints_of(frame.linkage.velocity).crank
        assert frame.forces.quantities["friction_moment_nm"] == pytest.approx(20.0 + 3.0 * speed, rel=1e-12)
        assert abs(frame.forces.residuals["drive_torque_routes"]) < 1e-10


def test_the_weight_of_the_rods_is_on_crank_pins_and_shaft():
    heavy, weightless = machine_for(1, {"carts.gravity_m_per_s2": 9.81}), machine_for(1)
    linkage = heavy.linkage.start()._replace(
        position=machine_for(1, {"start.crank_deg": 30.0}).linkage.start().position
    )
    with_weight, without = heavy.forces.analyse(linkage), weightless.forces.analyse(linkage)
    arm = 0.2 * math.cos(math.radians(30.0))
    assert with_weight.quantities["rod_weight_moment_nm"] == pytest.approx(32.0 * 9.81 * arm, rel=1e-12)
    assert without.quantities["rod_weight_moment_nm"] == 0.0
    for frame in frames(heavy, 2.5):
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-8
        assert abs(frame.forces.residuals["drive_torque_routes"]) < 1e-10
    pins = dict(zip(heavy.forces.pins, frame.forces.wrenches, strict=True))
    pull = frame.forces.quantities["rod_force_1_n"]
    beta = joints_of(frame.linkage.position).rods[0]
    assert pins["crank_pin_1"].force_y_n == pytest.approx(-pull * math.sin(beta) - 32.0 * 9.81, rel=1e-12)
    assert pins["cart_pin_1"].force_y_n == pytest.approx(pull * math.sin(beta), rel=1e-12)


def test_the_torque_of_the_motor_and_its_heating_are_those_of_a_run():
    machine = machine_for(1)
    report, motor = machine.report(), former_of(machine.parameters).motor
    turn = [frame for frame in frames(machine, 8.0) if frame.linkage.time_s > 8.0 - 2.0 * report_turn(report)]
    torque = np.array([frame.motor.effort[0] for frame in turn])
    slip = 1.0 - np.array([frame.motor.velocity[0] for frame in turn]) / motor.synchronous_speed_rad_per_s
    assert report["motor_torque_rms_nm"] == pytest.approx(math.sqrt(np.mean(torque**2)), rel=3e-3)
    heating = np.mean(torque * slip) / (53.85 * 0.025)
    assert report["motor_rotor_loss_of_rated_1"] == pytest.approx(heating, rel=5e-3)
    assert report["motor_rotor_loss_of_rated_1"] > 1.5  # the motor of one cart has the power, but not for its swings


def report_turn(report: dict[str, float]) -> float:
    return 2.0 * math.pi / report["steady_speed_rad_per_s"]


def test_means_of_a_turn_come_from_the_works():
    """The coupling's mean moment is that of the static load; at 5 ms the run's mean power is still the turn's."""
    coarse = machine_for(2, {"coupling.step_s": 0.005})
    report = coarse.report()
    assert report["coupling_moment_mean_nm"] == pytest.approx(report["moment_mean_nm"], rel=1e-6)
    observer = coarse.observer()
    for frame in frames(coarse, 6.0):
        observer.observe(frame)
    seen = observer.numbers()
    assert seen["last_turn_drive_power_mean_w"] == pytest.approx(report["drive_power_mean_w"], rel=2e-3)
    assert "coupling_moment_max_nm" not in seen  # what a run saw does not go by the name of what a cycle has


OWN_MOTOR = {
    "motor.catalogue_name": None,
    "motor.rated_power_w": 5500.0,
    "motor.rated_speed_rpm": 975.0,
    "motor.synchronous_speed_rpm": 1000.0,
    "motor.breakdown_torque_ratio": 4.0,
    "motor.starting_torque_ratio": 2.4,
    "motor.rotor_inertia_kg_m2": 1e-6,
}


def test_a_step_longer_than_the_motor_bears_is_refused_with_its_bound():
    assert longest_step_s(parameters_for(2)) == 0.01
    with pytest.raises(ConfigurationError, match=r"coupling.step_s"):
        parameters_for(2, {"coupling.step_s": 0.011})
    light = {
        "drive.coupling_inertia_kg_m2": 0.0,
        "drive.inertia_factor": 1.0,
        "drive.damping_nms_per_rad": 0.0,
    } | OWN_MOTOR
    with pytest.raises(ConfigurationError, match=r"coupling.step_s <= .* s needed, got 0.002: at most 1000 times"):
        parameters_for(2, {**light, "coupling.step_s": 0.002})


@pytest.mark.slow
@pytest.mark.parametrize("carts", [1, 2, 4])
def test_at_the_longest_step_the_motion_is_that_of_a_short_one(carts):
    ends = []
    for step in (0.999 * longest_step_s(parameters_for(carts)), 2e-4):
        machine = machine_for(carts, {**AT_SPEED, "coupling.step_s": step})
        *_, frame = frames(machine, 3.0)
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-8
        ends.append(memory_of(frame).motor_work_j / frame.linkage.time_s)
    assert ends[0] == pytest.approx(ends[1], rel=5e-3)


def test_a_change_of_parameters_is_booked_as_work():
    """A stiffer spring at a twist has (c2 - c1) twist^2/2 more in it; the balance stays closed."""
    soft, stiff = machine_for(2, AT_SPEED), machine_for(2, {**AT_SPEED, "drive.stiffness_nm_per_rad": 300000.0})
    *_, frame = frames(soft, 0.7)
    twist = joints_of(frame.linkage.position).twist
    assert memory_of(frame).change_work_j == 0.0
    after = next_frame(stiff, frame, 1.0)
    assert memory_of(after).change_work_j == pytest.approx(0.5 * 190000.0 * twist * twist, rel=1e-9)
    for _ in range(300):
        after = next_frame(stiff, after, 1.0)
        assert abs(after.linkage.residuals["energy_balance"]) < 1e-8
    first, last = memory_of(next(iter(frames(soft, 0.0)))), memory_of(after)
    took = last.damping_work_j + last.load_work_j + last.friction_work_j
    held = last.stored_energy_j - first.stored_energy_j
    assert held == pytest.approx(last.motor_work_j - took + last.change_work_j, rel=1e-9)


def test_after_eight_hours_the_balances_are_those_of_the_first_turns():
    """Time, angle and works of eight hours laid on a steady sample: no error hides in them, none grows from them."""
    machine = machine_for(2, AT_SPEED)
    *_, frame = frames(machine, 2.0)
    turns, steps = 47_800, 28_800_000
    linkage, memory = frame.linkage, memory_of(frame)
    place = joints_of(linkage.position)
    angle = 2.0 * math.pi * turns
    position = (place.drive + angle, place.crank + angle, *linkage.position[2:])
    aged = memory._replace(motor_work_j=2.7e8, damping_work_j=3e6, load_work_j=2.6e8)
    late = linkage._replace(
        step=linkage.step + steps,
        time_s=(linkage.step + steps) * 0.001,
        position=position,
        memory=linkage.memory._replace(values=tuple(aged)),
    )
    frame = frame._replace(linkage=late)
    worst: dict[str, float] = {}
    for _ in range(3000):
        frame = next_frame(machine, frame, 1.0)
        for sample in (frame.linkage, frame.forces):
            for name, value in sample.residuals.as_dict().items():
                worst[name] = max(worst.get(name, 0.0), abs(value))
    assert worst["energy_balance"] < 1e-9
    assert worst["rod_length"] < 1e-12
    assert worst["drive_torque_routes"] < 1e-10


def test_an_error_in_a_step_is_seen_after_eight_hours_as_well():
    """A joule that comes from nowhere breaks the limit, however much has been turned over before."""
    machine = machine_for(2, AT_SPEED)
    *_, frame = frames(machine, 1.0)
    memory = memory_of(frame)._replace(motor_work_j=2.7e8, load_work_j=2.6e8)
    linkage = frame.linkage._replace(memory=frame.linkage.memory._replace(values=tuple(memory)))
    wrong = machine.linkage.advance(linkage, frame.motor, None)
    assert abs(wrong.residuals["energy_balance"]) < 1e-8
    shaken = FormerMemory(*wrong.memory.values)
    shaken = shaken._replace(turn_balance_error_j=shaken.turn_balance_error_j + 1.0)
    spoilt = wrong._replace(memory=wrong.memory._replace(values=tuple(shaken)))
    after = machine.linkage.advance(spoilt, machine.motor.respond(spoilt, 1.0), None)
    assert abs(after.residuals["energy_balance"]) > machine.linkage.residual_limits["energy_balance"]


def test_refusals_are_of_the_model():
    with pytest.raises((ValidationError, ValueError), match="reduced inertia of 0 kg m\\^2 at a dead centre"):
        parameters_for(1, {"carts.rod_mass_kg": 0.0})
    assert parameters_for(2, {"carts.rod_mass_kg": 0.0}).carts.rod_mass_kg == 0.0


def test_carts_whose_energy_would_drown_the_balance_are_refused_and_the_heaviest_allowed_keep_it():
    """A million times the energy of the motor's side is the bound: rounding is then below the limit of the balance."""
    with pytest.raises((ValidationError, ValueError), match="1e\\+06 times what the motor's side holds") as refused:
        parameters_for(2, {"carts.rod_mass_kg": 1e6, "carts.crank_m": 10.0, "carts.rod_m": 20.0})
    told, most = (float(word) for word in re.findall(r"(\S+) J", str(refused.value))[:2])
    heaviest = {"carts.rod_mass_kg": 0.98e6 * most / told, "carts.crank_m": 10.0, "carts.rod_m": 20.0}
    machine = machine_for(2, {**heaviest, "start.speed_fraction": 1.0, "load": "none"})
    limit = machine.linkage.residual_limits["energy_balance"]
    for frame in frames(machine, 0.2):
        assert abs(frame.linkage.residuals["energy_balance"]) < limit


@pytest.mark.parametrize("tolerance", [1e-7, 1e-9])
@pytest.mark.parametrize(("rod_mass_kg", "mass_kg"), [(6e4, 0.0), (6e4, 4e5)])
def test_a_heavy_crank_keeps_the_balance_of_energy_at_every_tolerance(tolerance, rod_mass_kg, mass_kg):
    """It holds up to 1e6 times what the motor's side does, over which the balance is told."""
    small = {"drive.ratio": 0.33, "drive.stiffness_nm_per_rad": 1000.0, "drive.damping_nms_per_rad": 80.0}
    heavy = {"carts.rod_mass_kg": rod_mass_kg, "carts.mass_kg": mass_kg, "start.speed_fraction": 1.0}
    exact = {"integrator.tolerance": tolerance, "coupling.step_s": 0.003}
    machine = machine_for(1, {**OFF, **small, **heavy, **exact})
    limit = machine.linkage.residual_limits["energy_balance"]
    for frame in frames(machine, 0.2, lambda step: 0.0):
        assert abs(frame.linkage.residuals["energy_balance"]) < limit


def test_a_soft_coupling_keeps_the_balance_of_energy():
    """Of 1 N m/rad: under the motor's moment it would twist by 1500 turns, in which no error is to be told."""
    soft = {"drive.stiffness_nm_per_rad": 1.0, "drive.damping_nms_per_rad": 14900.0, "drive.gear_loss": "power"}
    loads = {"mass_kg": 13158.6, "roller_force_x_n": 113553.0, "roller_force_y_n": 138911.0, "weight_n": 144400.0}
    carts = {**loads, "rod_mass_kg": 4267.7, "crank_m": 0.0731, "rod_m": 0.0746}
    plate = {"rated_power_w": 317226.0, "rated_speed_rpm": 3150.0, "synchronous_speed_rpm": 4279.0}
    absent = dict.fromkeys(("rated_torque_nm", "breakdown_torque_nm", "breakdown_slip", "catalogue_name"))
    motor = {**plate, **absent, "rotor_inertia_kg_m2": 0.08}
    keys = {f"carts.{key}": value for key, value in carts.items()} | {f"motor.{key}": motor[key] for key in motor}
    start = {"start.speed_fraction": 0.0, "supply.initial_fraction": 1.0, "coupling.step_s": 0.01}
    drive = {"drive.inertia_factor": 1.322, "drive.coupling_inertia_kg_m2": 0.1855}
    machine = machine_for(3, {"load": "reversing", **soft, **keys, **start, **drive})
    for frame in frames(machine, 0.5, lambda step: 0.5):
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-9


def test_a_heavy_crank_that_has_turned_far_keeps_the_balance_of_energy():
    """Its angle and speed lose no digits in thousands of short steps: as they were rounded, 2e-8 was open."""
    small = {"drive.ratio": 0.1, "drive.inertia_factor": 1.0, "drive.coupling_inertia_kg_m2": 1e-4}
    stiff = {"drive.stiffness_nm_per_rad": 1e6, "drive.damping_nms_per_rad": 0.0, "motor.rotor_inertia_kg_m2": 0.01}
    rods = {"carts.rod_mass_kg": 6e5, "carts.mass_kg": 0.0, "carts.crank_m": 0.004, "carts.rod_m": 4.2}
    start = {"start.speed_fraction": 1.0, "start.crank_deg": 3600.0, "carts.gravity_m_per_s2": 100.0}
    machine = machine_for(1, {**OFF, **small, **stiff, **rods, **start, "coupling.step_s": 2e-4})
    for frame in frames(machine, 0.1, lambda step: 0.0):
        assert abs(frame.linkage.residuals["energy_balance"]) < 5e-9


def test_error_control_of_a_crank_no_heavier_than_usual_is_that_of_the_configuration():
    for carts in (1, 2, 3, 4):
        for change in ({}, {"parameter_set": "printed"}, {"carts.crank_inertia_kg_m2": 100.0 / carts}):
            former = former_of(parameters_for(carts, change))
            assert (former.tolerances == 1e-9 * np.array(former.scales)).all()


def test_a_crank_that_falls_back_over_the_dead_centre_it_starts_on_keeps_its_energy():
    """It begins forward, and its rod's weight takes it back: no step may put it back on the dead centre."""
    falling = {**OFF, "load": "rectified", "start.crank_deg": -3600.0, "start.speed_fraction": 1e-4}
    heavy = {"carts.rod_mass_kg": 1e4, "carts.gravity_m_per_s2": 9.81, "coupling.step_s": 0.005}
    machine = machine_for(1, {**falling, **heavy, "drive.gear_loss": "printed"})
    for frame in frames(machine, 0.1, lambda step: 0.0):
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-10
    assert joints_of(frame.linkage.velocity).crank < -0.1


def test_a_crank_in_thick_friction_creeps_as_fast_as_its_moment_drives_it():
    """Far below the integrator's tolerance, and never backward: T/v, the drive turning on and winding up the twist."""
    thick = {"friction.viscous_nms_per_rad": 1.2e6, "friction.coulomb_nm": 1e-12, "drive.damping_nms_per_rad": 0.0}
    soft = {"drive.stiffness_nm_per_rad": 1.0, "start.speed_fraction": 1.0, "coupling.step_s": 1e-4}
    machine = machine_for(1, {**OFF, **thick, **soft})
    for frame in frames(machine, 1e-3, lambda step: 0.0):
        if frame.linkage.step >= 2:
            driven = joints_of(frame.linkage.effort).twist / 1.2e6
            assert joints_of(frame.linkage.velocity).crank == pytest.approx(driven, rel=0.02)
            assert not frame.linkage.events
    assert driven < 1e-9 * machine.parameters.synchronous_crank_speed_rad_per_s


UNDER_LOAD = {"load": "rectified", "start.load_from_fraction": 0.0, "start.load_rise_s": 0.0}


@pytest.mark.parametrize(
    ("change", "sense"),
    [
        ({"carts.gravity_m_per_s2": 1.0}, 1.0),
        ({"carts.gravity_m_per_s2": 1e-3}, 1.0),
        (UNDER_LOAD, -1.0),
        ({**UNDER_LOAD, "start.load_rise_s": 0.5}, -1.0),
    ],
)
def test_a_crank_at_rest_on_a_dead_centre_sets_off_as_one_beside_it(change, sense):
    """Of the rods' weights nothing but rounding is left there, and of the load only what the other carts carry."""
    angles_rad = []
    for start_deg in (0.0, 1e-6):
        machine = machine_for(2, {**change, "start.crank_deg": start_deg})
        run = list(frames(machine, 0.2))
        for frame in run:
            assert abs(frame.linkage.residuals["energy_balance"]) <= machine.linkage.residual_limits["energy_balance"]
        angles_rad.append(joints_of(run[-1].linkage.position).crank)
    assert sense * angles_rad[0] > 1e-3
    assert angles_rad[0] == pytest.approx(angles_rad[1], abs=1e-6)


@pytest.mark.parametrize(("offset_deg", "start_deg"), [(-180.0, -1800.0), (-360.0, -3600.0), (1080.0, 3600.0)])
def test_a_crank_sets_off_from_a_dead_centre_of_two_carts_that_rounding_tells_apart(offset_deg, start_deg):
    machine = machine_for(2, {"start.crank_deg": start_deg, "carts.offsets_deg": [0.0, offset_deg]})
    started, *_, last = frames(machine, 0.2)
    assert joints_of(last.linkage.position).crank > joints_of(started.linkage.position).crank + 0.01


def test_a_crank_that_its_carts_run_away_with_is_refused_with_the_bound():
    soft = {
        "drive.stiffness_nm_per_rad": 1.0,
        "drive.damping_nms_per_rad": 0.0,
        "load_sets.table.roller_force_x_n": 1e8,
    }
    machine = machine_for(3, {**UNDER_LOAD, **soft, "start.crank_deg": 30.0})
    with pytest.raises(MotionError, match=r"more than 10000 times motor\.synchronous_speed_rpm"):
        for frame in frames(machine, 0.1):
            fastest = abs(joints_of(frame.linkage.velocity).crank)
    assert fastest > 1e4 * machine.parameters.synchronous_crank_speed_rad_per_s

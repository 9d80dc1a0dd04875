# SPDX-License-Identifier: Apache-2.0
"""Runs of the press: works and means from the energy balance, the layer's singular start, the events of a run."""

from __future__ import annotations

from itertools import pairwise
from math import pi

import numpy as np
import pytest
from crank_drives import PRESS_KLOSS as KLOSS
from scipy.integrate import quad

import mech_twin as mt
from mech_twin.engine.run import frames
from mech_twin.machines.compaction_press.dynamics import layer_force
from mech_twin.machines.compaction_press.parameters import press_constants
from mech_twin.parameters.load import machine


def numbers_of(overrides, seconds):
    press = machine("compaction_press", overrides=overrides)
    observer, worst = press.observer(), 0.0
    for frame in frames(press, seconds):
        observer.observe(frame)
        worst = max(worst, abs(frame.linkage.residuals["energy_balance"]))
    return press, observer.numbers(), worst


@pytest.mark.parametrize("exponent", [0.0, 0.05, 0.5, 1.0, 20.0])
@pytest.mark.parametrize("drive", [{}, KLOSS], ids=["led", "kloss"])
def test_the_energy_balance_holds_over_any_start_of_the_layer(exponent, drive):
    """With exponents below 1 the force sets in with a vertical tangent, with 0 as a step."""
    overrides = {**drive, "working_force.exponent": exponent, "coupling.step_s": 0.005}
    _, numbers, worst = numbers_of(overrides, 1.5)
    assert numbers["run_contact_events"] >= 1.0
    assert worst < 1e-9


def test_a_layer_of_exponent_0_resists_with_its_peak_from_first_contact():
    press, stroke = press_constants(machine("compaction_press", overrides={"working_force.exponent": 0.0}).parameters)
    assert layer_force(press.load, stroke.contact_y_m) == 10000.0
    assert layer_force(press.load, stroke.bottom_y_m) == 10000.0


def test_contact_is_met_at_the_speed_of_the_plate():
    press = machine("compaction_press")
    event = next(e for frame in frames(press, 0.2) for e in frame.linkage.events if e.kind == "contact")
    f, w, h = event.pre[0].position, event.pre[0].velocity, 1e-5
    high, low = (press.analyse(f + step)["loaded_point_height_m"] for step in (-h, h))
    assert event.pre_velocity_m_per_s == pytest.approx((high - low) / (2.0 * h) * w, rel=1e-8)


@pytest.mark.parametrize("step_s", [0.001, 0.005])
def test_mean_torque_and_power_come_from_the_work_whatever_the_step(step_s):
    press, numbers, _ = numbers_of({"coupling.step_s": step_s}, 1.0)
    report = press.report()
    assert numbers["turn_drive_torque_mean_nm"] == pytest.approx(report["drive_torque_mean_nm"], rel=1e-5)
    assert numbers["turn_power_mean_w"] == pytest.approx(report["power_mean_w"], rel=1e-5)


def test_the_last_turn_is_told_apart_from_the_start():
    press, numbers, _ = numbers_of(KLOSS, 6.0)
    assert numbers["turn_is_settled"] == 1.0
    assert numbers["run_crank_speed_min_rad_per_s"] == 0.0
    assert numbers["turn_crank_speed_min_rad_per_s"] > 20.0
    layer = press.report()["work_per_cycle_j"]
    assert numbers["turn_drive_torque_mean_nm"] * 2.0 * pi == pytest.approx(layer, rel=2e-3)


def test_the_motor_is_loaded_as_its_curve_says():
    """Rotor loss is slip times air-gap power: at a steady torque M over the rated one it is (s M)/(s_n M_n)."""
    _, numbers, _ = numbers_of({**KLOSS, "working_force.peak_n": 0.0, "friction.viscous_nms_per_rad": 1.5}, 6.0)
    speed = numbers["turn_crank_speed_mean_rad_per_s"] * 4.8
    torque = numbers["turn_motor_rms_torque_nm"]
    slip = 1.0 - speed / (50.0 * pi)
    rated = 2200.0 / (1440.0 * pi / 30.0)
    assert numbers["turn_motor_rms_torque_over_rated"] == pytest.approx(torque / rated, rel=1e-12)
    assert numbers["turn_motor_rotor_loss_over_rated"] == pytest.approx(torque * slip / (rated * 0.04), rel=0.05)
    assert torque * 4.8 * 0.95 == pytest.approx(1.5 * numbers["turn_crank_speed_mean_rad_per_s"], rel=0.1)


def test_torque_and_heat_of_a_start_do_not_depend_on_the_step():
    """While the supply rises they are taken at the supply of each instant, not at that of the step's end."""
    ramp = {**KLOSS, "supply.initial_fraction": 0.0, "flywheel.inertia_kg_m2": 2.0}
    coarse, fine = (numbers_of({**ramp, "coupling.step_s": step_s}, 1.0)[1] for step_s in (0.002, 0.00025))
    for name in ("motor_torque_nm", "motor_power_w", "motor_rms_torque_nm", "motor_rotor_loss_w"):
        assert coarse[f"run_{name}"] == pytest.approx(fine[f"run_{name}"], rel=1e-3)


@pytest.mark.parametrize("coulomb", [0.0, 5.0])
def test_a_weak_motor_stalls_and_says_so(coulomb):
    """With friction it does not even lift the plate: one stall, and rest; without, it swings against the layer."""
    weak = {**KLOSS, "motor.rated_power_w": 300.0, "flywheel.inertia_kg_m2": 0.05, "friction.coulomb_nm": coulomb}
    _, numbers, worst = numbers_of(weak, 2.0)
    assert numbers["run_stalled_events"] == 1.0 if coulomb else numbers["run_stalled_events"] > 1.0
    assert (numbers["run_crank_speed_max_rad_per_s"] == 0.0) == (coulomb > 0.0)
    assert worst < 1e-9


def test_friction_is_in_the_force_analysis():
    """At constant speed the drive's torque is larger by c + v w, and pins and reduced machine still agree."""
    plain, rubbed = machine("compaction_press"), machine("compaction_press", overrides={"friction.coulomb_nm": 7.0})
    for one, two in zip(frames(plain, 0.1), frames(rubbed, 0.1), strict=True):
        assert two.linkage.effort[0] - one.linkage.effort[0] == pytest.approx(7.0, abs=1e-9)
        assert np.array(two.forces.wrenches) == pytest.approx(np.array(one.forces.wrenches))
        assert abs(two.forces.residuals["drive_torque_routes"]) < 1e-10


@pytest.mark.parametrize(("speed_rpm", "rubs_nm"), [(300.0, 0.0), (-300.0, 0.0), (-300.0, 20.0)])
def test_work_at_a_position_is_the_integral_of_the_torque(speed_rpm, rubs_nm):
    press = machine("compaction_press", overrides={"drive.speed_rpm": speed_rpm, "friction.coulomb_nm": rubs_nm})
    stroke, sign = press_constants(press.parameters)[1], np.sign(speed_rpm)
    entry = stroke.contact if sign > 0 else stroke.contact_reversed

    def torque(f):
        return press.analyse(f)["drive_torque_nm"]

    for way in (1.0, 3.8, 2.0 * pi):
        kinks = sorted(x for x in ((sign * entry) % (2 * pi), (sign * stroke.bottom) % (2 * pi)) if 0.0 < x < way)
        edges = [0.0, *kinks, way]
        work = sum(
            quad(lambda x: torque(sign * x) * sign, a + 1e-12, b - 1e-12, epsabs=1e-9, limit=200)[0]
            for a, b in pairwise(edges)
        )
        at = press.analyse(sign * way)
        assert at["drive_work_from_zero_j"] == pytest.approx(work, abs=1e-6)
    layer = press.report()["work_per_cycle_j"]
    assert work == pytest.approx(layer + 2.0 * pi * rubs_nm, abs=1e-6)


def test_the_working_quarter_starts_at_180_degrees():
    press = machine("compaction_press", overrides={"working_force.working_quarter": True})
    event = next(e for frame in frames(press, 0.2) for e in frame.linkage.events if e.kind == "contact")
    assert event.pre[0].position == pytest.approx(pi, abs=1e-12)


def test_the_flywheel_condition_is_told():
    assert machine("compaction_press").report()["flywheel_missing_kg_m2"] == pytest.approx(2.963918, rel=1e-6)
    fitted = machine("compaction_press", overrides={"flywheel.inertia_kg_m2": 3.0}).report()
    assert fitted["flywheel_missing_kg_m2"] == 0.0
    assert fitted["conditions_hold_1"] == 1.0


@pytest.mark.parametrize(("speed_rpm", "delta"), [(300.0, 0.05), (300.0, 0.03), (77.7, 0.03), (290.0, 0.03)])
def test_no_flywheel_is_missing_beside_the_one_that_is_needed(speed_rpm: float, delta: float):
    asked = {"drive.speed_rpm": speed_rpm, "flywheel.non_uniformity": delta}
    needed = machine("compaction_press", overrides=asked).report()["flywheel_inertia_kg_m2"]
    for share, missing in ((1.0, 0.0), (0.999, 0.001 * needed)):
        fitted = machine("compaction_press", overrides=asked | {"flywheel.inertia_kg_m2": share * needed}).report()
        assert fitted["flywheel_missing_kg_m2"] == pytest.approx(missing, rel=1e-6, abs=0.0)
        assert fitted["conditions_hold_1"] == (missing == 0.0)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"linkage.pivot_x_m": 0.74, "linkage.pivot_y_m": 0.0}, "transmission angle >= 1 degree fails"),
        (
            {
                "linkage.crank_m": 0.3,
                "linkage.pendulum_m": 0.3,
                "linkage.coupler_m": 0.5,
                "linkage.pivot_x_m": 0.5,
                "linkage.pivot_y_m": 0.0,
            },
            "transmission angle >= 1 degree fails",
        ),
        ({**KLOSS, "coupling.step_s": 0.2}, r"coupling.step_s = 0.2 s must be at most 0.0096 s"),
        ({"coupling.step_s": 0.2}, r"coupling.step_s = 0.2 s must be at most 0.05 s"),
        ({"links.crank.inertia_kg_m2": 0.0}, r"links.crank.inertia_kg_m2"),
        ({"friction.coulomb_nm": -1.0}, "friction.coulomb_nm"),
        ({"drive.speed_rpm": 1e6}, "speed_rpm must be"),
    ],
)
def test_a_press_that_cannot_be_computed_is_refused_with_the_number_that_is_broken(overrides, words):
    from mech_twin.declarations.configuration_tree import ConfigurationError

    with pytest.raises(ConfigurationError, match=words) as refused:
        machine("compaction_press", overrides=overrides)
    assert "\n" not in str(refused.value)


WEAK = {**KLOSS, "motor.rated_power_w": 800.0, "flywheel.inertia_kg_m2": 0.0, "working_force.peak_n": 4e4}


def test_a_layer_that_gives_nothing_back_holds_a_stalled_press_where_it_is():
    """It takes of its force what balances drive and weights; an elastic one throws the plate back."""
    press = machine("compaction_press", overrides={**WEAK, "working_force.gives_back": False})
    frame, kinds = None, []
    for frame in frames(press, 2.0):
        kinds += [event.kind for event in frame.linkage.events]
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-10
        assert abs(frame.forces.residuals["drive_torque_routes"]) < 1e-10
    assert kinds[-1] == "stalled"
    assert "release" not in kinds
    assert frame.linkage.velocity[0] == 0.0
    assert press.linkage.regimes[frame.linkage.regime] == "contact"
    assert 0.0 < frame.linkage.memory["load_share"] < 1.0
    assert frame.linkage.effort[0] == pytest.approx(0.95 * 4.8 * frame.motor.effort[0], rel=0.06)
    elastic = numbers_of(WEAK, 2.0)[1]
    assert elastic["run_release_events"] >= 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_compacted_layer_is_met_again_where_the_plate_turned_back(sign):
    """Turned back by its supply inside the layer, and forward again: the work done so far is not done twice."""
    from mech_twin.engine.coupling import next_frame

    one_way, other_way = (
        machine(
            "compaction_press",
            overrides={
                "working_force.gives_back": False,
                "drive.speed_rpm": turn * sign * 60.0,
                "supply.rate_per_s": 50.0,
            },
        )
        for turn in (1.0, -1.0)
    )
    frame, whole = None, one_way.report()["work_per_cycle_j"]
    for frame in frames(one_way, 3.0):
        if frame.linkage.memory["load_work_j"] < -0.3 * whole:
            break
    work, kinds = frame.linkage.memory["load_work_j"], []
    for machine_now, steps in ((other_way, 60), (one_way, 600)):
        for _ in range(steps):
            frame = next_frame(machine_now, frame, 1.0)
            kinds += [(event.kind, event.pre[0].position) for event in frame.linkage.events]
            assert abs(frame.linkage.residuals["energy_balance"]) < 1e-9
    again = next(place for kind, place in kinds if kind == "contact")
    angle = frame.linkage.memory["turned_back_rad"]
    assert again == pytest.approx(angle, abs=1e-12)
    assert kinds[-1][0] == "bottom"
    assert frame.linkage.memory["load_work_j"] == pytest.approx(-whole, rel=1e-9)
    assert work > frame.linkage.memory["load_work_j"]


def test_a_press_that_needs_no_flywheel_has_a_report():
    """A balanced crank without plate and layer: nothing varies, no flywheel is missing, it turns at the mean speed."""
    bare = {f"links.{link}.{key}": 0.0 for link in ("plate", "pendulum") for key in ("mass_kg", "inertia_kg_m2")}
    report = machine("compaction_press", overrides={**bare, "working_force.peak_n": 0.0}).report()
    assert report["flywheel_missing_kg_m2"] == 0.0
    assert report["start_speed_with_flywheel_rad_per_s"] == pytest.approx(10.0 * pi)
    assert all(np.isfinite(value) for value in report.values())


@pytest.mark.parametrize(
    ("speed_rpm", "step_s", "quarter"),
    [(90.0, 0.001, False), (500.0, 0.001, False), (450.0, 0.002, False), (300.0, 0.0003, False), (180.0, 5e-4, True)],
)
def test_a_boundary_on_the_end_of_a_step_is_passed(speed_rpm, step_s, quarter):
    turns = 6.25  # the bottom is at three quarters of a turn, here on the end of a step, but for rounding
    settings = {"drive.speed_rpm": speed_rpm, "coupling.step_s": step_s, "working_force.working_quarter": quarter}
    run = mt.simulate("compaction_press", turns * 60.0 / speed_rpm, settings)
    times = {kind: [event.time_s for event in run.events if event.kind == kind] for kind in ("contact", "bottom")}
    assert len(times["contact"]) == 6
    assert times["bottom"] == pytest.approx([(turn + 0.75) * 60.0 / speed_rpm for turn in range(6)], rel=1e-12)

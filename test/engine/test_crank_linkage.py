# SPDX-License-Identifier: Apache-2.0
"""Crank linkage behind a motor against a second implementation: own kinematics, own motor curve, SciPy's DOP853.

The machine is the vibration crank with a finite rod: y = r sin th + sqrt(L^2 - r^2 cos^2 th), everything written anew.
"""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from crank_drives import VIBRATION_CRANK_KLOSS as KLOSS
from scipy.integrate import solve_ivp

from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.engine.crank_state import Memory as CrankMemory
from mech_twin.engine.crank_state import ShaftFriction, Transmission, mechanism_state
from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine
from mech_twin.samples import MotorSample, Named

R, L, RP = 0.126, 0.504, 0.175
M_S, M_R, M_P, G = 126.75, 7.55, 51.11, 9.80665


def mechanism(th):
    """Return I, dI/dth (kg m2) and M_pr (N m) of the crank."""
    root = np.sqrt(L * L - (R * np.cos(th)) ** 2)
    sine, cosine = np.sin(th), np.cos(th)
    root1 = R * R * sine * cosine / root
    y1 = R * cosine + root1
    y2 = -R * sine + R * R * (cosine**2 - sine**2) / root - root1 * root1 / root
    inertia = M_R * R**2 + M_P * RP**2 + M_S * y1 * y1
    return inertia, 2.0 * M_S * y1 * y2, -M_S * G * y1 - (M_R * R - M_P * RP) * G * cosine


def height(th):
    return R * np.sin(th) + np.sqrt(L * L - (R * np.cos(th)) ** 2)


def kloss(slip):
    rated = 7500.0 / (1440.0 * pi / 30.0)
    s_n = 0.04
    s_kr = s_n * (2.5 + np.sqrt(2.5**2 - 1.0))
    return 2.0 * 2.5 * rated * slip * s_kr / (slip * slip + s_kr * s_kr)


def under_constant_torque(torque, friction, seconds, gear=(1.0, 1.0), inertia=0.5, step=0.001):
    """Return the samples of the linkage turned by a motor of constant torque."""
    linkage = machine("vibration_crank").linkage
    turned = type(linkage)(
        **{
            **{name: getattr(linkage, name) for name in linkage.__dataclass_fields__},
            "transmission": Transmission(*gear, inertia),
            "friction": ShaftFriction(*friction),
            "start_speed": 0.0,
            "step_s": step,
        }
    )
    sample, out = turned.start(), []
    for _ in range(round(seconds / step)):
        motor = MotorSample(sample.step, sample.time_s, ("motor",), (0.0,), (0.0,), (torque,), float(torque != 0.0))
        sample = turned.advance(sample, motor, None)
        out.append(sample)
    return out


def reference(torque, friction, seconds, gear=(1.0, 1.0), shaft=0.5):
    """Return angle and speed at the end: smooth pieces between instants of rest, by solve_ivp."""
    coulomb, viscous = friction
    ratio, efficiency = gear
    shaft, at_crank = shaft * ratio**2, torque * ratio
    th, w, t = 0.0, 0.0, 0.0
    while t < seconds:
        load = mechanism(th)[2]
        if at_crank * efficiency + load > coulomb:
            sense = 1.0
        elif at_crank / efficiency + load < -coulomb:
            sense = -1.0
        else:
            return th, 0.0
        given = at_crank * (efficiency if at_crank * sense > 0.0 else 1.0 / efficiency)

        def rates(_, y, sense=sense, given=given):
            inertia, slope, load = mechanism(y[0])
            moment = given + load - coulomb * sense - viscous * y[1] - 0.5 * slope * y[1] ** 2
            return [y[1], moment / (inertia + shaft)]

        def turns_back(when, y, begun=t, sense=sense):
            return 1.0 if when < begun + 1e-6 else sense * y[1]

        turns_back.terminal, turns_back.direction = True, -1
        run = solve_ivp(
            rates, (t, seconds), [th, w], method="DOP853", rtol=1e-12, atol=1e-13, events=turns_back, max_step=0.01
        )
        (th, w), t = run.y[:, -1], run.t[-1]
        if run.t_events[0].size:
            w = 0.0
        else:
            break
    return th, w


@pytest.mark.parametrize(
    ("torque", "friction", "gear"),
    [
        (150.0, (10.0, 2.0), (1.0, 1.0)),
        (60.0, (5.0, 0.0), (1.0, 1.0)),
        (20.0, (1.0, 0.3), (5.0, 0.9)),
        (-14.0, (0.0, 0.0), (5.0, 0.6)),
        (0.0, (12.0, 0.0), (1.0, 1.0)),
    ],
    ids=["turns", "swings", "geared", "backward with a lossy gear", "no supply"],
)
def test_friction_and_gear_agree_with_an_independent_integration(torque, friction, gear):
    seconds = 2.0
    last = under_constant_torque(torque, friction, seconds, gear)[-1]
    th, w = reference(torque, friction, seconds, gear)
    assert last.position[0] == pytest.approx(th, abs=2e-8)
    assert last.velocity[0] == pytest.approx(w, abs=2e-7)


def test_a_machine_without_supply_comes_to_rest_and_stays():
    """Released at th = 0 it swings under gravity, and friction ends that: exactly at rest, with the load held."""
    samples = under_constant_torque(0.0, (15.0, 1.0), 12.0)
    kinds = [event.kind for sample in samples for event in sample.events]
    assert kinds[0] == "started"
    assert kinds[-1] == "stopped"
    assert "reversed" in kinds
    last = samples[-1]
    assert last.velocity[0] == 0.0
    assert samples[-500].position[0] == last.position[0]
    load = mechanism(last.position[0])[2]
    assert abs(load) <= 15.0
    assert last.memory["friction_torque_nm"] == pytest.approx(-load, abs=1e-9)
    lost = M_S * G * (height(0.0) - height(last.position[0]))
    lost += (M_R * R - M_P * RP) * G * (0.0 - np.sin(last.position[0]))
    assert last.memory["friction_loss_j"] == pytest.approx(lost, rel=1e-9)


def test_release_is_at_the_instant_the_motor_overcomes_friction():
    """A supply that is ramped up: M(t) i eta - |load| = c."""
    overrides = {**KLOSS, "friction.coulomb_nm": 100.0, "supply.initial_fraction": 0.0, "supply.rate_per_s": 0.5}
    crank = machine("vibration_crank", overrides=overrides)
    started = next(event for frame in frames(crank, 1.0) for event in frame.linkage.events if event.kind == "started")
    load = mechanism(0.0)[2]
    torque = kloss(0.5 * started.time_s) * 9.6 * 0.95
    assert torque == pytest.approx(100.0 - load, rel=1e-9)


@pytest.mark.parametrize("efficiency", [0.95, 0.5])
def test_a_gear_never_creates_energy(efficiency):
    """Too weak to turn over: it stalls and swings, and the gear's loss only grows."""
    weak = {**KLOSS, "motor.rated_power_w": 400.0, "gear.efficiency": efficiency, "friction.coulomb_nm": 0.0}
    crank = machine("vibration_crank", overrides=weak)
    losses, kinds, slack = [0.0], [], []
    for frame in frames(crank, 3.0):
        losses.append(frame.linkage.memory["gear_loss_j"])
        kinds += [event.kind for event in frame.linkage.events]
        slack.append(abs(frame.linkage.residuals["energy_balance"]))
    assert "stalled" in kinds
    assert np.diff(losses).min() >= 0.0
    assert losses[-1] > 0.0
    assert max(slack) < 1e-10


@pytest.mark.parametrize("rotor", [0.03, 1e-4, 2e-5])
def test_motor_coupling_does_not_depend_on_the_step_however_light_the_rotor(rotor):
    """The electromechanical time constant falls to some 1e-7 s at the rotor; explicit coupling needs shorter steps."""
    overrides = {**KLOSS, "motor.rotor_inertia_kg_m2": rotor, "gear.efficiency": 1.0}
    shaft = rotor * 9.6**2

    def rates(_, y):
        inertia, slope, load = mechanism(y[0])
        moment = 9.6 * kloss(1.0 - 9.6 * y[1] / (50.0 * pi)) + load - 0.5 * slope * y[1] ** 2
        return [y[1], moment / (inertia + shaft)]

    run = solve_ivp(rates, (0.0, 1.0), [0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-12)
    for step in (0.002, 0.0005):
        last = list(frames(machine("vibration_crank", overrides={**overrides, "coupling.step_s": step}), 1.0))[-1]
        assert last.linkage.position[0] == pytest.approx(run.y[0, -1], abs=1e-7)


@pytest.mark.parametrize("speed", [150.0, -150.0])
def test_a_kloss_drive_runs_the_way_its_speed_says(speed):
    crank = machine("vibration_crank", overrides={**KLOSS, "drive.speed_rpm": speed})
    last = list(frames(crank, 1.5))[-1]
    assert last.linkage.velocity[0] * speed > 0.0
    assert abs(last.linkage.position[0]) > 4.0 * pi


def test_a_speed_changed_while_running_is_reached_at_the_promised_rate():
    fast = machine("vibration_crank", overrides={"drive.speed_rpm": 300.0})
    frame = list(frames(machine("vibration_crank"), 0.1))[-1]
    from mech_twin.engine.coupling import next_frame

    speeds = [frame.linkage.velocity[0]]
    for _ in range(400):
        frame = next_frame(fast, frame, 1.0)
        speeds.append(frame.linkage.velocity[0])
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-10
    assert np.abs(np.diff(speeds)).max() <= 2.0 * 10.0 * pi * 0.001 * (1.0 + 1e-6)
    assert speeds[-1] == pytest.approx(10.0 * pi)


def test_a_force_changed_while_running_is_booked_as_work():
    from mech_twin.engine.coupling import next_frame

    loaded = machine("vibration_crank", overrides={"working_force_n": 500.0})
    frame = list(frames(machine("vibration_crank"), 0.123))[-1]
    at = frame.linkage.position[0]
    for _ in range(50):
        frame = next_frame(loaded, frame, 1.0)
        assert abs(frame.linkage.residuals["energy_balance"]) < 1e-10
    assert frame.linkage.memory["adjustment_work_j"] == pytest.approx(500.0 * height(at), rel=1e-12)


def test_a_machine_at_rest_starts_held_by_its_friction_and_whole():
    """The load at th = 0 is carried by the shaft's friction as far as that reaches, and the drive by nothing yet."""
    load = mechanism(0.0)[2]
    for coulomb, held in ((2.0 * abs(load), -load), (0.4 * abs(load), -0.4 * load)):
        linkage = machine("vibration_crank", overrides={**KLOSS, "friction.coulomb_nm": coulomb}).linkage
        start = linkage.start()
        assert start.memory["friction_torque_nm"] == pytest.approx(held, rel=1e-12)
        memory = start.memory.as_dict()
        assert {name: memory[name] for name in ("stalled_1", "load_share", "turned_back_rad", "turning_sense")} == {
            "stalled_1": 0.0,
            "load_share": 1.0,
            "turned_back_rad": 0.0,
            "turning_sense": 0.0,
        }
    turning = machine("vibration_crank").linkage.start()
    assert turning.memory["friction_torque_nm"] == 0.0
    assert turning.memory["turning_sense"] == 1.0


def test_a_shaft_nothing_is_said_of_has_no_friction():
    assert ShaftFriction() == (0.0, 0.0)


def test_motion_is_as_exact_at_a_coupling_step_of_a_fifth_of_a_turn():
    """The error of the integration is controlled within the step, however long that is."""
    torque, friction, seconds = 150.0, (10.0, 2.0), 2.0
    th, w = reference(torque, friction, seconds)
    last = under_constant_torque(torque, friction, seconds, step=0.05)[-1]
    assert w * 0.05 > 0.2 * 2.0 * pi
    assert last.position[0] == pytest.approx(th, abs=2e-8)
    assert last.velocity[0] == pytest.approx(w, abs=2e-7)


def test_a_long_step_books_its_work_from_every_phase():
    """The estimate of a quarter turn's error vanishes by chance at some phases, which a run of hours meets."""
    crank = machine("vibration_crank", overrides={"coupling.step_s": 0.0999})
    frame = complete_frame(crank, crank.linkage.start(), None, 1.0)
    linkage, worst = frame.linkage, 0.0
    for angle in np.linspace(0.0, 2.0 * np.pi, 2001):
        energy = mechanism_state(crank.linkage.mechanism, angle, linkage.velocity[0], 0.0, 0)[3]
        memory = CrankMemory(*linkage.memory.values)._replace(energy_j=energy, initial_energy_j=energy)
        at = linkage._replace(position=(angle, *linkage.position[1:]))
        after = crank.linkage.advance(at._replace(memory=Named(memory._fields, memory)), frame.motor, None)
        worst = max(worst, abs(after.residuals["energy_balance"]))
    assert 0.0 < worst < 2e-12


@pytest.mark.parametrize("drive", [{}, KLOSS], ids=["prescribed", "motor"])
def test_the_energy_balance_keeps_its_digits_after_very_many_turns(drive):
    crank = machine("vibration_crank", overrides={**drive, "coupling.step_s": 0.005, "supply.initial_fraction": 1.0})
    frame = complete_frame(crank, crank.linkage.start(), None, 1.0)
    turned = 2.0 * np.pi * 100_000
    far = frame.linkage._replace(position=(frame.linkage.position[0] + turned, *frame.linkage.position[1:]))
    energy = mechanism_state(crank.linkage.mechanism, far.position[0], far.velocity[0], 0.0, 0)[3]
    memory = CrankMemory(*far.memory.values)._replace(energy_j=energy, initial_energy_j=energy)
    frame = complete_frame(crank, far._replace(memory=Named(memory._fields, memory)), None, 1.0)
    for _ in range(2000):
        frame = next_frame(crank, frame, 1.0)
        assert abs(frame.linkage.residuals["energy_balance"]) < 2e-10
    assert frame.linkage.position[0] > turned

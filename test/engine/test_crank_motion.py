# SPDX-License-Identifier: Apache-2.0
"""A piece of motion ends where it says: rest, angle or span on the integrated motion itself."""

from __future__ import annotations

from math import cos, inf, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
import pytest

from mech_twin.engine.crank_motion import (
    AT_ANGLE,
    AT_REST,
    NOT_INTEGRATED,
    SPAN_ENDED,
    STATE_SIZE,
    TOO_MANY_STEPS,
    ShaftDrive,
    crank_rates,
    integrated_work,
    line_torque,
    shaft_state,
    turn_crank,
)
from mech_twin.engine.integration import rates_of, start_step, take_step, workspace
from mech_twin.engine.tableaus import DORMAND_PRINCE_8

FREE = ShaftDrive(0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, inf, 0.0, 0.0, 1.0)
EXACT, ANY = np.full(STATE_SIZE, 1e-12), np.full(STATE_SIZE, 1e12)


class Disc(NamedTuple):
    """A disc (kg m2) on a spring-like moment -k sin f (N m), turned by a shaft drive."""

    drive: ShaftDrive
    inertia_kg_m2: float
    stiffness_nm: float


@rates_of(Disc, DORMAND_PRINCE_8)
def disc_rates(disc, t, y, out):
    """Fill the rates of a disc."""
    crank_rates(disc.drive, t, y, disc.inertia_kg_m2, 0.0, -disc.stiffness_nm * np.sin(shaft_state(y).angle_rad), out)


class Eccentric(NamedTuple):
    """A mechanism of inertia I0 + I1 cos f (kg m2) at the crank, turned by a shaft drive, under no moment."""

    drive: ShaftDrive
    mean_kg_m2: float
    swing_kg_m2: float


@rates_of(Eccentric, DORMAND_PRINCE_8)
def eccentric_rates(system, t, y, out):
    """Fill the rates of a mechanism of changing inertia."""
    angle, swing = shaft_state(y).angle_rad, system.swing_kg_m2
    crank_rates(system.drive, t, y, system.mean_kg_m2 + swing * np.cos(angle), -swing * np.sin(angle), 0.0, out)


def turned(disc, speed, span, direction=1.0, aim=inf, tolerance=EXACT, angle=0.0):
    y = np.array([angle, speed, 0.0, 0.0, 0.0])
    time, what, acceleration = turn_crank(disc, 0.0, y, span, direction, aim, tolerance)
    return y, time, what, acceleration


def test_what_ends_a_motion_can_be_told_apart():
    assert len({SPAN_ENDED, AT_REST, AT_ANGLE, NOT_INTEGRATED, TOO_MANY_STEPS}) == 5


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_disc_under_a_ramped_torque_follows_the_cubic(direction):
    """J w' = i eta (M + M' t) - c: angle, speed and works in closed form, the gear's loss too."""
    drive = FREE._replace(
        shaft_inertia_kg_m2=0.4, ratio=3.0, efficiency=0.8, torque_nm=2.0 * direction, time_slope=5.0 * direction,
        coulomb_nm=1.5, direction=direction,
    )  # fmt: skip
    t, inertia = 0.7, 0.6 + 0.4
    y, time, what, acceleration = turned(Disc(drive, 0.6, 0.0), 0.5 * direction, t, direction, direction * inf)
    constant, ramp = (3.0 * 0.8 * 2.0 - 1.5) / inertia, 3.0 * 0.8 * 5.0 / inertia
    speed = 0.5 + constant * t + 0.5 * ramp * t * t
    angle = 0.5 * t + 0.5 * constant * t * t + ramp * t**3 / 6.0
    assert (time, what) == (t, SPAN_ENDED)
    assert direction * acceleration == pytest.approx(constant + ramp * t, rel=1e-13)
    assert direction * shaft_state(y).speed_rad_per_s == pytest.approx(speed, rel=1e-13)
    assert direction * shaft_state(y).angle_rad == pytest.approx(angle, rel=1e-13)
    assert shaft_state(y).friction_loss_j == pytest.approx(1.5 * angle, rel=1e-13)
    # the gear gives 0.8 of what it takes: the rest is lost; what it gives turns the shaft's inertia and the disc
    assert shaft_state(y).gear_loss_j == pytest.approx(
        0.25 * (1.5 * angle + 0.5 * inertia * (speed**2 - 0.25)), rel=1e-12
    )
    assert shaft_state(y).drive_work_j == pytest.approx(1.5 * angle + 0.5 * 0.6 * (speed**2 - 0.25), rel=1e-12)


@pytest.mark.parametrize("tolerance", [EXACT, ANY], ids=["small steps", "one step"])
def test_a_motion_that_begins_late_in_the_coupling_step_has_the_torque_of_then(tolerance):
    begin, span, drive = 0.4, 0.3, FREE._replace(torque_nm=2.0, time_slope=5.0)
    y = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    time, what, acceleration = turn_crank(Disc(drive, 2.0, 0.0), begin, y, span, 1.0, inf, tolerance)
    gained = (2.0 * span + 2.5 * ((begin + span) ** 2 - begin**2)) / 2.0
    assert (time, what) == (span, SPAN_ENDED)
    assert shaft_state(y).speed_rad_per_s == pytest.approx(1.0 + gained, rel=1e-13)
    assert acceleration == pytest.approx((2.0 + 5.0 * (begin + span)) / 2.0, rel=1e-13)
    assert shaft_state(y).drive_work_j == pytest.approx((1.0 + gained) ** 2 - 1.0, rel=1e-12)


def test_torque_falls_with_speed_rises_with_time_and_stays_within_its_limit():
    drive = FREE._replace(ratio=3.0, torque_nm=2.0, speed_slope=-0.5, time_slope=4.0, speed=10.0, torque_limit_nm=6.0)
    assert line_torque(drive, 0.0, 10.0) == 2.0
    assert line_torque(drive, 0.25, 10.0) == 3.0
    assert line_torque(drive, 0.0, 11.0) == 0.5
    assert (line_torque(drive, 100.0, 10.0), line_torque(drive, 0.0, 100.0)) == (6.0, -6.0)


@pytest.mark.parametrize("tolerance", [EXACT, ANY], ids=["small steps", "one step"])
@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("aim", [None, 0.35])
def test_what_ends_a_motion_lies_on_the_integrated_motion_itself(tolerance, direction, aim):
    """Not on its interpolant: the same step taken again to that time ends at rest, or at the angle."""
    disc = Disc(FREE._replace(direction=direction), 1.0, 4.0)
    wanted = inf if aim is None else aim
    y, time, what, _ = turned(disc, 1.3 * direction, 1.2, direction, direction * wanted, tolerance)
    assert what == (AT_REST if aim is None else AT_ANGLE)
    assert (shaft_state(y).speed_rad_per_s == 0.0) if aim is None else (shaft_state(y).angle_rad == direction * aim)
    if tolerance is ANY:
        begin, work = np.array([0.0, 1.3 * direction, 0.0, 0.0, 0.0]), workspace(DORMAND_PRINCE_8, STATE_SIZE)
        start_step(disc, 0.0, begin, work)
        take_step(disc, 0.0, begin, time, work)
        end = shaft_state(work.end)
        assert abs(end.speed_rad_per_s if aim is None else end.angle_rad - direction * aim) < 1e-14
    else:  # w^2/2 = w0^2/2 - k (1 - cos f)
        left = 1.3**2 / 2.0 - 4.0 * (1.0 - cos(shaft_state(y).angle_rad)) - shaft_state(y).speed_rad_per_s ** 2 / 2.0
        assert abs(left) < 1e-11


@pytest.mark.parametrize("speed", [6.0, -6.0])
def test_a_mechanism_of_changing_inertia_left_to_itself_keeps_its_energy(speed):
    """I(f) w^2/2 is constant: it turns slower where its inertia is larger."""
    direction = 1.0 if speed > 0.0 else -1.0
    y, _, what, _ = turned(
        Eccentric(FREE._replace(direction=direction), 2.0, 1.5), speed, 0.4, direction, aim=inf * direction
    )
    end = shaft_state(y)
    assert what == SPAN_ENDED
    assert 2.0 < abs(end.angle_rad) < 4.0
    assert end.speed_rad_per_s**2 * (2.0 + 1.5 * cos(end.angle_rad)) == pytest.approx(36.0 * 3.5, rel=1e-11)


def test_a_disc_braked_by_friction_rests_when_its_momentum_is_used_up():
    disc = Disc(FREE._replace(coulomb_nm=2.0), 4.0, 0.0)
    y, time, what, acceleration = turned(disc, 3.0, 100.0)
    assert (what, shaft_state(y).speed_rad_per_s) == (AT_REST, 0.0)
    assert time == pytest.approx(6.0, rel=1e-13)
    assert shaft_state(y).angle_rad == pytest.approx(9.0, rel=1e-13)
    assert acceleration == pytest.approx(-0.5, rel=1e-13)


@pytest.mark.parametrize("nearer", ["rest", "angle"])
def test_of_rest_and_angle_in_one_step_the_earlier_ends_the_motion(nearer):
    """Thrown up at 2 m/s, say, it turns back at 1 rad; an aim below that is met on the way, one above never."""
    disc = Disc(FREE._replace(coulomb_nm=2.0), 1.0, 0.0)
    aim = 1.0 + 1e-9 if nearer == "rest" else 1.0 - 1e-9
    y, time, what, _ = turned(disc, 2.0, 10.0, aim=aim, tolerance=ANY)
    assert what == (AT_REST if nearer == "rest" else AT_ANGLE)
    assert shaft_state(y).angle_rad == pytest.approx(min(aim, 1.0), abs=1e-14)
    assert time == pytest.approx(1.0 if nearer == "rest" else 1.0 - sqrt(1e-9), abs=1e-9)


def test_a_full_swing_takes_the_time_of_the_pendulum():
    """T/4 = K(sin(a/2)) sqrt(J/k), by the arithmetic and geometric mean."""
    a, b = 1.0, cos(0.5)  # amplitude 1 rad
    for _ in range(8):
        a, b = 0.5 * (a + b), sqrt(a * b)
    speed = 2.0 * 2.0 * sin(0.5)
    _, time, what, acceleration = turned(Disc(FREE, 1.0, 4.0), speed, 10.0)
    assert what == AT_REST
    assert time == pytest.approx(0.5 * pi / a / 2.0, rel=1e-11)
    assert acceleration == pytest.approx(-4.0 * sin(1.0), rel=1e-11)


def test_a_motion_that_is_no_number_is_said_to_be_not_integrated():
    _, time, what, _ = turned(Disc(FREE, float("nan"), 4.0), 1.0, 1.0)
    assert what == NOT_INTEGRATED
    assert time < 1e-9


def test_a_motion_of_more_steps_than_a_piece_may_have_is_told_apart_from_one_without_a_number():
    """At a million rad/s against a moment of every turn a second takes some hundred thousand steps."""
    _, time, what, _ = turned(Disc(FREE, 1.0, 4.0), 1e6, 1.0)
    assert what == TOO_MANY_STEPS
    assert 0.0 < time < 1.0


class Power(NamedTuple):
    """A power (W) that swings with time."""

    amplitude_w: float


@rates_of(Power, DORMAND_PRINCE_8)
def power_rates(system, t, y, out):
    """Fill the power."""
    out[0] = system.amplitude_w * np.cos(t)


@pytest.mark.parametrize("span", [1e-3, 20.0])
def test_work_of_a_power_is_its_integral_over_the_span_and_no_more(span):
    assert integrated_work(Power(3.0), span, 1e-13, 0.1) == pytest.approx(3.0 * sin(span), abs=1e-11)


def test_work_of_a_power_that_is_no_number_is_none():
    assert np.isnan(integrated_work(Power(float("nan")), 1.0, 1e-13, 0.1))

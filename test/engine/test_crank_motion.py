# SPDX-License-Identifier: Apache-2.0
"""A crank between two samples: speed, works, rest and load boundary against closed forms."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
import pytest
from work_arrays import room_for

from mech_twin.engine import crank_state
from mech_twin.engine.compiled_steps import step_of
from mech_twin.engine.crank_linkage import TurnedCrank
from mech_twin.engine.crank_motion import (
    ANGLE,
    DRIVE_WORK,
    FRICTION_LOSS,
    GEAR_LOSS,
    KINDS,
    SPEED,
    STATE_SIZE,
    STOPPED,
    TurningCrank,
)
from mech_twin.engine.crank_state import NO_MOTOR, Crank, ShaftDrive, ShaftFriction, Transmission, crank_drive
from mech_twin.engine.hybrid.laws import regime_of
from mech_twin.engine.hybrid.loop import TOO_LONG, UNSTEADY, advance
from mech_twin.engine.hybrid.type_erasure import declared
from mech_twin.engine.sample_vectors import KIND, TIME
from mech_twin.kernels.kernel import kernel
from mech_twin.parts.induction_motor import supplied_motor

pytestmark = pytest.mark.slow  # kernels of its own are compiled

FREE = ShaftDrive(0.0, 1.0, 1.0, supplied_motor(NO_MOTOR, 0.0), 0.0, 0.0, 0.0)
BOUNDARY = len(KINDS)


class Disc(NamedTuple):
    """An inertia I0 + I1 cos f (kg m2) under a moment -k sin f (N m)."""

    mean_kg_m2: float
    swing_kg_m2: float
    stiffness_nm: float


@step_of(crank_state.mechanism_reduced, Disc)
def reduced(disc, f, regime):
    """Return inertia, its slope and the moment."""
    swing = disc.swing_kg_m2
    return disc.mean_kg_m2 + swing * np.cos(f), -swing * np.sin(f), -disc.stiffness_nm * np.sin(f)


@step_of(crank_state.mechanism_state, Disc)
def state(disc, f, w, e, regime):
    """Return the crank, torque and energy."""
    inertia, slope, moment = reduced(disc, f, regime)
    energy = 0.5 * inertia * w * w - disc.stiffness_nm * np.cos(f)
    return (f,), (w,), inertia * e + 0.5 * slope * w * w - moment, energy, 0.0


@step_of(crank_state.mechanism_load_work, Disc)
def load_work(disc, before, after, regime):
    """Return that there is no load."""
    return 0.0


@step_of(crank_state.mechanism_load_speed, Disc)
def load_speed(disc, f, w):
    """Return the rim's speed at 1 m."""
    return w


@step_of(crank_state.mechanism_drive_moment, Disc)
def drive_moment(disc, f, w, e, regime):
    """Return the torque at the crank."""
    return state(disc, f, w, e, regime)[2]


@kernel
def advanced(model, drive, y, regimes, span, tolerance, log):
    """Return the number of events over a span."""
    kept = np.zeros(6)
    kept[0] = y[0]
    motion, room = TurningCrank(model, drive, 0.0, 0.0, kept), room_for(1, 1, 1, STATE_SIZE)
    room.tolerance[:] = tolerance
    return advance(declared(motion, room.at), 0.0, span, y, regimes, room, log, 0)


def turned(disc, drive, speed, span, tolerance=1e-12, boundaries=()):
    """Return the state after a span, and time and kind of each event."""
    rows = np.array(boundaries, dtype=float).reshape(len(boundaries), 5)
    friction = ShaftFriction(drive.coulomb_nm, drive.viscous_nms_per_rad)
    crank = Crank(span, 0.0, rows, crank_drive(Transmission(1.0, 1.0, 0.0)), friction, np.zeros((0, 3)), 0.0)
    y, log = np.array([0.0, speed, 0.0, 0.0, 0.0]), np.zeros((40, 20))
    regimes = np.array([regime_of(float(np.sign(speed))), 0], dtype=np.int64)
    count = advanced(TurnedCrank(crank, Disc(*map(float, disc))), drive, y, regimes, span, tolerance, log)
    return y, count, [(row[TIME], int(row[KIND])) for row in log[: max(count, 0)]]


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_disc_under_a_constant_torque_follows_the_square(direction):
    """J w' = i eta M - c: angle, speed and works in closed form, the gear's loss too."""
    drive = FREE._replace(
        shaft_inertia_kg_m2=0.4, ratio=3.0, efficiency=0.8, coulomb_nm=1.5,
        motor=supplied_motor(NO_MOTOR, 0.0, 2.0 * direction),
    )  # fmt: skip
    t, inertia = 0.7, 0.6 + 0.4
    y, count, _ = turned((0.6, 0.0, 0.0), drive, 0.5 * direction, t)
    constant = (3.0 * 0.8 * 2.0 - 1.5) / inertia
    speed = 0.5 + constant * t
    angle = 0.5 * t + 0.5 * constant * t * t
    assert count == 0
    assert direction * y[SPEED] == pytest.approx(speed, rel=1e-13)
    assert direction * y[ANGLE] == pytest.approx(angle, rel=1e-13)
    assert y[FRICTION_LOSS] == pytest.approx(1.5 * angle, rel=1e-13)
    # the gear gives 0.8 of what it takes: the rest is lost; what it gives turns the shaft's inertia and the disc
    assert y[GEAR_LOSS] == pytest.approx(0.25 * (1.5 * angle + 0.5 * inertia * (speed**2 - 0.25)), rel=1e-12)
    assert y[DRIVE_WORK] == pytest.approx(1.5 * angle + 0.5 * 0.6 * (speed**2 - 0.25), rel=1e-12)


@pytest.mark.parametrize("speed", [6.0, -6.0])
def test_a_mechanism_of_changing_inertia_left_to_itself_keeps_its_energy(speed):
    """I(f) w^2/2 is constant: it turns slower where its inertia is larger."""
    y, _, _ = turned((2.0, 1.5, 0.0), FREE, speed, 0.4)
    assert 2.0 < abs(y[ANGLE]) < 4.0
    assert y[SPEED] ** 2 * (2.0 + 1.5 * cos(y[ANGLE])) == pytest.approx(36.0 * 3.5, rel=1e-11)


def test_a_disc_braked_by_friction_rests_when_its_momentum_is_used_up_and_stays():
    y, _, events = turned((4.0, 0.0, 0.0), FREE._replace(coulomb_nm=2.0), 3.0, 100.0)
    assert events == [(pytest.approx(6.0, rel=1e-13), STOPPED)]
    assert y[SPEED] == 0.0
    assert y[ANGLE] == pytest.approx(9.0, rel=1e-13)


@pytest.mark.parametrize("tolerance", [1e-12, 1e12], ids=["small steps", "one step"])
@pytest.mark.parametrize("nearer", ["rest", "boundary"])
def test_of_rest_and_boundary_in_one_step_the_earlier_comes_first(nearer, tolerance):
    """Braked from 2 rad/s it rests at 1 rad; a boundary below that is met on the way, one above never."""
    aim = 1.0 + 1e-9 if nearer == "rest" else 1.0 - 1e-9
    drive = FREE._replace(coulomb_nm=2.0)
    y, _, events = turned((1.0, 0.0, 0.0), drive, 2.0, 10.0, tolerance, [(aim, 1.0, 0, 1, BOUNDARY)])
    rest = (pytest.approx(1.0, abs=1e-9), STOPPED)
    met = (pytest.approx(1.0 - sqrt(1e-9), abs=1e-9), BOUNDARY)
    assert events == ([rest] if nearer == "rest" else [met, rest])
    assert y[ANGLE] == pytest.approx(1.0, abs=1e-14)


def test_a_full_swing_takes_the_time_of_the_pendulum():
    """T/4 = K(sin(a/2)) sqrt(J/k), by the arithmetic and geometric mean."""
    a, b = 1.0, cos(0.5)  # amplitude 1 rad
    for _ in range(8):
        a, b = 0.5 * (a + b), sqrt(a * b)
    quarter = 0.5 * pi / a / 2.0
    y, _, _ = turned((1.0, 0.0, 4.0), FREE, 2.0 * 2.0 * sin(0.5), quarter)
    assert abs(y[SPEED]) < 1e-11 * quarter * 4.0 * sin(1.0)  # the time that is missing, by the acceleration there
    assert y[ANGLE] == pytest.approx(1.0, abs=1e-11)


def test_a_motion_that_is_no_number_ends_as_unsteady():
    assert turned((np.nan, 0.0, 4.0), FREE, 1.0, 1.0)[1] == UNSTEADY


def test_a_motion_of_more_steps_than_a_piece_may_have_is_told_apart_from_one_without_a_number():
    """At a million rad/s against a moment of every turn a second takes some hundred thousand steps."""
    assert turned((1.0, 0.0, 4.0), FREE, 1e6, 1.0)[1] == TOO_LONG

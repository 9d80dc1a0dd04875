# SPDX-License-Identifier: Apache-2.0
"""A slider-crank whose slider has clearance in its guide: four stops at once, a bearing with friction, free flight.

Parameters and start: P. Flores, R. Leine, C. Glocker, Modeling and analysis of planar rigid multibody systems with
translational clearance joints based on the non-smooth dynamics approach, Multibody System Dynamics 23 (2010), 165-190.
The free flight is printed in the reference file of Siconos' example SliderCrank (projected Moreau-Jean, 0.1 ms).
Contacts follow a second implementation here: Moreau's time stepping, which knows no events.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest
from work_arrays import room_for

from mech_twin.engine.hybrid import laws
from mech_twin.engine.hybrid.laws import HOLD, LOW, OPEN
from mech_twin.engine.hybrid.loop import advance
from mech_twin.engine.hybrid.type_erasure import declared
from mech_twin.kernels.kernel import kernel

CRANK_M, ROD_M, HALF_LENGTH_M, HALF_HEIGHT_M, CLEARANCE_M = 0.153, 0.306, 0.05, 0.025, 0.001
CRANK_KG, ROD_KG, SLIDER_KG = 0.038, 0.038, 0.076
CRANK_KGM2, ROD_KGM2, SLIDER_KGM2 = 7.4e-5, 5.9e-4, 2.7e-6
G = 9.81
START, START_SPEED = (0.0, 0.0, 0.0), (150.0, -75.0, 0.0)
SIDE, END = (1.0, 1.0, -1.0, -1.0), (-1.0, 1.0, -1.0, 1.0)  # of the four corners: upper or lower, rear or front
BEARING = 4  # law of the crank's bearing, after the corners


class Slider(NamedTuple):
    """Restitution of the corners, Coulomb friction of the crank's bearing (N m)."""

    restitution: float
    friction_nm: float


@laws.declares(laws.evaluate, Slider)
def evaluate_slider(system, t, y, regimes, at):
    """Fill in crank, rod and slider, all angles from the line of the guide, and their laws."""
    crank, rod, tilt = y[0], y[1], y[2]
    both = (0.5 * ROD_KG + SLIDER_KG) * CRANK_M * ROD_M
    at.mass[0, 0] = CRANK_KGM2 + (0.25 * CRANK_KG + ROD_KG + SLIDER_KG) * CRANK_M**2
    at.mass[1, 1] = ROD_KGM2 + (0.25 * ROD_KG + SLIDER_KG) * ROD_M**2
    at.mass[0, 1] = at.mass[1, 0] = both * math.cos(crank - rod)
    at.mass[2, 2] = SLIDER_KGM2
    at.force[0] = -both * math.sin(crank - rod) * y[4] ** 2
    at.force[0] -= (0.5 * CRANK_KG + ROD_KG + SLIDER_KG) * G * CRANK_M * math.cos(crank)
    at.force[1] = both * math.sin(crank - rod) * y[3] ** 2 - (0.5 * ROD_KG + SLIDER_KG) * G * ROD_M * math.cos(rod)
    at.force[2] = 0.0
    height = CRANK_M * math.sin(crank) + ROD_M * math.sin(rod)
    for i in range(4):
        side, end = SIDE[i], END[i]
        corner = height + end * HALF_LENGTH_M * math.sin(tilt) + side * HALF_HEIGHT_M * math.cos(tilt)
        at.gap[i] = HALF_HEIGHT_M + CLEARANCE_M - side * corner
        at.directions[i, 0], at.directions[i, 1] = -side * CRANK_M * math.cos(crank), -side * ROD_M * math.cos(rod)
        at.directions[i, 2] = -side * end * HALF_LENGTH_M * math.cos(tilt) + HALF_HEIGHT_M * math.sin(tilt)
        at.bias[i] = side * (CRANK_M * math.sin(crank) * y[3] ** 2 + ROD_M * math.sin(rod) * y[4] ** 2)
        at.bias[i] += (side * end * HALF_LENGTH_M * math.sin(tilt) + HALF_HEIGHT_M * math.cos(tilt)) * y[5] ** 2
        at.low[i], at.high[i], at.restitution[i] = 0.0, math.inf, system.restitution
    at.directions[BEARING, 0] = 1.0
    at.low[BEARING], at.high[BEARING] = -system.friction_nm, system.friction_nm


@laws.declares(laws.accumulate, Slider)
def accumulate_work(system, t, y, regimes, at, out):
    """Fill in the power of the bearing's friction."""
    out[6] = at.multiplier[BEARING] * y[3]


@laws.declares(laws.fill_signals, Slider)
def no_signals(system, t, y, regimes, at, values, rates):
    """Fill in nothing."""


@laws.declares(laws.begin_piece, Slider)
def begin_nothing(system, t, y, regimes):
    """Prepare nothing."""


@laws.declares(laws.end_piece, Slider)
def end_nothing(system, t, before, y, regimes):
    """Book nothing."""


@laws.declares(laws.pass_signal, Slider)
def pass_nothing(system, which, t, y, regimes, log, count):
    """Log nothing."""
    return count


@laws.declares(laws.change_regimes, Slider)
def log_holding(system, t, y, past, regimes, at, log, count):
    """Log how many corners are held, where that has changed."""
    before, after = 0, 0
    for i in range(4):
        before += 1 if past[i] == HOLD else 0
        after += 1 if regimes[i] == HOLD else 0
    if before == after:
        return count
    log[count, 0], log[count, 1], log[count, 2] = t, -1.0, after
    return count + 1


@laws.declares(laws.note_impact, Slider)
def log_impact(system, t, before, y, at, log, count):
    """Log each impulse, and what the impact took of the energy; velocities of one law have one restitution."""
    lost = 0.0
    for i in range(3):
        for k in range(3):
            lost += 0.5 * at.mass[i, k] * (before[3 + i] * before[3 + k] - y[3 + i] * y[3 + k])
    for i in range(4):
        if at.multiplier[i] != 0.0:
            log[count, 0], log[count, 1], log[count, 2], log[count, 3] = t, i, at.multiplier[i], lost
            count, lost = count + 1, 0.0
    return count


@kernel
def advance_slider(system, t, span, y, regimes, room, log):
    """Return the number of events of a step."""
    return advance(declared(system, room.at), t, span, y, regimes, room, log, 0)


def run(system, span, steps, start_speed=START_SPEED):
    """Return the state at every step, and the rows of the log."""
    y, regimes = np.array([*START, *start_speed, 0.0]), np.array([OPEN] * 4 + [LOW], dtype=np.int64)
    states, rows = [y.copy()], []
    for k in range(steps):
        room, log = room_for(3, 5, 0, 7), np.zeros((2000, 4))
        room.tolerance[:] = 1e-11
        count = advance_slider(system, k * span / steps, span / steps, y, regimes, room, log)
        assert count >= 0, f"failed with {count}"
        states.append(y.copy())
        rows.append(log[:count].copy())
    return np.array(states), np.concatenate(rows)


def evaluated(q, u):
    """Return mass, forces, directions and gaps by central differences of the bodies' places: no law of `evaluate`."""

    def places(q):
        crank, rod, tilt = q
        pin = CRANK_M * np.array([math.cos(crank), math.sin(crank)])
        end = pin + ROD_M * np.array([math.cos(rod), math.sin(rod)])
        return 0.5 * pin, 0.5 * (pin + end), end, tilt

    def jacobians(q):
        columns = []
        for k in range(3):
            step = np.zeros(3)
            step[k] = 1e-5
            columns.append([(a - b) / 2e-5 for a, b in zip(places(q + step)[:3], places(q - step)[:3], strict=True)])
        return [np.array([column[body] for column in columns]).T for body in range(3)]

    masses, inertias = (CRANK_KG, ROD_KG, SLIDER_KG), np.diag([CRANK_KGM2, ROD_KGM2, SLIDER_KGM2])
    now = jacobians(q)
    ahead, behind = jacobians(q + 1e-6 * u), jacobians(q - 1e-6 * u)
    mass = inertias + sum(m * j.T @ j for m, j in zip(masses, now, strict=True))
    force = np.zeros(3)
    for m, j, a, b in zip(masses, now, ahead, behind, strict=True):
        force += m * j.T @ (np.array([0.0, -G]) - (a - b) @ u / 2e-6)
    height, tilt = places(q)[2][1], q[2]
    gaps, directions = [], []
    for side, end in zip(SIDE, END, strict=True):
        arm = end * HALF_LENGTH_M * math.sin(tilt) + side * HALF_HEIGHT_M * math.cos(tilt)
        turn = end * HALF_LENGTH_M * math.cos(tilt) - side * HALF_HEIGHT_M * math.sin(tilt)
        gaps.append(HALF_HEIGHT_M + CLEARANCE_M - side * (height + arm))
        directions.append(-side * (now[2][1] + np.array([0.0, 0.0, turn])))
    return mass, force, np.array(directions), np.array(gaps)


def complementary(matrix, free):
    """Return P >= 0 with matrix P + free >= 0 and P (matrix P + free) = 0, by trying every set of pressing contacts."""
    m = len(free)
    for pressing in itertools.chain.from_iterable(itertools.combinations(range(m), k) for k in range(m + 1)):
        impulse, held = np.zeros(m), list(pressing)
        if held:
            impulse[held] = np.linalg.lstsq(matrix[np.ix_(held, held)], -free[held], rcond=None)[0]
        if np.all(impulse >= -1e-15) and np.all(matrix @ impulse + free >= -1e-9 * (1.0 + np.abs(free).max())):
            return impulse
    raise AssertionError("no solution")


def stepped(system, span, steps, start_speed):
    """Return the final state by Moreau's time stepping: gaps at the middle of each step."""
    q, u, h = np.array(START), np.array(start_speed), span / steps
    for _ in range(steps):
        middle = q + 0.5 * h * u
        mass, force, directions, gaps = evaluated(middle, u)
        force[0] -= system.friction_nm * math.copysign(1.0, u[0])
        mass, force, directions, gaps = evaluated(middle, u + 0.5 * h * np.linalg.solve(mass, force))
        force[0] -= system.friction_nm * math.copysign(1.0, u[0])
        after = u + h * np.linalg.solve(mass, force)
        closed = np.flatnonzero(gaps <= 0.0)
        if len(closed):
            w = directions[closed]
            free = w @ after + system.restitution * np.minimum(w @ u, 0.0)
            impulse = complementary(w @ np.linalg.solve(mass, w.T), free)
            after += np.linalg.solve(mass, w.T @ impulse)
        q, u = middle + 0.5 * h * after, after
    return np.concatenate([q, u])


def energy(state):
    """Return kinetic and potential energy."""
    q, u = state[:3], state[3:6]
    mass = evaluated(q, u)[0]
    height = CRANK_M * math.sin(q[0]) * (0.5 * CRANK_KG + ROD_KG + SLIDER_KG)
    return 0.5 * u @ mass @ u + G * (height + ROD_M * math.sin(q[1]) * (0.5 * ROD_KG + SLIDER_KG))


def flown(span, steps):
    """Return the state after free flight by the scheme of the reference: half implicit, the mass at a step's end."""
    q, u, h = np.array(START), np.array(START_SPEED), span / steps
    for _ in range(steps):
        before, after = evaluated(q, u)[1], u
        for _ in range(8):
            mass, force, _, _ = evaluated(q + 0.5 * h * (u + after), after)
            after = u + 0.5 * h * np.linalg.solve(mass, before + force)
        q, u = q + 0.5 * h * (u + after), after
    return np.concatenate([q, u])


@pytest.mark.slow
def test_its_free_flight_is_that_of_the_published_reference():
    """At 2 ms, before the first impact: angles of crank and rod (rad), their rates; its scheme is of first order."""
    printed = [2.0 * math.pi * 0.04393614652195465, -0.1351018528775760, 120.8242092110994, -56.68029347554309]
    known = [0, 1, 3, 4]
    np.testing.assert_allclose(flown(2e-3, 20)[known], printed, rtol=1e-4)
    states, rows = run(Slider(0.4, 0.0), 2e-3, 20)
    assert not len(rows)
    assert states[-1, 2] == states[-1, 5] == 0.0
    coarse, fine = flown(2e-3, 400)[known], flown(2e-3, 800)[known]
    np.testing.assert_allclose(states[-1, known], 2.0 * fine - coarse, rtol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("restitution", "friction_nm", "tilt_rate", "impacts", "held", "within"),
    [
        (0.0, 0.0, 0.0, 2, 2, 1e-4),  # both upper corners at once, and both stay
        (0.4, 0.0, 0.0, 6, 0, 1e-4),
        (0.4, 2.0, 0.0, 4, 0, 1e-4),  # under a bearing that takes a fifth of the energy
        (0.0, 0.0, -30.0, 3, 2, 1e-4),  # one corner stays, then the other strikes
        (0.4, 0.0, 20.0, 20, 2, 0.02),  # they rattle by turns to rest, which a time step follows roughly
    ],
)
def test_its_contacts_are_those_of_moreaus_time_stepping(restitution, friction_nm, tilt_rate, impacts, held, within):
    """Over 8 ms corners strike together or one after the other, bounce or stay, while friction slides at the crank."""
    system, span, speed = Slider(restitution, friction_nm), 8e-3, (*START_SPEED[:2], tilt_rate)
    states, rows = run(system, span, 16, speed)
    struck, scale = rows[rows[:, 1] >= 0.0], np.array([1.0, 1.0, 1.0, 150.0, 150.0, 150.0])
    coarse, fine = (np.abs((stepped(system, span, n, speed) - states[-1, :6]) / scale).max() for n in (2000, 4000))
    assert fine < within
    assert fine < 0.7 * coarse
    assert set(struck[:, 1].astype(int)) == {0, 1}
    assert len(struck) == impacts
    assert rows[rows[:, 1] < 0.0, 2].max(initial=0.0) == held
    assert min(evaluated(state[:3], state[3:6])[3].min() for state in states) > -1e-11
    lost = energy(states[0]) - energy(states[-1])
    assert lost == pytest.approx(struck[:, 3].sum() - states[-1, 6], abs=1e-8)

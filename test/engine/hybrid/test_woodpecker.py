# SPDX-License-Identifier: Apache-2.0
"""The woodpecker toy: a sleeve that jams on its pole, a bird on a spring, a beak that strikes the pole.

Values and printed results: R. Leine, C. Glocker, D. van Campen, Nonlinear dynamics of the woodpecker toy, ASME
DETC2001/VIB-21608, after F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts, Wiley 1996.  Their cycle
(0.1452 s) is not compared: it has friction within impacts, where the law here gives none.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from engine.hybrid.linear_system import KIND, LAW, STRUCK, linear, run

from mech_twin.engine.hybrid.laws import HOLD, LOW, OPEN

pytestmark = pytest.mark.slow  # kernels of its own are compiled

SLEEVE_KG, SLEEVE_KGM2, BIRD_KG, BIRD_KGM2, SPRING_NM, G = 0.0003, 5e-9, 0.0045, 7e-7, 0.0056, 9.81
POLE_M, SLEEVE_M, HALF_SLEEVE_M = 0.0025, 0.0031, 0.0058  # radii, half height
ARM_M, BIRD_M, BEAK_UP_M, BEAK_BACK_M = 0.010, 0.015, 0.020, 0.0201
FRICTION, BEAK_RESTITUTION = 0.3, 0.5
JAMMED, HANGING = -(SLEEVE_M - POLE_M) / HALF_SLEEVE_M, -0.2216  # angles of sleeve and bird, the second printed
BEAK, LOWER, UPPER, SLIDE = range(4)


def toy(largest_friction_n):
    """Return the toy: height of the sleeve, its angle, the bird's; the friction of the sleeve has a constant bound."""
    both = BIRD_KG * BIRD_M
    mass = [
        [SLEEVE_KG + BIRD_KG, BIRD_KG * ARM_M, both],
        [BIRD_KG * ARM_M, SLEEVE_KGM2 + BIRD_KG * ARM_M**2, both * ARM_M],
        [both, both * ARM_M, BIRD_KGM2 + both * BIRD_M],
    ]
    stiffness = np.zeros((3, 3))
    stiffness[1:, 1:] = SPRING_NM * np.array([[1.0, -1.0], [-1.0, 1.0]])
    play = SLEEVE_M - POLE_M
    return linear(
        mass,
        [[0.0, 0.0, -BEAK_UP_M], [0.0, HALF_SLEEVE_M, 0.0], [0.0, -HALF_SLEEVE_M, 0.0], [1.0, SLEEVE_M, 0.0]],
        stiffness=stiffness,
        load=[-(SLEEVE_KG + BIRD_KG) * G, -BIRD_KG * G * ARM_M, -BIRD_KG * G * BIRD_M],
        gap=[ARM_M + BIRD_M - BEAK_BACK_M - POLE_M, play, play, 0.0],
        low=[0.0, 0.0, 0.0, -largest_friction_n],
        high=[math.inf, math.inf, math.inf, largest_friction_n],
        e=[BEAK_RESTITUTION, 0.0, 0.0, -1.0],
    )


def energy(system, y):
    """Return kinetic and potential energy of a state."""
    q, u = y[:3], y[3:6]
    return 0.5 * u @ system.mass @ u + 0.5 * q @ system.stiffness @ q - system.load @ q


def normal_force(bird):
    """Return the force of the pole on the lower end of the sleeve that holds both sleeve and bird still."""
    turning = BIRD_KG * G * ARM_M + SPRING_NM * (JAMMED - bird) - SLEEVE_M * (SLEEVE_KG + BIRD_KG) * G
    return turning / HALF_SLEEVE_M


@pytest.mark.parametrize(("friction", "jams"), [(FRICTION, True), (0.286, True), (0.284, False)])
def test_the_sleeve_jams_from_the_printed_friction_on(friction, jams):
    """Hanging backward at -0.2216 rad the toy stays where friction is 0.285 at least; else it slides down."""
    bird = JAMMED - BIRD_KG * G * BIRD_M / SPRING_NM
    assert bird == pytest.approx(HANGING, abs=1e-4)
    start = [0.0, JAMMED, bird], [0.0, 0.0, 0.0], [OPEN, HOLD, OPEN, HOLD]
    y, after, _ = run(toy(friction * normal_force(bird)), *start, 0.05, 5)
    assert (after[SLIDE] == HOLD) == jams
    assert (y[0] > -1e-15) == jams
    assert after[LOWER] == HOLD
    if jams:
        np.testing.assert_allclose(y[1:3], [JAMMED, bird], atol=1e-12)


def test_bird_and_sleeve_swing_against_each_other_in_free_fall_with_the_printed_frequency():
    """72.91 Hz: after a quarter of a period the spring is slack."""
    free = toy(0.0)._replace(gap=np.full(4, 10.0))
    y, _, _ = run(free, [0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [OPEN, OPEN, OPEN, LOW], 0.25 / 72.91)
    assert abs(y[2] - y[1]) < 0.1 * 0.5 * math.pi * 0.005 / 72.91  # the printed digits


def test_a_peck_takes_energy_and_lets_no_part_through_the_pole():
    """Beak and both ends of the sleeve strike, by turns and together, in a series with a limit, under friction."""
    system, y, regimes, kinds = toy(1.0), np.array([0.0, JAMMED, 0.0, 0.0, 0.0, 20.0]), [OPEN, HOLD, OPEN, HOLD], set()
    before, work = energy(system, y), 0.0
    for _ in range(40):
        y, regimes, rows = run(system, y[:3], y[3:6], regimes, 2e-3)
        kinds |= {int(row[LAW]) for row in rows if row[KIND] == STRUCK}
        assert (system.gap[:3] + (system.directions @ y[:3])[:3]).min() > -1e-12
        after = energy(system, y)
        assert after - before < y[6] + 1e-12  # the friction's work, and less by what the impacts take
        before, work = after, work + y[6]
    assert kinds == {BEAK, LOWER, UPPER}
    assert work < -1e-5

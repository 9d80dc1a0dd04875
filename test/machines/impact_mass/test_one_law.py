# SPDX-License-Identifier: Apache-2.0
"""The exact walk and the one loop obey one law: the same impacts, rests and releases, each found in its own way."""

from __future__ import annotations

import numpy as np
import pytest
from engine.hybrid.linear_system import IMPULSE, KIND, STRUCK, TIME, linear, run

from mech_twin.engine.hybrid.laws import HOLD, OPEN
from mech_twin.engine.hybrid.loop import SHORTEST_SERIES_S
from mech_twin.machines.impact_mass.dynamics import (
    CHATTER_END,
    IMPACT,
    PHASE_CHANGE,
    STUCK,
    impact_system,
    initial_motion,
    next_event,
    phase_end,
)

PHASES, MASS_KG = 8, 3.0
SERIES_S = 1e-8  # of an endless series that is compared impact by impact up to this time before its limit


def walked(motion, system):
    """Return the impacts of a phase (tau, impulse per mass), its whole impulse, what comes after, and if it rested."""
    impacts, impulse, rested = [], 0.0, motion.mode == STUCK
    while True:
        event, after = next_event(motion, system)
        if event.kind == PHASE_CHANGE:
            return np.array(impacts).reshape(-1, 2), impulse, after, rested
        if event.kind == IMPACT:
            impacts.append((event.tau_s, event.impulse_per_mass))
        impulse += event.impulse_per_mass
        rested = event.kind == CHATTER_END or (rested and after.mode == STUCK)
        motion = after


def compared(seed):
    """Hold both to each other over some phases of a random mass; return how many impacts and how many rests."""
    rng = np.random.default_rng(seed)
    period_s, share, restitution = rng.uniform(0.2, 0.6), rng.uniform(0.3, 0.7), rng.uniform(0.1, 0.6)
    toward, away = rng.uniform(20.0, 80.0), -rng.uniform(2.0, 10.0)
    system = impact_system((period_s, share * period_s), (toward, away), restitution, 0.0)
    motion, struck, rests = initial_motion(0.2, rng.uniform(-1.0, 1.0), system), 0, 0
    for _ in range(PHASES):
        end_s, begin_s = phase_end(motion, system), motion.tau_s
        a = toward if end_s == system.phase1_s else away
        mass = linear([MASS_KG], [[1.0]], load=[-MASS_KG * a], e=[restitution])
        regime = HOLD if motion.mode == STUCK and a > 0.0 else OPEN
        y, regimes, rows = run(mass, [motion.gap_m], [-motion.velocity_m_per_s], [regime], end_s - begin_s)
        impacts, impulse, motion, rested = walked(motion, system)
        found = rows[rows[:, KIND] == STRUCK]
        left_s = 2.0 * restitution * impacts[:, 1] / (1.0 + restitution) / max(a, 1e-9) / (1.0 - restitution)
        listed = int(np.sum(left_s > SERIES_S)) if rested else len(impacts)
        np.testing.assert_allclose(begin_s + found[:listed, TIME], impacts[:listed, 0], rtol=0, atol=1e-11)
        np.testing.assert_allclose(found[:listed, IMPULSE], MASS_KG * impacts[:listed, 1], rtol=1e-6)
        cut_ns = MASS_KG * abs(a) * SHORTEST_SERIES_S  # what the force gives in the time that the loop leaves out
        assert found[:, IMPULSE].sum() == pytest.approx(MASS_KG * impulse, rel=1e-11, abs=cut_ns)
        assert (regimes[0] == HOLD) == (motion.gap_m == 0.0 and motion.velocity_m_per_s == 0.0)
        assert y[0] == pytest.approx(motion.gap_m, abs=1e-11)
        assert -y[1] == pytest.approx(motion.velocity_m_per_s, abs=1e-9)
        struck, rests = struck + listed, rests + rested
    return struck, rests


def test_impacts_rests_and_releases_are_those_of_the_law_that_all_machines_share():
    struck, rests = np.sum([compared(seed) for seed in range(12)], axis=0)
    assert struck > 100
    assert rests > 10

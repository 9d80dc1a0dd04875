# SPDX-License-Identifier: Apache-2.0
"""Steps in which no event is looked for have none; far from zero at both ends is not zero in between."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from roller_former_cases import parameters_for

from mech_twin.engine.events import NONE, Step, first_event
from mech_twin.engine.integration import Workspace, controlled_step, start_step
from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.dynamics import SIZE, Array, DriveLine, Former, Modes, state_array
from mech_twin.machines.roller_former.events import normalised_modes, stretch_from
from mech_twin.machines.roller_former.integration import happened_already, locate_event
from mech_twin.machines.roller_former.motion import (
    MOST_WATCHES,
    QUICKENS,
    SHAFT_TURNS,
    SLACKENS,
    FormerMotion,
    fill_watches,
    may_dip,
    something_happened,
)
from mech_twin.machines.roller_former.parameters import former_of

DRAWS = 20_000
LOOKED_FOR, FOUND, MISSED = range(3)


@kernel
def looked_for(former: Former, torque: DriveLine, modes: Modes, states: Array, spans: Array, counts: Array) -> int:
    """Count the steps in which events are looked for, found, and missed if they were not; return the last missed.

    Under load the stall threshold and the sign of the motor's torque count where a step ends beyond them: what touches
    them and goes back within a step leaves the motion as it is, to its tolerance.
    """
    sides, watches = np.empty(former.bank.offset_rad.size), np.zeros((MOST_WATCHES, 3), np.int64)
    work, end = Workspace(np.empty((16, SIZE)), np.empty(SIZE), np.empty(SIZE)), np.empty(SIZE)
    last = -1
    for row in range(spans.size):
        y = states[row]
        now = normalised_modes(former, torque, 0.0, y, modes)
        motion = FormerMotion(former, torque, stretch_from(former, 0.0, y, now, sides, np.inf, NONE), sides)
        if happened_already(motion, now, watches, 0.0, y) != NONE:
            continue
        start_step(motion, 0.0, y, work)
        h, _ = controlled_step(motion, 0.0, y, spans[row], former.tolerances, work)
        end[:] = work.end
        looked = something_happened(motion, now, y, h, end, h, work.rates)
        which, _ = first_event(Step(motion, 0.0, y, h, work), watches, fill_watches(motion, now, y, watches), end)
        counts[LOOKED_FOR] += looked
        counts[FOUND] += which != NONE
        touched = which != NONE and watches[which, 0] in (QUICKENS, SLACKENS, SHAFT_TURNS) and now.load_on
        if which != NONE and not looked and not touched:
            counts[MISSED] += 1
            last = row
    return last


def drawn_states(former: Former, rng: np.random.Generator) -> Array:
    """Return states at rest, creeping, about the speeds that matter, and anywhere, turning either way."""
    scales = former.scales
    sync = scales.crank_speed_rad_per_s
    states = np.zeros((DRAWS, SIZE))
    states[:, 0] = rng.uniform(-7.0, 7.0, DRAWS)
    states[:, 1] = scales.twist_rad * rng.normal(0.0, 1.0, DRAWS) * 10.0 ** rng.uniform(-6.0, 0.5, DRAWS)
    marks = np.array([0.0, 0.0, former.engage_speed_rad_per_s, former.slow_speed_rad_per_s, sync])
    speeds = rng.choice(marks, (2, DRAWS)) + sync * rng.normal(0.0, 1.0, (2, DRAWS)) * 10.0 ** rng.uniform(
        -7.0, 0.0, (2, DRAWS)
    )
    speeds[rng.random((2, DRAWS)) < 0.1] = 0.0
    together = rng.random(DRAWS) < 0.5  # crank and drive at much the same speed
    speeds[1, together] = speeds[0, together] * (1.0 + 1e-4 * rng.normal(0.0, 1.0, together.sum()))
    states[:, 2], states[:, 3] = speeds[0], speeds[1] - speeds[0]
    return states


@pytest.mark.parametrize("load_on", [True, False])
@pytest.mark.parametrize("coulomb_nm", [0.0, 300.0])
@pytest.mark.parametrize(("load", "gear_loss"), [("resist", "power"), ("reversing", "printed"), ("none", "power")])
def test_a_step_in_which_no_event_is_looked_for_has_none(
    load: str, gear_loss: str, coulomb_nm: float, load_on: bool
) -> None:
    """Held or running, either way, before the load and after, by the motor's own torque and by a line in time."""
    former = former_of(
        parameters_for(3, {"load": load, "drive.gear_loss": gear_loss, "friction.coulomb_nm": coulomb_nm})
    )
    rng, counts = np.random.default_rng([len(load), int(coulomb_nm), load_on]), np.zeros(3, np.int64)
    modes = Modes(1.0, 1.0, 1.0, load_on, 1.0 if load_on else 0.0, -1.0, False, 0.0)
    for torque in (DriveLine(True, 1.0, 0.0, 0.0, 0.0), DriveLine(False, 1.0, 40.0, -4e4, 0.0)):
        states, spans = drawn_states(former, rng), 10.0 ** rng.uniform(-5.0, -2.3, DRAWS)
        missed = looked_for(former, torque, modes, states, spans, counts)
        assert counts[MISSED] == 0, (counts, states[missed], spans[missed])
    assert 2 * DRAWS > counts[LOOKED_FOR] >= counts[FOUND] > DRAWS / 100


@pytest.mark.parametrize(("torque_nm", "looked"), [(1e-9, False), (1.0, True)])
def test_a_motor_whose_torque_is_next_to_nothing_turns_its_sign_at_the_end_of_a_step(torque_nm: float, looked: bool):
    """The loss of the gear has its kink there, which a torque of the integration's noise makes in every step."""
    former = former_of(parameters_for(2, {"load": "none", "drive.gear_loss": "power"}))
    span, y = 1e-5, state_array(0.5, former.scales.crank_speed_rad_per_s)
    torque = DriveLine(False, 1.0, torque_nm, -3.0 * torque_nm / span, 0.0)  # zero at a third of the step
    modes = normalised_modes(former, torque, 0.0, y, Modes(1.0, 1.0, 1.0, True, 1.0, -1.0, False, 0.0))
    sides, watches = np.empty(former.bank.offset_rad.size), np.zeros((MOST_WATCHES, 3), np.int64)
    motion = FormerMotion(former, torque, stretch_from(former, 0.0, y, modes, sides, np.inf, NONE), sides)
    work, end = Workspace(np.empty((16, SIZE)), np.empty(SIZE), np.empty(SIZE)), np.empty(SIZE)
    start_step(motion, 0.0, y, work)
    h, _ = controlled_step(motion, 0.0, y, span, former.tolerances, work)
    code, at = locate_event(motion, modes, watches, 0.0, y, h, end, work, np.zeros((2, SIZE)))
    assert (code, h) == (SHAFT_TURNS, span)
    assert at == pytest.approx(span / 3.0 if looked else span, rel=1e-6)


@given(st.floats(0.1, 3.0), st.floats(0.0, 7.0), st.floats(0.0, 2.0))
def test_a_swing_far_from_zero_at_both_ends_of_a_step_is_not_zero_in_between(
    span: float, phase: float, offset: float
) -> None:
    """``offset + cos(t)`` over up to half a swing, which is more than a step as it is taken."""
    inside = np.linspace(phase, phase + span, 1001)
    before, after = offset + np.cos(inside[0]), offset + np.cos(inside[-1])
    assume(min(before, after) > 0.0)
    if not may_dip(before, after, -np.sin(inside[0]), -np.sin(inside[-1]), span):
        assert (offset + np.cos(inside)).min() > 0.0

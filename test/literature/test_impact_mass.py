# SPDX-License-Identifier: Apache-2.0
"""Published figures of Manzhosov and Novikov, and what exact computation gives for them."""

from __future__ import annotations

import math

import pytest
from literature.impact_reference import number, walk

from mech_twin.engine.run import frames
from mech_twin.machines.impact_mass.dynamics import (
    CHATTER_END,
    IMPACT,
    KIND_NAMES,
    PHASE_CHANGE,
    impact_system,
    initial_motion,
    next_event,
)
from mech_twin.machines.impact_mass.one_impact_cycle import CycleSpec, synthesised_cycle
from mech_twin.parameters.load import machine, machine_parameters

FIG2 = {"period_s": 0.05, "phase1_force_n": 1000.0, "phase2_force_n": -500.0, "restitution": 0.3, "mass_kg": 1.0}


def event_batch(t1: float, periods: int, cutoff: float = 0.0):
    """Return (kind, period, tau, pre, post) of the events of the case of figs. 2 and 3."""
    system = impact_system((0.05, t1), (1000.0, -500.0), 0.3, cutoff)
    motion = initial_motion(0.5, 0.0, system)
    seen = []
    while motion.period < periods:
        event, motion = next_event(motion, system)
        seen.append(
            (KIND_NAMES[int(event.kind)], int(event.period), event.tau_s, event.pre_m_per_s, event.post_m_per_s)
        )
    return seen


def counts(seen, periods: int) -> list[float]:
    """Return the impacts of each period, endless where the series completes."""
    found = [0.0] * periods
    for kind, period, *_ in seen:
        if kind == "impact" and period < periods:
            found[period] += 1
    for kind, period, *_ in seen:
        if kind == "chatter_end" and period < periods:
            found[period] = math.inf
    return found


def first_blows(seen, periods: int) -> list[float]:
    return [next((e[3] for e in seen if e[0] == "impact" and e[1] == n), 0.0) for n in range(periods)]


def velocities(seen) -> tuple[float, float]:
    values = [v for e in seen for v in e[3:]]
    return min(values), max(values)


def test_figure_2_settles_on_a_slower_blow_with_completed_chatter():
    seen = event_batch(0.035, 40)
    blows = first_blows(seen, 40)
    assert blows[:5] == pytest.approx([31.6228, 20.4813, 20.2744, 19.7455, 17.4812], abs=5e-5)
    assert blows[-1] == pytest.approx(12.9904, abs=5e-5)
    assert counts(seen, 40)[5:] == [math.inf] * 35
    assert [e[2] for e in seen if e[0] == "chatter_end"][-1] == pytest.approx(0.031625, abs=5e-7)


def test_figure_3a_misses_impacts():
    seen = event_batch(0.025, 6)
    assert counts(seen, 6) == [1, 0, 1, 1, 1, math.inf]
    low, high = velocities(seen)
    assert (low, high) == pytest.approx((-14.69, 25.00), abs=5e-3)


def test_figure_3b_misses_impacts_then_repeats_after_five_periods():
    seen = event_batch(0.03, 36)
    assert counts(seen, 6) == [1, 0, 2, 1, 0, math.inf]
    low, high = velocities([e for e in seen if e[1] < 10])
    assert (low, high) == pytest.approx((-17.90, 30.00), abs=5e-3)
    later = [[e[2:] for e in seen if e[1] == n] for n in range(10, 36)]
    assert later[:20] == later[5:25]
    assert later[0] != later[1]


@pytest.mark.parametrize(("t1", "periods"), [("0.035", 40), ("0.025", 6), ("0.03", 60)])
def test_times_and_speeds_hold_against_sixty_digits(t1, periods):
    case = {k: number(v) for k, v in {"T": "0.05", "t1": t1, "A1": "1000", "A2": "-500", "R": "0.3"}.items()}
    reference = walk({**case, "gap": number("0.5"), "speed": number("0")}, periods)
    ours = [e for e in event_batch(float(t1), periods) if e[0] in ("impact", "chatter_end")]
    assert [e[0] for e in ours] == [r.kind for r in reference]
    for (_, period, tau, pre, _), exact in zip(ours, reference, strict=True):
        assert period * 0.05 + tau == pytest.approx(float(exact.time), rel=1e-9)
        assert pre == pytest.approx(float(exact.pre), rel=1e-9)


@pytest.mark.parametrize("cutoff", [1e-3, 0.05, 0.09])
def test_the_cut_off_keeps_i_min_impacts_and_rests_at_the_next(cutoff):
    kept = math.floor(math.log(cutoff) / math.log(0.3) + 1e-9) + 1
    seen = [e for e in event_batch(0.035, 12, cutoff) if e[1] == 11]
    blows = [e for e in seen if e[0] == "impact"]
    (end,) = (e for e in seen if e[0] == "chatter_end")
    assert len(blows) == kept
    first = blows[0]
    delay = 2 * 0.3 * first[3] / 1000.0 * (1 - 0.3**kept) / 0.7
    assert end[2] == pytest.approx(first[2] + delay, rel=1e-9)
    assert end[3] == pytest.approx(first[3] * 0.3**kept, rel=1e-9)
    assert end[4] == 0.0
    assert first[3] == pytest.approx(12.9904, abs=5e-5)


def test_figure_4_synthesis_gives_the_printed_cycle():
    cycle = synthesised_cycle(CycleSpec(1.0, 0.0, -0.5, 0.0, 20.0, 0.3))
    assert cycle.rebound_velocity_m_per_s == pytest.approx(-6.0, rel=1e-12)
    assert cycle.phase1_duration_s == pytest.approx(0.05, rel=1e-12)
    assert cycle.period_s == pytest.approx(0.05 + 1 / 6, rel=1e-12)
    assert math.floor(cycle.period_s * 1000) / 1000 == 0.216  # the print cuts, it does not round
    assert cycle.phase1_force_n == pytest.approx(400.0, rel=1e-12)
    assert cycle.phase2_force_n == pytest.approx(36.0, rel=1e-12)


def test_figure_4_runs_with_one_impact_a_period_and_no_chatter():
    system = impact_system((0.05 + 1 / 6, 0.05), (400.0, 36.0), 0.3, 0.0)
    motion = initial_motion(0.5, 0.0, system)
    for n in range(5):
        kinds = []
        while motion.period == n:
            event, motion = next_event(motion, system)
            kinds.append(event.kind)
            if event.kind == IMPACT:
                assert event.pre_m_per_s == pytest.approx(20.0, rel=1e-9)
                assert event.tau_s == pytest.approx(0.05, rel=1e-9)
        assert kinds.count(IMPACT) == 1
        assert CHATTER_END not in kinds
        assert kinds.count(PHASE_CHANGE) == 2


def test_the_machine_shows_figure_2_on_the_coupling_grid():
    parameters = machine_parameters("impact_mass")
    assert {key: getattr(parameters, key) for key in FIG2} == FIG2
    run = list(frames(machine("impact_mass"), 0.6))
    blows = [e for f in run for e in f.linkage.events if e.kind == "impact"]
    firsts = [max(e.pre_velocity_m_per_s for e in blows if e.period == n) for n in range(11)]
    assert firsts[:5] == pytest.approx([31.6228, 20.4813, 20.2744, 19.7455, 17.4812], abs=5e-5)
    assert firsts[-1] == pytest.approx(12.9904, abs=5e-5)
    assert {run[0].linkage.regime, *(f.linkage.regime for f in run)} == {0, 1, 2, 3}

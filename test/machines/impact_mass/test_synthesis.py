# SPDX-License-Identifier: Apache-2.0
"""The published cycle does not survive; the robust one does."""

from __future__ import annotations

from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pytest

from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.engine.run import frames
from mech_twin.machines.impact_mass import PARAMETERS, build, cycle_verdict
from mech_twin.machines.impact_mass.cycle_verdict import basin, default_box, endurance, phase2_cycle, verdict
from mech_twin.machines.impact_mass.long_run_answers import CHOSEN, certificate_lines, synthesis_answer
from mech_twin.machines.impact_mass.one_impact_cycle import CycleSpec
from mech_twin.machines.impact_mass.synthesis import (
    RobustnessSpec,
    published_parameters,
    robust_parameters,
    synthesise,
    with_phase2_force,
)
from mech_twin.machines.impact_mass.tolerance_box import Deviation, certified, deviated, outcome
from mech_twin.parameters.load import machine_parameters
from mech_twin.parameters.written_configuration import write_configuration

pytestmark = pytest.mark.slow

PAPER = CycleSpec(1.0, 0.0, -0.5, 0.0, 20.0, 0.3)
BOX = default_box(0.5, 20.0, 1000, 1)


@pytest.fixture(scope="module")
def both():
    return synthesise(PAPER)


def test_the_published_cycle_stands_on_the_border_and_has_no_basin(both):
    judged = both.published.verdict
    assert judged.exists and judged.admissible and judged.on_border and not judged.stable
    assert judged.margin < 0.0
    assert judged.basin.reached == 0


@pytest.mark.parametrize(("period_s", "periods"), [(0.2167, 7), (0.216, 8)])
def test_the_published_cycle_collapses_with_the_period_as_printed(period_s, periods):
    printed = published_parameters(PAPER).model_copy(update={"period_s": period_s})
    assert endurance(printed, 1000).rests_in_period == periods


@pytest.mark.parametrize("batch", [1, 3, 7, 50])
def test_runs_and_starts_counted_in_batches_are_those_counted_at_once(both, monkeypatch, batch):
    fails, holds = published_parameters(PAPER), both.robust.parameters
    collapses = fails.model_copy(update={"period_s": 0.216})
    found = [endurance(case, 100) for case in (fails, collapses, holds)]
    cycle, few = phase2_cycle(holds), replace(BOX, starts=100)
    whole = basin(holds.system, cycle, few)
    monkeypatch.setattr(cycle_verdict, "BATCH_PERIODS", batch)
    monkeypatch.setattr(cycle_verdict, "BATCH_STARTS", batch)
    assert [endurance(case, 100) for case in (fails, collapses, holds)] == found
    assert basin(holds.system, cycle, few) == whole


def test_the_robust_cycle_holds_for_a_million_periods_at_every_printed_period(both):
    assert [e.period_s for e in both.robust.endurance[1:]] == [0.2167, 0.216]
    for lasting in both.robust.endurance:
        assert lasting.held_periods == lasting.periods == 1_000_000
        assert lasting.rests_in_period == 0
        assert lasting.least_blow_m_per_s == pytest.approx(20.0, rel=1e-3)
    assert both.robust.endurance[0].largest_blow_m_per_s == pytest.approx(20.0, rel=1e-12)


def test_the_robust_cycle_keeps_speed_and_times_and_meets_its_demand(both):
    published, robust = both.published.parameters, both.robust.parameters
    assert (robust.period_s, robust.phase1_duration_s) == (published.period_s, published.phase1_duration_s)
    assert both.robust.impact_speed_m_per_s == pytest.approx(20.0, rel=1e-12)
    judged = both.robust.verdict
    assert judged.stable and judged.margin >= both.robustness.margin
    assert judged.basin.fraction >= both.robustness.basin_fraction
    assert judged.basin.box == BOX


def test_the_two_examples_of_stable_forces_have_their_stated_basins():
    published = published_parameters(PAPER)
    good, poor = (with_phase2_force(published, 20.0, p2) for p2 in (-20.0, 30.0))
    assert good.phase1_force_n == pytest.approx(586.667, abs=5e-4)
    assert poor.phase1_force_n == pytest.approx(420.0, rel=1e-12)
    assert verdict(good, BOX).basin.reached == 1000
    judged = verdict(poor, BOX)
    assert judged.stable
    assert judged.basin.at_rest >= 2000 / 3


def test_a_basin_repeats_for_its_seed_and_differs_for_another():
    parameters = with_phase2_force(published_parameters(PAPER), 20.0, 30.0)
    assert verdict(parameters, BOX) == verdict(parameters, BOX)
    assert verdict(parameters, replace(BOX, seed=2)).basin.slowest_periods > 0


def test_the_written_configuration_runs_with_one_impact_a_period(both, tmp_path):
    file = tmp_path / "robust.yaml"
    write_configuration("impact_mass", both.robust.parameters, file)
    parameters = machine_parameters("impact_mass", file)
    assert parameters == both.robust.parameters
    run = list(frames(build(parameters), 20.5 * parameters.period_s))
    blows = [e for f in run for e in f.linkage.events if e.kind == "impact"]
    assert [e.period for e in blows] == list(range(20)) + [20] * (len(blows) - 20)
    assert all(e.pre_velocity_m_per_s == pytest.approx(20.0, rel=1e-9) for e in blows)


def test_a_synthesis_chooses_the_force_and_the_start_and_keeps_all_else_of_the_configuration():
    kept = {
        "contact_stiffness_n_per_m": 1e8,
        "chatter_cutoff": 1e-3,
        "supply.initial_fraction": 0.5,
        "supply.rate_per_s": 5.0,
        "coupling.step_s": 5e-4,
    }
    given = machine_parameters("impact_mass", None, kept)
    answer = synthesis_answer(given, 20.0, {"starts": 50, "inside": 10}, 100)
    for cycle in answer.cycles:
        changed = {key for key, value in given.model_dump().items() if value != cycle.parameters.model_dump()[key]}
        assert changed <= set(CHOSEN)
        assert cycle.record["config"] == configuration_tree(cycle.parameters)


@pytest.mark.parametrize(
    ("spec", "robustness", "words"),
    [
        (replace(PAPER, initial_velocity_m_per_s=7.0), RobustnessSpec(), "initial_velocity_m_per_s < restitution"),
        (PAPER, RobustnessSpec(margin=0.75), "margin <= 1 - restitution"),
        (PAPER, RobustnessSpec(margin=0.69, starts=50), "basin_fraction >= 0.999 does not hold with margin >= 0.69"),
        (PAPER, RobustnessSpec(tolerance=0.2, starts=50, inside=10), "tolerance = 0.2 does not hold"),
        (PAPER, RobustnessSpec(tolerance=1.0), "0 <= tolerance < 1"),
        (PAPER, RobustnessSpec(stroke_ratio=0.9), "stroke_ratio <= 0.9 and start_speed_ratio <= 1.0 do not both hold"),
        (PAPER, RobustnessSpec(start_speed_ratio=0.001), "start_speed_ratio <= 0.001 do not both hold"),
    ],
)
def test_a_synthesis_without_solution_says_which_inequality_fails(spec, robustness, words):
    with pytest.raises(ValueError, match=words):
        robust_parameters(spec, robustness)


def test_a_basin_that_is_too_small_is_refused_with_the_largest_that_was_found():
    """A restitution of 0.55 leaves seven starts in ten at most, by a walk of events of its own."""
    bouncy = CycleSpec(2.0, 0.0, -0.5, 0.0, 8.0, 0.55)
    with pytest.raises(ValueError, match="without any deviation: largest that was found") as refusal:
        robust_parameters(bouncy, RobustnessSpec())
    assert float(str(refusal.value).rsplit(" ", 1)[1]) == pytest.approx(0.75, abs=0.1)


def test_another_cycle_is_served_too():
    spec = CycleSpec(3.0, 0.2, -0.1, 0.0, 12.0, 0.2)
    found, certificate = robust_parameters(spec, RobustnessSpec(starts=100, inside=40))
    assert verdict(found, None).stable
    assert endurance(found, 20_000).held_periods == 20_000
    assert certificate.worst_fraction >= 0.999


KEYS = ("phase1_force_n", "phase2_force_n", "phase1_duration_s", "period_s", "restitution")


def share(parameters, factors, starts=1000):
    """Return the share of fresh random starts that reach the cycle of a machine off by these factors."""
    off = {key: getattr(parameters, key) * factor for key, factor in zip(KEYS, factors, strict=True)}
    changed = PARAMETERS.model_validate({**parameters.model_dump(), **off})
    judged = verdict(changed, replace(BOX, starts=starts, seed=77))
    return judged.basin.fraction if judged.stable else 0.0


@pytest.mark.parametrize("factors", [(1.0,) * i + (f,) + (1.0,) * (4 - i) for i in range(5) for f in (0.99, 1.01)])
def test_one_percent_off_in_any_one_quantity_every_start_still_reaches_the_cycle(both, factors):
    assert share(both.robust.parameters, factors) == 1.0


def test_the_box_of_one_percent_holds_at_fresh_random_points_and_at_every_corner(both):
    random = np.random.default_rng(2026)
    points = [*product((0.99, 1.01), repeat=5), *random.uniform(0.99, 1.01, (100, 5)).tolist()]
    assert min(share(both.robust.parameters, factors) for factors in points) >= 0.999


@pytest.mark.parametrize("p2", [-14.799, -20.0])
def test_forces_that_are_stable_but_not_robust_have_no_certificate(p2):
    found = certified(with_phase2_force(published_parameters(PAPER), 20.0, p2), 0.01, BOX, 100)
    assert found.worst_fraction < 0.9


def test_the_certificate_says_what_was_tried_and_the_design_what_it_takes(both):
    certificate = both.robust.certificate
    assert (certificate.corners, certificate.faces, certificate.inside) == (32, 10, 300)
    words = "points of the box tried (between them nothing is proved)"
    assert (
        certificate_lines(asdict(certificate))[words]
        == f"32 corners, 10 faces, 300 inside, {certificate.climbed} climbed"
    )
    assert certificate.tried == 1 + 32 + 10 + 300 + certificate.climbed
    assert certificate.climbed > 0
    assert certificate.starts == 1000
    assert certificate.worst_fraction >= 0.999
    assert 0.0 < certificate.worst_margin < both.robust.verdict.margin
    p = both.robust.parameters
    assert p.start.gap_m < both.robust.stroke_m <= 2.5 * 0.5
    turning = p.initial_velocity_m_per_s**2 / (2.0 * p.phase1_force_n)
    assert both.robust.stroke_m == pytest.approx(p.start.gap_m + turning, rel=1e-12)


def test_a_box_that_leaves_the_range_of_a_quantity_does_not_hold():
    parameters = published_parameters(PAPER).model_copy(update={"restitution": 0.9999})
    assert deviated(parameters, Deviation(0.0, 0.0, 0.0, 0.0, 0.01)) is None
    late = parameters.model_copy(update={"phase1_duration_s": parameters.period_s * 0.999})
    assert deviated(late, Deviation(0.0, 0.0, 0.01, 0.0, 0.0)) is None
    assert outcome(late, Deviation(0.0, 0.0, 0.01, 0.0, 0.0), BOX).fraction == 0.0

"""Design search of the press: the reference problem, repeatability, reasons, the front."""

import numpy as np
import pytest

from mech_twin.machines.compaction_press.cycle import flywheel_figures
from mech_twin.machines.compaction_press.design_problem import REFERENCE_LIMITS, SENSES, Space, design_press, evaluation
from mech_twin.machines.compaction_press.design_search import (
    OBJECTIVES,
    InfeasibleSpaceError,
    best_design,
    non_dominated,
    pareto_front,
    scan,
)
from mech_twin.machines.compaction_press.dynamics import CONTACT, FREE, loaded_height, press_reduced
from mech_twin.machines.compaction_press.parameters import press_stroke
from mech_twin.machines.compaction_press.stroke_load import StrokeLoad
from mech_twin.parts.flywheel import exact_inertia

pytestmark = pytest.mark.slow

BEST_KNOWN = {"peak_torque_nm": 145.162, "flywheel_inertia_kg_m2": 2.156745, "mean_press_force_n": 15234.5}


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_search_meets_the_best_known_design(objective):
    design = best_design(objective)
    sense = SENSES[OBJECTIVES.index(objective)]
    known = BEST_KNOWN[objective]
    assert sense * design.objectives[objective] <= sense * known + 1e-5 * known
    assert min(design.margins.values()) >= 0.0


def test_same_seed_gives_the_same_design():
    assert best_design("flywheel_inertia_kg_m2", seed=5) == best_design("flywheel_inertia_kg_m2", seed=5)


def test_share_of_feasible_designs():
    space = Space()
    random = np.random.default_rng(3)
    designs = random.uniform(space.lower_m, space.upper_m, (100_000, 4))
    assert evaluation(designs, space.limits).feasible.mean() == pytest.approx(0.019, abs=1e-3)


def test_objectives_are_the_trapezoid_on_72_positions():
    design, n, w = (0.055, 0.5, 0.24, 0.295), 72, 10.0 * np.pi
    press = design_press(*design)
    angles = np.arange(n) * 2.0 * np.pi / n
    y = np.array([loaded_height(press, f)[0] for f in angles])
    top, bottom = int(y.argmax()), int(y.argmin())
    press = press._replace(load=StrokeLoad(10000.0, 0.5 * (y.max() + y.min()), y.min(), 1.0))
    down = ((np.arange(n) - top) % n) <= ((bottom - top) % n)
    rows = [press_reduced(press, f, CONTACT if inside else FREE) for f, inside in zip(angles, down, strict=True)]
    moment, inertia = np.array([row.moment for row in rows]), np.array([row.inertia for row in rows])
    surplus = moment - moment.mean()
    work = np.concatenate(([0.0], np.cumsum(0.5 * (surplus[1:] + surplus[:-1])))) * 2.0 * np.pi / n
    found = evaluation(np.array([design]), REFERENCE_LIMITS).objectives[0]
    peak = max(abs(0.5 * w * w * row.slope - row.moment) for row in rows)
    assert found[0] == pytest.approx(peak, rel=1e-12)
    assert found[1] == pytest.approx(exact_inertia(work, inertia, 0.05, w), rel=1e-11)


def test_samples_agree_with_the_exact_press():
    design = (0.055, 0.5, 0.24, 0.295)
    press = design_press(*design)
    stroke = press_stroke(press, 0.5)
    y_c = 0.5 * (stroke.top_y_m + stroke.bottom_y_m)
    press = press._replace(load=StrokeLoad(10000.0, y_c, stroke.bottom_y_m, 1.0))
    found = evaluation(np.array([design]), REFERENCE_LIMITS).objectives[0]
    exact = flywheel_figures(press, stroke, 10.0 * np.pi, 0.05)
    # what 72 samples of a stroke with kinks are worth
    assert found[1] == pytest.approx(exact["flywheel_inertia_kg_m2"], rel=1e-2)
    travel = y_c - stroke.bottom_y_m
    assert found[2] == pytest.approx(250.0 * ((stroke.bottom - stroke.contact) % (2 * np.pi)) / travel, rel=1e-3)


@pytest.mark.parametrize(
    ("limits", "word"),
    [({"stroke_m": 0.3}, "stroke_m"), ({"gamma_max_deg": 2.0}, "gamma_max_deg"), ({"transmission_deg": 89.9}, "trans")],
)
def test_infeasible_space_names_the_constraint_that_kills_it(limits, word):
    with pytest.raises(InfeasibleSpaceError, match=word):
        best_design("peak_torque_nm", Space(limits=REFERENCE_LIMITS._replace(**limits)))


def test_front_holds_no_dominated_design_and_reaches_both_ends():
    names = ("peak_torque_nm", "mean_press_force_n")
    front = pareto_front(names, points=3)
    values = np.array([[design.objectives[names[0]], -design.objectives[names[1]]] for design in front])
    assert non_dominated(values).all()
    assert values[:, 0].min() == pytest.approx(BEST_KNOWN[names[0]], rel=1e-3)
    assert -values[:, 1].min() == pytest.approx(BEST_KNOWN[names[1]], rel=1e-3)


def test_scan_repeats():
    one, two = scan(Space(), 4, 8), scan(Space(), 4, 8)
    assert (one[0] == two[0]).all()
    assert (one[1].margins == two[1].margins).all()


def test_unknown_objective_is_refused():
    with pytest.raises(ValueError, match="expected one of"):
        best_design("weight_kg")

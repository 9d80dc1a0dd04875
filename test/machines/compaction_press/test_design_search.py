# SPDX-License-Identifier: Apache-2.0
"""Design search of the press: the reference problem, repeatability, reasons, the front."""

import numpy as np
import pytest
from scipy.optimize import Bounds, differential_evolution

from mech_twin.machines.compaction_press.cycle import flywheel_metrics
from mech_twin.machines.compaction_press.design_evaluation import evaluation
from mech_twin.machines.compaction_press.design_problem import SENSES, Lengths, scaled_press
from mech_twin.machines.compaction_press.design_search import (
    OBJECTIVES,
    InfeasibleSpaceError,
    best_design,
    feasible_scan,
    non_dominated,
    pareto_front,
    press_search,
    scan,
)
from mech_twin.machines.compaction_press.dynamics import CONTACT, FREE, StrokeLoad, loaded_height, press_reduced
from mech_twin.machines.compaction_press.parameters import press_stroke
from mech_twin.parameters.load import machine_parameters
from mech_twin.parts.flywheel import exact_inertia
from mech_twin.studies.design_scan import design_question

pytestmark = pytest.mark.slow

# pendulum of the reference problem, 16 kg per metre; all else of it is the installed configuration
REFERENCE = {"links.pendulum.mass_kg": 4.8, "links.pendulum.inertia_kg_m2": 4.8 * 0.3**2 / 12.0}
BEST_KNOWN = {"peak_torque_nm": 145.162, "flywheel_inertia_kg_m2": 2.156745, "mean_press_force_n": 15234.5}
BEST_KNOWN_FORCE_AT = (0.049990, 0.8, 0.5, 0.53603)
FORCE_ERROR = -3.35e-5  # of the best-known mean force: its contact travel is not that of exact angles and heights


def reference(seed=1, **limits):
    parameters = machine_parameters("compaction_press", None, REFERENCE)
    space = design_question("compaction_press").space(None, limits)
    return press_search(parameters, space, seed)


def best_at_72_positions(asked, column):
    """The best of a differential evolution from the feasible designs of a scan."""

    def value(columns):
        found = asked.sampled(np.atleast_2d(columns.T))
        return np.where(found.feasible, SENSES[column] * found.objectives[:, column], 1e6)

    designs, _ = feasible_scan(asked)
    first = designs[np.argsort(value(designs.T), kind="stable")[:60]]
    within = Bounds(asked.space.lower, asked.space.upper)
    options = {"mutation": (0.4, 0.9), "recombination": 0.9, "tol": 0.0, "atol": 1e-13, "polish": False, "seed": 1}
    found = differential_evolution(
        value, within, init=first, maxiter=1000, vectorized=True, updating="deferred", **options
    )
    return found.x[None, :]


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_search_at_72_positions_meets_the_best_known_design(objective):
    asked = reference()
    column = OBJECTIVES.index(objective)
    reached = asked.sampled(best_at_72_positions(asked, column))
    known = BEST_KNOWN[objective] * (1.0 + FORCE_ERROR if objective == "mean_press_force_n" else 1.0)
    assert SENSES[column] * reached.objectives[0, column] <= SENSES[column] * known + 1e-5 * known
    assert reached.margins.min() >= 0.0


def test_the_best_known_mean_force_is_off_by_its_contact_travel():
    found = evaluation(np.array([BEST_KNOWN_FORCE_AT]), reference().problem)
    column = OBJECTIVES.index("mean_press_force_n")
    assert found.objectives[0, column] / BEST_KNOWN["mean_press_force_n"] - 1.0 == pytest.approx(FORCE_ERROR, abs=5e-7)


@pytest.mark.parametrize(("objective", "least_loss"), [("peak_torque_nm", 1e-3), ("flywheel_inertia_kg_m2", 1e-3)])
def test_the_winner_at_72_positions_is_worse_on_the_curve_and_the_one_found_holds_there(objective, least_loss):
    asked, column = reference(), OBJECTIVES.index(objective)
    winner = best_at_72_positions(asked, column)
    promised, true = asked.sampled(winner).objectives[0, column], asked.continuous(winner).objectives[0, column]
    assert true > promised * (1.0 + least_loss)
    chosen = best_design(asked, objective)
    assert min(chosen.margins.values()) >= 0.0
    assert chosen.objectives[objective] <= true * (1.0 + 1e-3)


def test_the_least_peak_torque_lies_at_the_end_of_its_flat_valley():
    """From h 0.47 to its bound 0.5 m the peak falls by 1.4e-4 of its value, stroke and gamma on their limits."""
    space = design_question("compaction_press").space()
    chosen = best_design(press_search(machine_parameters("compaction_press"), space), "peak_torque_nm")
    assert chosen.variables["height_m"] == pytest.approx(0.5, abs=1e-9)
    assert chosen.objectives["peak_torque_nm"] <= 145.6147 * (1.0 + 1e-7)
    assert min(chosen.margins.values()) >= 0.0


def test_same_seed_gives_the_same_design():
    one, two = (best_design(reference(5), "flywheel_inertia_kg_m2") for _ in range(2))
    assert one == two


def test_share_of_feasible_designs():
    asked = reference()
    designs = asked.space.designs(np.random.default_rng(3).random((100_000, 4)))
    assert asked.sampled(designs).feasible.mean() == pytest.approx(0.019, abs=1e-3)


def test_objectives_are_the_trapezoid_on_72_positions():
    design, n, w = (0.055, 0.5, 0.24, 0.295), 72, 10.0 * np.pi
    press = scaled_press(reference().problem.press, Lengths(*design))
    angles = np.arange(n) * 2.0 * np.pi / n
    y = np.array([loaded_height(press, f)[0] for f in angles])
    top, bottom = int(y.argmax()), int(y.argmin())
    press = press._replace(load=StrokeLoad(10000.0, 0.5 * (y.max() + y.min()), y.min(), 1.0))
    down = ((np.arange(n) - top) % n) <= ((bottom - top) % n)
    rows = [press_reduced(press, f, CONTACT if inside else FREE) for f, inside in zip(angles, down, strict=True)]
    moment, inertia = np.array([row.moment for row in rows]), np.array([row.inertia for row in rows])
    surplus = moment - moment.mean()
    work = np.concatenate(([0.0], np.cumsum(0.5 * (surplus[1:] + surplus[:-1])))) * 2.0 * np.pi / n
    found = evaluation(np.array([design]), reference().problem).objectives[0]
    peak = max(abs(0.5 * w * w * row.slope - row.moment) for row in rows)
    assert found[0] == pytest.approx(peak, rel=1e-12)
    assert found[1] == pytest.approx(exact_inertia(work, inertia, 0.05, w), rel=1e-11)


def test_samples_agree_with_the_exact_press():
    design = (0.055, 0.5, 0.24, 0.295)
    press = scaled_press(reference().problem.press, Lengths(*design))
    stroke = press_stroke(press, 0.5)
    y_c = 0.5 * (stroke.top_y_m + stroke.bottom_y_m)
    press = press._replace(load=StrokeLoad(10000.0, y_c, stroke.bottom_y_m, 1.0))
    found = evaluation(np.array([design]), reference().problem).objectives[0]
    exact = flywheel_metrics(press, stroke, 10.0 * np.pi, 0.05)
    # what 72 samples of a stroke with kinks are worth
    assert found[1] == pytest.approx(exact["flywheel_inertia_kg_m2"], rel=1e-2)
    travel = y_c - stroke.bottom_y_m
    assert found[2] == pytest.approx(250.0 * ((stroke.bottom - stroke.contact) % (2 * np.pi)) / travel, rel=1e-12)


@pytest.mark.parametrize(
    ("limits", "word"),
    [({"stroke_m": 0.3}, "stroke_m"), ({"gamma_max_deg": 2.0}, "gamma_max_deg"), ({"transmission_deg": 89.9}, "trans")],
)
def test_infeasible_space_names_the_constraint_that_kills_it(limits, word):
    with pytest.raises(InfeasibleSpaceError, match=word):
        best_design(reference(**limits), "peak_torque_nm")


def test_a_sliver_that_the_scan_misses_is_found_by_descent():
    """Of 65536 designs none keeps gamma within 0.001 degrees of 0 at the bottom."""
    asked = reference(gamma_bottom_deg=0.001)
    assert not scan(asked)[1].feasible.any()
    assert min(best_design(asked, "peak_torque_nm").margins.values()) >= 0.0


def test_front_holds_no_dominated_design_and_reaches_both_ends():
    names = ("peak_torque_nm", "mean_press_force_n")
    front = pareto_front(reference(), names, points=2)
    values = np.array([[design.objectives[names[0]], -design.objectives[names[1]]] for design in front])
    assert non_dominated(values).all()
    assert min(min(design.margins.values()) for design in front) >= 0.0
    assert values[:, 0].min() == pytest.approx(BEST_KNOWN[names[0]], rel=4e-3)  # what 72 samples are worth
    assert -values[:, 1].min() == pytest.approx(BEST_KNOWN[names[1]], rel=1e-3)


def test_a_front_ends_in_the_best_design_of_each_objective():
    asked, names = reference(), ("peak_torque_nm", "mean_press_force_n")
    front = pareto_front(asked, names, points=1)
    for name, end in zip(names, (front[0], front[-1]), strict=True):
        assert end.objectives[name] == pytest.approx(best_design(asked, name).objectives[name], rel=1e-9)


def test_scan_repeats():
    one, two = scan(reference(4)), scan(reference(4))
    assert (one[0] == two[0]).all()
    assert (one[1].margins == two[1].margins).all()


def test_a_search_for_one_objective_does_not_ask_whether_the_others_are_finite():
    """On the way lies a press whose layer has no depth: its mean force has no bound."""
    thin = {"working_force.contact_fraction": 0.999, "working_force.exponent": 0.0, "drive.speed_rpm": 60.0}
    parameters = machine_parameters("compaction_press", None, thin)
    space = design_question("compaction_press").space(None, {"transmission_deg": 10.0})
    found = best_design(press_search(parameters, space, 1), "peak_torque_nm")
    assert min(found.margins.values()) >= 0.0


def test_a_descent_past_presses_that_do_not_turn_finds_the_largest_mean_force():
    space = design_question("compaction_press").space()
    found = best_design(press_search(machine_parameters("compaction_press"), space), "mean_press_force_n")
    assert found.objectives["mean_press_force_n"] == pytest.approx(15234.317, rel=1e-6)

# SPDX-License-Identifier: Apache-2.0
"""Each Runge and Kutta method has the order it is named for, and its dense output and error estimate theirs.

The problems are Kepler's ellipse with its exact position by Kepler's equation, and a growth whose rate changes with
time, known in closed form; neither shares anything with the engine.
"""

import math
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq
from work_arrays import workspace

from mech_twin.engine.integration import (
    DORMAND_PRINCE_5,
    DORMAND_PRINCE_8,
    controlled_step,
    finish_step,
    following_step,
    interpolate,
    prepare_dense_output,
    rates_of,
    start_step,
    step_error,
    take_step,
)
from mech_twin.kernels.kernel import kernel

ECCENTRICITY = 0.3


class Planet853(NamedTuple):
    """The two-body problem, by Dormand and Prince, order 8."""

    pull: float


class Planet5(NamedTuple):
    """The two-body problem, by Dormand and Prince, order 5."""

    pull: float


def _pull(system, t, y, out):
    cube = (y[0] * y[0] + y[1] * y[1]) ** 1.5
    out[0], out[1] = y[2], y[3]
    out[2], out[3] = -system.pull * y[0] / cube, -system.pull * y[1] / cube


class Tide853(NamedTuple):
    """A growth whose rate swings with time, by Dormand and Prince, order 8."""

    swing: float


class Tide5(NamedTuple):
    """The same, by Dormand and Prince, order 5."""

    swing: float


def _grow(system, t, y, out):
    out[0] = system.swing * math.cos(t) * y[0]


class Ceiling(NamedTuple):
    """Steady rise that has a rate below the height 1 only, by Dormand and Prince, order 8."""

    speed: float


@rates_of(Ceiling, DORMAND_PRINCE_8)
def _rise(system, t, y, out):
    out[0] = system.speed if y[0] < 1.0 else math.nan


METHODS = {Planet853: DORMAND_PRINCE_8, Planet5: DORMAND_PRINCE_5}
TIDES = {Tide853: DORMAND_PRINCE_8, Tide5: DORMAND_PRINCE_5}
for problems, equation in ((METHODS, _pull), (TIDES, _grow)):
    for problem, tableau in problems.items():
        rates_of(problem, tableau)(equation)
DENSE_ORDER = {Planet853: 7, Planet5: 4, Tide853: 7, Tide5: 4}
every_method = pytest.mark.parametrize("planet", METHODS, ids=lambda planet: planet.__name__)
every_tide = pytest.mark.parametrize("problem", TIDES, ids=lambda problem: problem.__name__)


def tide(t):
    """Return the exact state of a growth of swing 1 that is 1 at t = 0."""
    return np.array([math.exp(math.sin(t))])


def ellipse(t):
    """Return the exact state on the ellipse of half-axis 1, in perihelion at t = 0."""
    e = ECCENTRICITY
    anomaly = brentq(lambda x: x - e * math.sin(x) - t, -1.0, t + 2.0, xtol=1e-15, rtol=1e-15)
    c, s, root = math.cos(anomaly), math.sin(anomaly), math.sqrt(1.0 - e * e)
    fast = 1.0 / (1.0 - e * c)
    return np.array([c - e, root * s, -s * fast, root * c * fast])


def finished_step(system, method, t, y, h):
    """Return the workspace after a step with all that its dense output needs."""
    work = workspace(method, len(y))
    start_step(system, t, y, work)
    take_step(system, t, y, h, work)
    finish_step(system, t, h, work)
    prepare_dense_output(system, t, y, h, work)
    return work


def error_after(planet, span, steps):
    y, h = ellipse(0.0), span / steps
    for i in range(steps):
        y = finished_step(planet(1.0), METHODS[planet], i * h, y, h).end.copy()
    return np.abs(y - ellipse(span)).max()


@every_method
def test_error_falls_with_the_order_of_the_method(planet):
    steps = {5: 60, 8: 24}[METHODS[planet].order]
    coarse, fine = error_after(planet, 2.0, steps), error_after(planet, 2.0, 2 * steps)
    assert math.log2(coarse / fine) == pytest.approx(METHODS[planet].order, abs=0.5)


@every_method
def test_dense_output_meets_both_ends_and_falls_with_its_order(planet):
    system, out, y = planet(1.0), np.empty(4), ellipse(0.7)
    errors = []
    for h in {3: (0.1, 0.05), 4: (0.1, 0.05), 7: (0.4, 0.2)}[DENSE_ORDER[planet]]:
        work = finished_step(system, METHODS[planet], 0.0, y, h)
        interpolate(system, y, h, 0.0, work, out)
        assert out == pytest.approx(y, abs=1e-15)
        interpolate(system, y, h, 1.0, work, out)
        assert out == pytest.approx(work.end, abs=1e-12)  # weights of the interpolant go up to some hundred
        worst = 0.0
        for share in np.linspace(0.05, 0.95, 19):
            interpolate(system, y, h, share, work, out)
            worst = max(worst, np.abs(out - ellipse(0.7 + share * h)).max())
        errors.append(worst)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(DENSE_ORDER[planet] + 1, abs=0.6)


@every_tide
def test_an_equation_with_time_in_it_loses_no_order(problem):
    system, method, errors = problem(1.0), TIDES[problem], []
    for steps in {5: (20, 40), 8: (5, 10)}[method.order]:
        y, h = tide(0.3), 2.0 / steps
        for i in range(steps):
            y = finished_step(system, method, 0.3 + i * h, y, h).end.copy()
        errors.append(abs(float(y[0]) - float(tide(2.3)[0])))
    assert math.log2(errors[0] / errors[1]) > method.order - 0.7


@every_tide
def test_dense_output_of_an_equation_with_time_in_it_falls_with_its_order(problem):
    system, method, errors, out = problem(1.0), TIDES[problem], [], np.empty(1)
    for h in {3: (0.2, 0.1), 4: (0.2, 0.1), 7: (0.8, 0.4)}[DENSE_ORDER[problem]]:
        work, worst = finished_step(system, method, 0.3, tide(0.3), h), 0.0
        for share in np.linspace(0.05, 0.95, 19):
            interpolate(system, tide(0.3), h, share, work, out)
            worst = max(worst, abs(float(out[0]) - float(tide(0.3 + share * h)[0])))
        errors.append(worst)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(DENSE_ORDER[problem] + 1, abs=0.8)


@every_tide
def test_last_rate_of_a_step_is_the_rate_at_its_end(problem):
    """c_i = sum of a_ij: a stage lies at the time its weights add up to; the row after the last is the step's end."""
    method = TIDES[problem]
    assert method.nodes == pytest.approx(method.stages.sum(axis=1), abs=1e-14)
    assert method.errors.shape[1] == len(method.weights) + 1
    work = finished_step(problem(1.0), method, 0.3, tide(0.3), 0.5)
    assert work.rates[len(method.weights), 0] == math.cos(0.8) * work.end[0]


@every_method
def test_an_error_is_measured_in_tolerances(planet):
    method, y = METHODS[planet], ellipse(0.3)
    work = finished_step(planet(1.0), method, 0.0, y, 0.2)
    unit = step_error(planet(1.0), 0.2, np.full(4, 1.0), work)
    for tolerance in (1e-9, 1e-4, 7.0):
        assert step_error(planet(1.0), 0.2, np.full(4, tolerance), work) == pytest.approx(unit / tolerance, rel=1e-12)


@every_method
@pytest.mark.parametrize("wanted", [1e-3, 0.02, 0.1, 0.3, 3.0])
def test_next_step_is_that_whose_error_would_be_nine_tenths_of_the_tolerance_in_its_order(planet, wanted):
    """h_next = h (0.9 / err^(1/(p+1))), within 0.2 of a step refused, and 0.3 to 5 times one that is taken."""
    system, method, y, tolerance = planet(1.0), METHODS[planet], ellipse(0.3), np.full(4, 1e-8)
    work, h = workspace(method, 4), wanted
    start_step(system, 0.0, y, work)
    taken, estimate = controlled_step(system, 0.0, y, wanted, tolerance, work)
    following = following_step(system, taken, estimate)
    for _ in range(20):
        error = step_error(system, h, tolerance, finished_step(system, method, 0.0, y, h))
        change = math.inf if error == 0.0 else 0.9 * math.exp(-math.log(error) / (method.error_order + 1))
        if error <= 1.0:
            break
        h *= max(0.2, change)
    assert taken == pytest.approx(h, rel=1e-12)
    assert following == pytest.approx(h * min(5.0, max(0.3, change)), rel=1e-12)


def test_a_step_whose_error_is_no_number_is_tried_again_at_a_fifth():
    """The equation is defined up to a height only; a step across it is refused until one stays below."""
    system, work, y = Ceiling(1.0), workspace(DORMAND_PRINCE_8, 1), np.array([0.0])
    start_step(system, 0.0, y, work)
    taken, _ = controlled_step(system, 0.0, y, 30.0, np.array([1.0]), work)
    assert taken == pytest.approx(30.0 * 0.2**3)


@every_method
def test_an_error_never_falls_where_the_rates_grow(planet):
    """Also where squares overflow one after the other: no step is good because its error is too large for a double."""
    method, system = METHODS[planet], planet(1.0)
    work, rates = workspace(method, 4), np.random.default_rng(1).normal(size=(len(method.nodes), 4))
    errors = []
    for power in np.linspace(0.0, 170.0, 3401):
        work.rates[:] = rates * 10.0**power
        errors.append(step_error(system, 0.2, np.full(4, 1.0), work))
    assert errors[0] > 0.0
    assert np.all(np.diff([min(error, 1e300) for error in errors]) >= 0.0)
    assert errors[-1] == math.inf


@every_method
def test_error_estimate_falls_with_its_order(planet):
    system, method, y = planet(1.0), METHODS[planet], ellipse(0.3)
    steps = ((h, finished_step(system, method, 0.0, y, h)) for h in (0.2, 0.1))
    estimates = [step_error(system, h, np.full(4, 1.0), work) for h, work in steps]
    assert math.log2(estimates[0] / estimates[1]) == pytest.approx(method.error_order + 1, abs=0.6)


@every_method
@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
def test_controlled_steps_keep_their_tolerance(planet, tolerance):
    system, work, y, t, h = planet(1.0), workspace(METHODS[planet], 4), ellipse(0.0), 0.0, 1.0
    steps = 0
    while t < 6.0:
        start_step(system, t, y, work)
        taken, error = controlled_step(system, t, y, min(h, 6.0 - t), np.full(4, tolerance), work)
        h = following_step(system, taken, error)
        assert taken > 0.0
        y, t, steps = work.end.copy(), t + taken, steps + 1
    assert np.abs(y - ellipse(6.0)).max() <= 100.0 * tolerance
    assert steps < 400


def test_no_step_is_taken_where_none_is_good():
    system, work = Planet853(math.nan), workspace(DORMAND_PRINCE_8, 4)
    y = ellipse(0.0)
    start_step(system, 0.0, y, work)
    assert controlled_step(system, 0.0, y, 1.0, np.full(4, 1e-9), work) == (0.0, 0.0)


def test_equation_in_another_module_than_its_type_is_refused():
    def elsewhere(system, t, y, out):
        out[0] = y[0]

    elsewhere.__module__ = "another"
    with pytest.raises(TypeError, match="belongs in"):
        rates_of(Planet5, DORMAND_PRINCE_5)(elsewhere)


@kernel
def many_steps(system, y, work, count):
    """Take many steps from one state, for a time per step."""
    for _ in range(count):
        start_step(system, 0.0, y, work)
        take_step(system, 0.0, y, 1e-3, work)
    return work.end[0]


def test_compiled_step_costs_no_more_than_its_stages():
    """A step of 12 stages within 20 evaluations of the equation plus what 4 x 66 products cost: nothing is boxed."""
    system, work, y = Planet853(1.0), workspace(DORMAND_PRINCE_8, 4), ellipse(0.0)
    many_steps(system, y, work, 1)
    best = math.inf
    for _ in range(20):
        begin = time.perf_counter()
        many_steps(system, y, work, 2000)
        best = min(best, (time.perf_counter() - begin) / 2000)
    assert best < 10e-6


SYSTEM = """
from typing import NamedTuple
from mech_twin.engine.integration import rates_of
from mech_twin.engine.integration import DORMAND_PRINCE_5

class Growth(NamedTuple):
    rate: float

@rates_of(Growth, DORMAND_PRINCE_5)
def growth(system, t, y, out):
    out[0] = 2.0 * system.rate
"""
CALL = """
import numpy as np
from mech_twin.engine.integration import Workspace, start_step, take_step
from mech_twin.engine.integration import DORMAND_PRINCE_5
from growth_trial.system import Growth
work, y = Workspace(np.empty((len(DORMAND_PRINCE_5.nodes), 1)), np.empty(1), np.empty(1)), np.array([1.0])
start_step(Growth(3.0), 0.0, y, work)
take_step(Growth(3.0), 0.0, y, 1.0, work)
print(work.end[0], sum(take_step.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_stored_step_of_the_engine_follows_an_edit_of_the_equation(tmp_path):
    """The step is compiled from the engine's file; the equation in line comes from the file of the system's type."""
    package = tmp_path / "growth_trial"
    package.mkdir()
    (package / "__init__.py").write_text("")
    environment = {
        "PATH": "/usr/bin:/bin", "PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[2]}",
        "PYTHONDONTWRITEBYTECODE": "1",
        "MECH_TWIN_CACHE_DIR": str(tmp_path / "kernels"),
    }  # fmt: skip

    def answer():
        done = subprocess.run(
            [sys.executable, "-c", CALL], env=environment, capture_output=True, text=True, check=True, timeout=200
        )
        return [float(word) for word in done.stdout.split()]

    (package / "system.py").write_text(SYSTEM)
    assert answer() == [7.0, 0.0]
    assert answer() == [7.0, 1.0]
    (package / "system.py").write_text(SYSTEM.replace("2.0", "5.0"))
    assert answer() == [16.0, 0.0]

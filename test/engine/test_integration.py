"""Each Runge and Kutta method has the order it is named for, and its dense output and error estimate theirs.

The problem is Kepler's ellipse with its exact position by Kepler's equation, which shares nothing with the engine.
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

from mech_twin.engine.integration import (
    controlled_step,
    finish_step,
    interpolate,
    prepare_dense_output,
    rates_of,
    start_step,
    step_error,
    take_step,
    workspace,
)
from mech_twin.engine.tableaus import COOPER_VERNER_8, DORMAND_PRINCE_5, DORMAND_PRINCE_8
from mech_twin.kernel import kernel

ECCENTRICITY = 0.3


class Planet8(NamedTuple):
    """The two-body problem, by Cooper and Verner."""

    pull: float


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


METHODS = {Planet8: COOPER_VERNER_8, Planet853: DORMAND_PRINCE_8, Planet5: DORMAND_PRINCE_5}
for planet, tableau in METHODS.items():
    rates_of(planet, tableau)(_pull)
DENSE_ORDER = {Planet8: 3, Planet853: 7, Planet5: 4}
every_method = pytest.mark.parametrize("planet", METHODS, ids=lambda planet: planet.__name__)


def ellipse(t):
    """Return the exact state on the ellipse of half-axis 1, in perihelion at t = 0."""
    e = ECCENTRICITY
    anomaly = brentq(lambda x: x - e * math.sin(x) - t, -1.0, t + 2.0, xtol=1e-15, rtol=1e-15)
    c, s, root = math.cos(anomaly), math.sin(anomaly), math.sqrt(1.0 - e * e)
    fast = 1.0 / (1.0 - e * c)
    return np.array([c - e, root * s, -s * fast, root * c * fast])


def error_after(planet, span, steps):
    system, work, y, h = planet(1.0), workspace(METHODS[planet], 4), ellipse(0.0), span / steps
    for i in range(steps):
        start_step(system, i * h, y, work)
        take_step(system, i * h, y, h, work)
        y = work.end.copy()
    return np.abs(y - ellipse(span)).max()


@every_method
def test_error_falls_with_the_order_of_the_method(planet):
    steps = {5: 60, 8: 24}[METHODS[planet].order]
    coarse, fine = error_after(planet, 2.0, steps), error_after(planet, 2.0, 2 * steps)
    assert math.log2(coarse / fine) == pytest.approx(METHODS[planet].order, abs=0.5)


@every_method
def test_dense_output_meets_both_ends_and_falls_with_its_order(planet):
    system, work, out, y = planet(1.0), workspace(METHODS[planet], 4), np.empty(4), ellipse(0.7)
    errors = []
    for h in {3: (0.1, 0.05), 4: (0.1, 0.05), 7: (0.4, 0.2)}[DENSE_ORDER[planet]]:
        start_step(system, 0.0, y, work)
        take_step(system, 0.0, y, h, work)
        finish_step(system, 0.0, h, work)
        prepare_dense_output(system, 0.0, y, h, work)
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


@pytest.mark.parametrize("planet", [Planet853, Planet5], ids=["853", "5"])
def test_error_estimate_falls_with_its_order(planet):
    system, work, y = planet(1.0), workspace(METHODS[planet], 4), ellipse(0.3)
    estimates = []
    for h in (0.2, 0.1):
        start_step(system, 0.0, y, work)
        take_step(system, 0.0, y, h, work)
        finish_step(system, 0.0, h, work)
        estimates.append(step_error(system, h, np.full(4, 1.0), work))
    assert math.log2(estimates[0] / estimates[1]) == pytest.approx(METHODS[planet].error_order + 1, abs=0.6)


@pytest.mark.parametrize("planet", [Planet853, Planet5], ids=["853", "5"])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
def test_controlled_steps_keep_their_tolerance(planet, tolerance):
    system, work, y, t, h = planet(1.0), workspace(METHODS[planet], 4), ellipse(0.0), 0.0, 1.0
    steps = 0
    while t < 6.0:
        start_step(system, t, y, work)
        taken, h = controlled_step(system, t, y, min(h, 6.0 - t), np.full(4, tolerance), work)
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
from mech_twin.engine.tableaus import DORMAND_PRINCE_5

class Growth(NamedTuple):
    rate: float

@rates_of(Growth, DORMAND_PRINCE_5)
def growth(system, t, y, out):
    out[0] = 2.0 * system.rate
"""
CALL = """
import numpy as np
from mech_twin.engine.integration import start_step, take_step, workspace
from mech_twin.engine.tableaus import DORMAND_PRINCE_5
from growth_trial.system import Growth
work, y = workspace(DORMAND_PRINCE_5, 1), np.array([1.0])
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

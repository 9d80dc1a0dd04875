# SPDX-License-Identifier: Apache-2.0
"""A profile ends where the misfit of a model with a known answer has risen, and is open where it never does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy import optimize, stats

from mech_twin.studies.identification.fit_problem import KEY, Unknown, Unknowns
from mech_twin.studies.identification.fit_quality import Fitted
from mech_twin.studies.identification.intervals import Linearised
from mech_twin.studies.identification.refits import key_profile

TIMES = np.linspace(0.0, 3.0, 120)
NOISE = 0.01 * np.random.default_rng(2).standard_normal(len(TIMES))


@dataclass
class Decay:
    """Curve ``a (1 - exp(-k t))``, whose rate k has no upper limit once the curve ends before the first sample.

    It has what a fit asks of a problem: residuals in standard deviations, their derivatives, and unknowns.
    """

    true: tuple[float, float]
    unknowns: Unknowns = field(init=False)

    def __post_init__(self) -> None:
        names = (("size", 0.0, 10.0), ("rate", 0.0, 1e6))
        every = tuple(Unknown(KEY, name, (0,), i, 1.0, low, high) for i, (name, low, high) in enumerate(names))
        self.unknowns = Unknowns(every, np.array(self.true))

    def prepare(self, points: Sequence[np.ndarray]) -> None:
        """Nothing is simulated."""

    def residuals(self, x: np.ndarray, _: Any = None) -> np.ndarray:
        curves = [size * -np.expm1(-rate * (TIMES + 0.05)) for size, rate in (self.true, x)]
        return (curves[0] + NOISE - curves[1]) / 0.01

    def jacobian(self, x: np.ndarray, *_: Any) -> np.ndarray:
        gone = np.exp(-x[1] * (TIMES + 0.05))
        return np.column_stack([-(1.0 - gone), -x[0] * (TIMES + 0.05) * gone]) / 0.01

    def fitted(self) -> tuple[Any, Linearised]:
        low, high = self.unknowns.bounds()
        x = optimize.least_squares(self.residuals, self.true, self.jacobian, (low, high), loss="soft_l1", f_scale=3.0).x
        rows, columns = self.residuals(x), self.jacobian(x)
        nothing = np.zeros(len(rows), dtype=np.int64)
        return Fitted(self, x, None), Linearised(columns, columns, rows, nothing, nothing, nothing)  # type: ignore[arg-type]


def profile_by_search(problem: Decay, found: Any, line: Linearised, sign: float) -> float:
    """Return the same end by minimising over the size at each rate, and searching the rate."""

    def cost(rows: np.ndarray) -> float:
        return float(np.sum(18.0 * (np.sqrt(1.0 + (rows / 3.0) ** 2) - 1.0)))

    freedom = len(TIMES) - 2
    sought = float(line.residuals @ line.residuals) / freedom * stats.t.ppf(0.975, freedom) ** 2

    def rise(away: float) -> float:
        rate = found.x[1] + sign * away
        best = optimize.minimize_scalar(lambda size: cost(problem.residuals(np.array([size, rate]))))
        return float(best.fun) - cost(problem.residuals(found.x)) - sought

    return float(optimize.brentq(rise, 0.0, 0.999 * found.x[1] if sign < 0.0 else 100.0 * found.x[1]))


@pytest.mark.parametrize(("rate", "sign"), [(70.0, -1.0), (70.0, 1.0), (100.0, -1.0)])
def test_the_ends_are_those_of_a_search_at_every_rate(rate: float, sign: float) -> None:
    problem = Decay((1.0, rate))  # nearly at its end at the first sample: the misfit is no parabola in the rate
    found, line = problem.fitted()
    profile = key_profile(found, line, 1)
    end = profile.lower if sign < 0.0 else profile.upper
    assert end == pytest.approx(profile_by_search(problem, found, line, sign), rel=0.15)


def test_a_rate_of_which_only_the_least_is_told_is_open_above() -> None:
    problem = Decay((1.0, 150.0))
    found, line = problem.fitted()
    profile = key_profile(found, line, 1)
    assert profile.lower == pytest.approx(profile_by_search(problem, found, line, -1.0), rel=0.15)
    assert np.isinf(profile.upper)


def test_what_the_derivatives_tell_is_not_followed() -> None:
    problem = Decay((1.0, 1.2))
    found, line = problem.fitted()
    assert all(np.isnan(key_profile(found, line, place).lower) for place in range(2))


def test_a_fit_that_had_not_ended_is_told_of_a_better_place() -> None:
    problem = Decay((1.0, 30.0))
    found, _ = problem.fitted()
    x = found.x * np.array([1.0, 1.15])
    rows, columns = problem.residuals(x), problem.jacobian(x)
    nothing = np.zeros(len(rows), dtype=np.int64)
    early = Fitted(problem, x, None)  # type: ignore[arg-type]
    better = key_profile(early, Linearised(columns, columns, rows, nothing, nothing, nothing), 1).better
    assert better is not None
    assert np.sum(problem.residuals(better) ** 2) < np.sum(rows**2)

# SPDX-License-Identifier: Apache-2.0
"""A machine's design problem: variables, constraints, objectives, and results repeated with a shorter coupling step."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.arguments import bounds_by_name, by_name, real_number
from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import StudyError

Array = NDArray[np.float64]


class InShorterSteps(NamedTuple):
    """Results of a run by name with a coupling step (s), compared with one of a longer step (s)."""

    step_s: float
    beside_s: float
    numbers: Mapping[str, float]


class Evaluation(NamedTuple):
    """Objectives, shape (n, k), and margins of the constraints (negative: violated), shape (n, m), of n designs."""

    objectives: Array
    margins: Array

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Mask of the designs that satisfy every constraint."""
        return np.asarray((self.margins >= 0.0).all(axis=1))


@dataclass(frozen=True)
class DesignSpace:
    """Bounds of the variables, SI units, and the limits of the constraints by name."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    limits: Mapping[str, float]

    def designs(self, unit: Array) -> Array:
        """Return designs (n, variables) from numbers between 0 and 1 of the same shape."""
        low, high = np.array(self.lower), np.array(self.upper)
        return np.asarray(low + unit * (high - low), dtype=np.float64)


@dataclass(frozen=True)
class Design:
    """A design: variables, objectives and margins by name, and the configuration they were computed from.

    ``in_shorter_steps`` has objectives and margins of a run with shorter steps; None if they come from no run.
    """

    variables: dict[str, float]
    objectives: dict[str, float]
    margins: dict[str, float]
    parameters: Parameters
    in_shorter_steps: InShorterSteps | None = None


class DesignQuestion(NamedTuple):
    """Design problem of a machine.

    Attributes
    ----------
    variables : mapping
        Usual bounds of each variable, unit in its name.
    limits : mapping
        Usual limit of each constraint, unit in its name.
    objectives : mapping
        Sense of each: 1 to minimise, -1 to maximise; the first is the default.
    evaluate : callable
        ``evaluate(parameters, space, designs)``: evaluates many designs, rows of the variables.
    search : callable
        ``search(parameters, space, objectives, seed, points)``: the best design for one objective, or the Pareto front
        of several with so many refined directions; the same for the same seed.
    """

    variables: Mapping[str, tuple[float, float]]
    limits: Mapping[str, float]
    objectives: Mapping[str, float]
    evaluate: Callable[[Any, DesignSpace, Array], Evaluation]
    search: Callable[[Any, DesignSpace, tuple[str, ...], int, int], list[Design]]

    def space(
        self, bounds: Mapping[str, tuple[float, float]] | None = None, limits: Mapping[str, float] | None = None
    ) -> DesignSpace:
        """Return the usual space with changed bounds and limits; a variable may be named without its unit.

        Raises
        ------
        StudyError
            For an unknown name, bounds that are not ``0 < low <= high``, or a limit that is not a number >= 0.
        """
        names = {name.rsplit("_", 1)[0]: name for name in self.variables} | {name: name for name in self.variables}
        asked = dict(self.variables)
        for name, (low, high) in bounds_by_name("bounds", bounds, "bounds by name").items():
            if name not in names:
                raise StudyError(f"no variable '{name}' to bound; expected one of {', '.join(self.variables)}")
            if not 0.0 < low <= high < math.inf:
                raise StudyError(f"bounds of {name}: 0 < {low:g} <= {high:g} fails")
            asked[names[name]] = (low, high)
        wanted = by_name("limits", limits, "numbers by name")
        for name, value in wanted.items():
            if name not in self.limits:
                raise StudyError(f"no limit '{name}'; expected one of {', '.join(self.limits)}")
            wanted[name] = real_number(f"limit {name}", value, "a number of 0 or more", 0.0)
        lower, upper = tuple(low for low, _ in asked.values()), tuple(high for _, high in asked.values())
        return DesignSpace(lower, upper, {**self.limits, **wanted})

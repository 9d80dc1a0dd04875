# SPDX-License-Identifier: Apache-2.0
"""Sizing of a machine's parts: constraints, question and answer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from mech_twin.capabilities.design import InShorterSteps
from mech_twin.declarations.quantity import Parameters

Table = Callable[[str], Mapping[str, Any]]  # returns an installed table by its name
NEAR = 5e-3  # of a limit: a constraint with a smaller margin is active


@dataclass(frozen=True)
class Constraint:
    """A value, its limit, and the side of the limit on which it must be."""

    name: str
    value: float
    limit: float
    side: Literal["below", "above"] = "below"

    @property
    def margin(self) -> float:
        """Margin to the limit, in its unit; negative if violated."""
        return self.limit - self.value if self.side == "below" else self.value - self.limit

    @property
    def holds(self) -> bool:
        """Whether the limit is satisfied, with a tolerance for rounding."""
        return self.margin >= -1e-9 * max(1.0, abs(self.limit))

    @property
    def binds(self) -> bool:
        """Whether the constraint is active: the value is at the limit."""
        return abs(self.margin) <= NEAR * max(abs(self.limit), 1e-12)

    @property
    def demand(self) -> str:
        """The inequality as text."""
        return f"{self.name} {'<=' if self.side == 'below' else '>='} {self.limit:.6g}"

    @property
    def text(self) -> str:
        """The constraint with its value as text."""
        return f"{self.demand} (has {self.value:.6g})"


@dataclass(frozen=True)
class Sizing:
    """Sizes by configuration key, complete configuration, constraints, active constraint, and the trade-off nearby.

    ``tolerance`` is the relative one of the keys ``uncertain`` for which ``constraints`` hold (0: as configured).
    ``in_shorter_steps`` has those ``metrics`` of a run with shorter steps; None if they come from no run.
    """

    machine: str
    objective: str
    sizes: dict[str, float | str]
    parameters: Parameters
    metrics: dict[str, float]
    constraints: tuple[Constraint, ...]
    binding: str
    trade_off: tuple[dict[str, float | str], ...] = ()
    tolerance: float = 0.0
    uncertain: tuple[str, ...] = ()
    in_shorter_steps: InShorterSteps | None = None


def binding_of(constraints: tuple[Constraint, ...], otherwise: str) -> str:
    """Return the violated constraints, else the active ones, as text; ``otherwise`` without any."""
    failing = [constraint.text for constraint in constraints if not constraint.holds]
    if failing:
        return "not met: " + "; ".join(failing)
    binding = [constraint.text for constraint in constraints if constraint.binds]
    return "; ".join(binding) or otherwise


class SizingQuestion(NamedTuple):
    """Sizing problem of a machine.

    Attributes
    ----------
    limits : mapping
        Usual value of each limit.
    objectives : tuple of str
        What may be minimised; the first is the default.
    answer : callable
        ``answer(parameters, limits, objective, table, tolerance)``: the sizes with the smallest objective within the
        limits; values that are not sized are those of ``parameters``.  ``tolerance`` is a relative one of assumed
        values: the limits hold in the worst case over the box in which each ranges from value x (1 - tolerance) to
        value x (1 + tolerance); 0 sizes the machine as configured.
    usual_tolerance : float, optional
        The default tolerance; None if the solver supports none, so that a value above 0 is rejected.
    """

    limits: Mapping[str, float]
    objectives: tuple[str, ...]
    answer: Callable[[Any, Mapping[str, float], str, Table, float], Sizing]
    usual_tolerance: float | None = None

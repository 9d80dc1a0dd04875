# SPDX-License-Identifier: Apache-2.0
"""The answer to a question of size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

from mech_twin.capabilities.shorter_steps import InShorterSteps
from mech_twin.declarations.quantity import Parameters

Table = Callable[[str], Mapping[str, Any]]  # an installed table by its name
NEAR = 5e-3  # of a limit: a constraint kept by less than this binds


@dataclass(frozen=True)
class Constraint:
    """A limit, on which side of it the value must lie, and the value."""

    name: str
    value: float
    limit: float
    side: Literal["below", "above"] = "below"

    @property
    def margin(self) -> float:
        """How far the value keeps the limit, in its unit; negative: it does not."""
        return self.limit - self.value if self.side == "below" else self.value - self.limit

    @property
    def holds(self) -> bool:
        """Whether the limit is kept, rounding apart."""
        return self.margin >= -1e-9 * max(1.0, abs(self.limit))

    @property
    def binds(self) -> bool:
        """Whether the value lies on the limit."""
        return abs(self.margin) <= NEAR * max(abs(self.limit), 1e-12)

    @property
    def demand(self) -> str:
        """What is asked."""
        return f"{self.name} {'<=' if self.side == 'below' else '>='} {self.limit:.6g}"

    @property
    def text(self) -> str:
        """The constraint in a few words."""
        return f"{self.demand} (has {self.value:.6g})"


@dataclass(frozen=True)
class Sizing:
    """Sizes by configuration key, the whole configuration, constraints, which binds, and the trade-off around it.

    ``tolerance`` is the relative tolerance of what is assumed, under which ``constraints`` hold (0: as configured).
    ``in_shorter_steps`` has the ``metrics`` that come from a run once more; None where they come from no run.
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
    in_shorter_steps: InShorterSteps | None = None


def binding_of(constraints: tuple[Constraint, ...], otherwise: str) -> str:
    """Return which constraints bind, those that fail first; ``otherwise`` where none does."""
    failing = [constraint.text for constraint in constraints if not constraint.holds]
    if failing:
        return "not met: " + "; ".join(failing)
    binding = [constraint.text for constraint in constraints if constraint.binds]
    return "; ".join(binding) or otherwise


class SizingAnswer(Protocol):
    """Sizes of a machine under limits."""

    def __call__(
        self, parameters: Any, limits: Mapping[str, float], objective: str, table: Table, tolerance: float, /
    ) -> Sizing:
        """Return the sizes with the smallest objective within the limits.

        Parameters
        ----------
        parameters : Parameters
            The machine's configuration; what is not sized is taken from it.
        limits : mapping
            Every limit by its name.
        objective : str
            What to make small.
        table : callable
            An installed table by its name.
        tolerance : float
            Relative tolerance of what is assumed: the limits hold in the worst case over the box that each assumed
            number spans, value x (1 - tolerance) to value x (1 + tolerance); 0 sizes the machine as configured.
        """
        ...


class SizingQuestion(NamedTuple):
    """How a machine is sized: its limits with their usual values, its objectives (the first is usual), the answer.

    ``usual_tolerance`` is the tolerance taken where none is asked for; None where the machine has no answer with one,
    and a tolerance above 0 is refused.
    """

    limits: Mapping[str, float]
    objectives: tuple[str, ...]
    answer: SizingAnswer
    usual_tolerance: float | None = None

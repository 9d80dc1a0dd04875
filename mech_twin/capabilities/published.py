# SPDX-License-Identifier: Apache-2.0
"""A row of the comparison: published number, computed number, error and verdict."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

Verdict = Literal[
    "reproduced",
    "reproduced with a stated change",
    "differs, explained",
    "contradicts itself",
    "not enough data",
    "not reproduced",
]
REPRODUCED: Verdict = "reproduced"
CHANGED: Verdict = "reproduced with a stated change"
DIFFERS: Verdict = "differs, explained"  # shown with its error and reason; not gated
CONTRADICTS: Verdict = "contradicts itself"
NO_DATA: Verdict = "not enough data"
FAILED: Verdict = "not reproduced"  # a gated row outside its tolerance: must not occur

Measure = Literal["relative", "absolute", "below", "above", "none"]


@dataclass(frozen=True)
class PublishedRow:
    """A published number and the computed one.

    ``measure`` defines ``error``: relative (computed/published - 1), absolute (computed - published), or the violation
    of a published limit (negative: satisfied).  A gated row must be within its tolerance; the others are reported with
    their actual error.
    """

    source: str
    figure_or_equation: str
    quantity: str
    inputs: str
    published: float | None
    computed: float | None
    error: float | None
    measure: Measure
    tolerance: float | None
    verdict: Verdict
    reason: str
    gated: bool

    @property
    def holds(self) -> bool:
        """Whether a gated row is within its tolerance; always true for a row that is not gated."""
        return self.verdict != FAILED

    def record(self) -> dict[str, Any]:
        """Return the row as plain values."""
        return {**asdict(self), "holds": self.holds}


def error_of(computed: float, published: float, measure: Measure) -> float:
    """Return the error as defined by the measure."""
    if measure == "relative":
        return computed / published - 1.0
    if measure == "above":
        return published - computed
    return computed - published


@dataclass(frozen=True)
class Literature:
    """Creates rows for one source, figure or equation, and inputs."""

    source: str
    item: str
    inputs: str

    def at(self, item: str, inputs: str | None = None) -> Literature:
        """Return the same source with another figure or equation, and other inputs if given."""
        return Literature(self.source, item, self.inputs if inputs is None else inputs)

    def gated(
        self,
        quantity: str,
        published: float,
        computed: float,
        reason: str,
        *,
        relative: float | None = None,
        absolute: float | None = None,
        verdict: Verdict = REPRODUCED,
    ) -> PublishedRow:
        """Return a gated row: it must be within a relative or an absolute tolerance."""
        measure: Measure = "relative" if relative is not None else "absolute"
        tolerance = relative if relative is not None else absolute
        return self._row(quantity, published, computed, measure, tolerance, verdict, reason, gated=True)

    def limit(
        self, quantity: str, published: float, computed: float, reason: str, side: Literal["below", "above"]
    ) -> PublishedRow:
        """Return a gated row: the computed value must be on this side of a published limit."""
        return self._row(quantity, published, computed, side, 0.0, REPRODUCED, reason, gated=True)

    def reported(
        self, quantity: str, published: float, computed: float, verdict: Verdict, reason: str, *, absolute: bool = False
    ) -> PublishedRow:
        """Return a row that reports its error without a gate; its verdict cannot be "reproduced"."""
        if verdict in (REPRODUCED, CHANGED):
            raise ValueError(f"{quantity}: a row without a tolerance is not '{verdict}'")
        measure: Measure = "absolute" if absolute else "relative"
        return self._row(quantity, published, computed, measure, None, verdict, reason, gated=False)

    def formula(self, quantity: str, printed: float, computed: float, reason: str) -> PublishedRow:
        """Return a row of a printed formula that contradicts itself, evaluated with our inputs: no printed number."""
        return self.reported(f"{quantity}, by the printed formula", printed, computed, CONTRADICTS, reason)

    def unknown(self, quantity: str, computed: float | None, reason: str) -> PublishedRow:
        """Return a row for a result published without the required inputs."""
        return PublishedRow(
            self.source, self.item, quantity, self.inputs, None, computed, None, "none", None, NO_DATA, reason, False
        )

    def _row(
        self,
        quantity: str,
        published: float,
        computed: float,
        measure: Measure,
        tolerance: float | None,
        verdict: Verdict,
        reason: str,
        *,
        gated: bool,
    ) -> PublishedRow:
        error = error_of(computed, published, measure)
        size = error if measure in ("below", "above") else abs(error)
        keeps = tolerance is None or (math.isfinite(error) and size <= tolerance)
        head, final_verdict = (self.source, self.item, quantity, self.inputs), verdict if keeps else FAILED
        return PublishedRow(*head, published, computed, error, measure, tolerance, final_verdict, reason, gated)

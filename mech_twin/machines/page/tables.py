# SPDX-License-Identifier: Apache-2.0
"""Tables of a page: linear interpolation between rows, numerical or symbolic, with the place of each kink."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, BeforeValidator, Field

from mech_twin.mechanics.code_generation import Number, floor_of, larger

MOST_ROWS = 50
LARGEST = 1e9
TURN_DEG = 360.0

Rows = tuple[tuple[float, float], ...]


def _rising(rows: Rows) -> Rows:
    if not 2 <= len(rows) <= MOST_ROWS:
        raise ValueError(f"expected 2 to {MOST_ROWS} rows, got {len(rows)}")
    if not all(abs(x) <= LARGEST for row in rows for x in row):
        raise ValueError(f"expected numbers up to {LARGEST:g}")
    for (before, _), (after, _) in pairwise(rows):
        if not after > before:
            raise ValueError(f"the first column must rise: {after:g} follows {before:g}")
    return rows


def _in_rows(value: Any) -> Any:
    """Return rows of two of the numbers of a ROS parameter, which holds no lists in a list."""
    flat = isinstance(value, list | tuple) and len(value) % 2 == 0 and all(isinstance(x, int | float) for x in value)
    return [*zip(value[::2], value[1::2], strict=True)] if flat else value


def _closed(rows: Rows) -> Rows:
    (first, begun), (last, ended) = rows[0], rows[-1]
    if last - first == TURN_DEG and begun != ended:
        raise ValueError(
            f"a table of {TURN_DEG:g} deg holds for every turn: its last value must be its first, {begun:g}, "
            f"got {ended:g}"
        )
    return rows


TableRows = Annotated[Rows, BeforeValidator(_in_rows), AfterValidator(_rising)]
TurnRows = Annotated[TableRows, AfterValidator(_closed)]


def table(unit: str, meaning: str, **options: Any) -> Any:
    """Return the field of a table of two columns."""
    return Field(description=meaning, json_schema_extra={"unit": unit, "live": False}, **options)


class Line(NamedTuple):
    """A table as a sum of ramps: value and slope before the first kink; place and slope change of each kink."""

    first_x: Number
    first: Number
    slope: Number
    bends: tuple[tuple[Number, Number], ...]

    def at(self, x: Number) -> Number:
        """Return the value."""
        value = self.first + self.slope * (x - self.first_x)
        for place, change in self.bends:
            value = value + change * larger(x - place, 0.0)
        return value

    def area(self, x: Number) -> Number:
        """Return the integral from the first row on."""
        way = x - self.first_x
        value = self.first * way + 0.5 * self.slope * (way * way)
        for place, change in self.bends:
            beyond = larger(x - place, 0.0)
            value = value + 0.5 * change * (beyond * beyond)
        return value


def bends_of(rows: Rows, *, held: bool) -> list[tuple[float, float]]:
    """Return place and slope change of each kink; beyond its ends a table is constant (``held``) or extrapolated."""
    slopes = [(after[1] - before[1]) / (after[0] - before[0]) for before, after in pairwise(rows)]
    if held:
        slopes = [0.0, *slopes, 0.0]
        places = [x for x, _ in rows]
    else:
        places = [x for x, _ in rows[1:-1]]
    return [(x, b - a) for x, (a, b) in zip(places, pairwise(slopes), strict=True)]


def line(rows: Rows, number: Any, *, held: bool) -> Line:
    """Return a table with its numbers converted by ``number``."""
    slope = 0.0 if held else (rows[1][1] - rows[0][1]) / (rows[1][0] - rows[0][0])
    bends = tuple((number(x), number(change)) for x, change in bends_of(rows, held=held))
    return Line(number(rows[0][0]), number(rows[0][1]), number(slope), bends)


def scaled_rows(rows: Rows, x: float) -> Rows:
    """Return a table with its first column in another unit."""
    return tuple((x * a, b) for a, b in rows)


def repeats(rows_deg: Rows) -> bool:
    """Return whether a table over an angle spans a whole turn, and so is periodic."""
    return rows_deg[-1][0] - rows_deg[0][0] == TURN_DEG


def wrapped(x: Number, first: Number, span: Number) -> Number:
    """Return a number brought into a span that begins at ``first``."""
    return x - span * floor_of((x - first) / span)


def instants(rows: Sequence[tuple[float, float]], period: float) -> list[float]:
    """Return the instants (s) of a table's kinks, or of a program's phases, within a period; the period is last."""
    return [*(x for x, _ in rows if 0.0 < x < period), period]

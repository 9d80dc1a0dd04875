# SPDX-License-Identifier: Apache-2.0
"""Results as Python objects: named numbers and columns that know their units, as frames, tables and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.errors import StudyError
from mech_twin.captions import titled, unit_of
from mech_twin.configuration_tree import configuration_tree
from mech_twin.dependencies import require_extra
from mech_twin.engine.invariants import Residual
from mech_twin.quantity import Parameters
from mech_twin.samples import Event

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from matplotlib.figure import Figure

    from mech_twin.studies.side_by_side import ComparedRun, Comparison

MOST_PANELS = 8
Value = TypeVar("Value")


class _WithUnits(Mapping[str, Value], Generic[Value]):
    """What cannot be changed and is known by names that end in their units."""

    def __init__(self, title: str, values: Mapping[str, Value]) -> None:
        self.title = title
        self._values = dict(values)

    def __getitem__(self, name: str) -> Value:
        if name not in self._values:
            raise KeyError(_unknown(name, self._values))
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each name, empty for pure numbers and words."""
        return {name: unit_of(name) for name in self._values}


class Numbers(_WithUnits[Any]):
    """Named numbers that cannot be changed; the names end in their units."""

    def __repr__(self) -> str:
        width = max((len(name) for name in self._values), default=0)
        rows = [f"  {name:<{width}}  {_shown(value)} {unit_of(name)}".rstrip() for name, value in self._values.items()]
        return "\n".join([self.title, *rows])

    def to_pandas(self) -> pandas.DataFrame:
        """Return a frame with the columns ``value`` and ``unit``, indexed by name; needs the extra 'pandas'."""
        require_extra("pandas")
        import pandas as pd

        rows = {"value": list(self._values.values()), "unit": list(self.units.values())}
        return pd.DataFrame(rows, index=pd.Index(list(self._values), name="quantity"))

    def to_arrow(self) -> pyarrow.Table:
        """Return a table of one row, the unit of each column in its metadata; needs the extra 'tables'."""
        return _arrow({name: [value] for name, value in self._values.items()})


class Columns(_WithUnits[NDArray[Any]]):
    """Columns of equal length that cannot be changed; the names end in their units.

    Parameters
    ----------
    title : str
        What the columns are.
    along : str
        Name of the column the others are drawn over.
    values : mapping of str to sequence
        The columns.
    """

    def __init__(self, title: str, along: str, values: Mapping[str, Sequence[Any] | NDArray[Any]]) -> None:
        super().__init__(title, {name: _frozen(column) for name, column in values.items()})
        self.along = along

    def __repr__(self) -> str:
        return f"{self.title}: {len(self[self.along])} rows of {', '.join(self._values)}"

    def to_pandas(self) -> pandas.DataFrame:
        """Return a frame, the units in its ``attrs``; needs the extra 'pandas'."""
        require_extra("pandas")
        import pandas as pd

        frame = pd.DataFrame({name: list(column) for name, column in self._values.items()})
        frame.attrs["units"] = self.units
        return frame

    def to_arrow(self) -> pyarrow.Table:
        """Return a table, the unit of each column in its metadata; needs the extra 'tables'."""
        return _arrow(self._values)

    def plot(self, *names: str) -> Figure:
        """Return a picture of columns over `along`, one panel for each unit; needs the extra 'plots'.

        Parameters
        ----------
        *names : str
            Columns to draw; those that vary if none is named, as far as `MOST_PANELS` units reach.
        """
        require_extra("plots")
        from mech_twin.capabilities.plots import house_style, sheet

        panels = self._panels(names)
        with house_style():
            figure, all_axes = sheet(len(panels), 1, height=1.2 + 1.9 * len(panels), sharex=True)
            for axes, (unit, drawn) in zip(all_axes, panels.items(), strict=True):
                for name in drawn:
                    axes.plot(self[self.along], self[name], label=name if len(drawn) > 1 else None)
                axes.set_ylabel(titled(drawn[0].rpartition(".")[2]) if len(drawn) == 1 else unit)
                if len(drawn) > 1:
                    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
            all_axes[0].set_title(self.title)
            all_axes[-1].set_xlabel(titled(self.along))
        return figure

    def _panels(self, names: Sequence[str]) -> dict[str, list[str]]:
        """Return the columns to draw by unit; those without one by what they are, such as velocity."""
        chosen = list(names) or [name for name, column in self._values.items() if _varies(column)]
        panels: dict[str, list[str]] = {}
        for name in chosen:
            if not np.issubdtype(self[name].dtype, np.number):
                raise TypeError(f"column '{name}' holds no numbers")
            if name != self.along:
                panels.setdefault(unit_of(name) or name.rpartition(".")[2], []).append(name)
        if not panels:
            raise ValueError(f"{self.title}: no column that varies along {self.along}")
        return dict(list(panels.items())[:MOST_PANELS]) if not names else panels


@dataclass(frozen=True)
class Run:
    """A simulated run.

    Attributes
    ----------
    machine : str
        Name of the machine.
    parameters : Parameters
        The validated configuration.
    summary : Numbers
        Closed-form numbers of a cycle and those of the run.
    samples : Columns
        Every number of every step.
    events : tuple of Event
        Impacts and changes of state in order of time, at their exact times.
    residuals : dict of Residual
        The worst of each residual and its limit; ``broken`` where the limit is exceeded.
    """

    machine: str
    parameters: Parameters
    summary: Numbers
    samples: Columns
    events: tuple[Event, ...]
    residuals: dict[str, Residual]

    @property
    def sound(self) -> bool:
        """Whether every residual stayed within its limit."""
        return not any(residual.broken for residual in self.residuals.values())

    def plot(self, *names: str) -> Figure:
        """Return a picture of samples over time; see `Columns.plot`."""
        return self.samples.plot(*names)

    def named(self, label: str) -> ComparedRun:
        """Return the run as one of the sides of a comparison."""
        from mech_twin.studies.side_by_side import ComparedRun

        broken = tuple(name for name, residual in self.residuals.items() if residual.broken)
        tree = configuration_tree(self.parameters)
        return ComparedRun(label, self.machine, tree, dict(self.summary), broken, dict(self.samples))

    def __repr__(self) -> str:
        return f"{self.summary!r}\n{len(self.events)} events, {'sound' if self.sound else 'a residual is broken'}"


@dataclass(frozen=True)
class RunComparison:
    """What differs between two runs; ``found`` has settings, numbers, and those beyond the tolerance."""

    found: Comparison
    sides: tuple[ComparedRun, ComparedRun]

    def plot(self, panels: int = 6) -> Figure:
        """Return a picture of the columns that differ most, the two runs over each other."""
        from mech_twin.studies.side_by_side import columns_apart, drawn_side_by_side

        names = columns_apart(*self.sides, panels)
        if not names:
            raise StudyError("nothing to draw: no column differs")
        figure: Figure = drawn_side_by_side(*self.sides, names)
        return figure


@dataclass(frozen=True)
class Analysis:
    """The closed-form analysis of a machine: numbers of one cycle, and columns over one turn of the crank."""

    machine: str
    parameters: Parameters
    summary: Numbers
    cycle: Columns

    def plot(self, *names: str) -> Figure:
        """Return a picture of the cycle over the crank angle; see `Columns.plot`."""
        return self.cycle.plot(*names)


def _frozen(column: Sequence[Any] | NDArray[Any]) -> NDArray[Any]:
    array = np.array(column)
    array.flags.writeable = False
    return array


def _varies(column: NDArray[Any]) -> bool:
    return bool(np.issubdtype(column.dtype, np.number) and column.ndim == 1 and np.ptp(column) > 0.0)


def _arrow(values: Mapping[str, Sequence[Any] | NDArray[Any]]) -> pyarrow.Table:
    require_extra("tables")
    import pyarrow as pa

    arrays = [pa.array(list(column)) for column in values.values()]
    fields = [
        pa.field(name, array.type, metadata={"unit": unit_of(name)}) for name, array in zip(values, arrays, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _unknown(name: str, known: Mapping[str, Any]) -> str:
    near = get_close_matches(name, known, 3)
    return f"no '{name}'" + (f"; did you mean {' or '.join(near)}?" if near else f"; there are {', '.join(known)}")

# SPDX-License-Identifier: Apache-2.0
"""Named numbers and columns with units, exportable as data frames, tables and figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.plots import house_style, sheet
from mech_twin.declarations.captions import axis_title, titled, unit_of, unknown_name
from mech_twin.errors import StudyError, UnknownNameError
from mech_twin.files.report_page import shown
from mech_twin.process.dependencies import require_extra

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from matplotlib.figure import Figure

MOST_PANELS = 8
Value = TypeVar("Value")


class _WithUnits(Mapping[str, Value]):
    """Immutable mapping by names that end in their units."""

    def __init__(
        self, title: str, values: Mapping[str, Value], units: Mapping[str, str] = MappingProxyType({})
    ) -> None:
        self.title = title
        self._values = dict(values)
        self._units = {name: unit_of(name) or units.get(name, "") for name in values}

    def __getitem__(self, name: str) -> Value:
        if name not in self._values:
            raise UnknownNameError(unknown_name(name, self._values))
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each name, empty for dimensionless numbers and strings."""
        return dict(self._units)


class Numbers(_WithUnits[Any]):
    """Immutable named numbers; the names end in their units."""

    def __repr__(self) -> str:
        width = max((len(name) for name in self._values), default=0)
        rows = [
            f"  {name:<{width}}  {shown(value)} {self._units[name]}".rstrip() for name, value in self._values.items()
        ]
        return "\n".join([self.title, *rows])

    def to_pandas(self) -> pandas.DataFrame:
        """Return a DataFrame with the columns ``value`` and ``unit``, indexed by name; needs the extra 'pandas'."""
        require_extra("pandas")
        import pandas as pd

        rows = {"value": list(self._values.values()), "unit": list(self.units.values())}
        return pd.DataFrame(rows, index=pd.Index(list(self._values), name="quantity"))

    def to_arrow(self) -> pyarrow.Table:
        """Return a table of one row with the unit of each column in its metadata; needs the extra 'tables'."""
        return _arrow({name: [value] for name, value in self._values.items()}, self._units)


class Columns(_WithUnits[NDArray[Any]]):
    """Immutable columns of equal length; the names end in their units.

    Parameters
    ----------
    along : str
        Name of the column on the horizontal axis.
    units : mapping of str to str
        Units of columns whose names do not end in theirs, such as the position of a joint.
    """

    def __init__(
        self,
        title: str,
        along: str,
        values: Mapping[str, Sequence[Any] | NDArray[Any]],
        units: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        super().__init__(title, {name: _frozen(column) for name, column in values.items()}, units)
        self.along = along

    def __repr__(self) -> str:
        return f"{self.title}: {len(self[self.along])} rows of {', '.join(self._values)}"

    def to_pandas(self) -> pandas.DataFrame:
        """Return a DataFrame with the units in its ``attrs``; needs the extra 'pandas'."""
        require_extra("pandas")
        import pandas as pd

        frame = pd.DataFrame({name: list(column) for name, column in self._values.items()})
        frame.attrs["units"] = self.units
        return frame

    def to_arrow(self) -> pyarrow.Table:
        """Return a table with the unit of each column in its metadata; needs the extra 'tables'."""
        return _arrow(self._values, self._units)

    def plot(self, *names: str) -> Figure:
        """Return a figure of columns over `along`, one panel for each unit; needs the extra 'plots'.

        Rows that share a place, as those of a sweep of two keys, are points and no line.

        Parameters
        ----------
        *names : str
            Columns to plot; if none is given, those that vary, of the first `MOST_PANELS` units.
        """
        require_extra("plots")

        panels, along = self._panels(names), self[self.along]
        line = "-" if len(set(along.tolist())) == len(along) else "."
        with house_style():
            figure, all_axes = sheet(len(panels), 1, height=1.2 + 1.9 * len(panels), sharex=True)
            for axes, (unit, drawn) in zip(all_axes, panels.items(), strict=True):
                for name in drawn:
                    axes.plot(along, self[name], line, label=name if len(drawn) > 1 else None)
                axes.set_ylabel(axis_title(drawn[0], self._units[drawn[0]]) if len(drawn) == 1 else unit)
                if len(drawn) > 1:
                    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
            all_axes[0].set_title(self.title)
            all_axes[-1].set_xlabel(titled(self.along))
        return figure

    def _panels(self, names: Sequence[Any]) -> dict[str, list[str]]:
        """Return the columns to plot by unit; those without a unit by their last word, such as velocity."""
        if not len(self[self.along]):
            raise StudyError(
                f"{self.title}: no rows; JSON output holds those of a run with --samples, of an analysis with --cycle"
            )
        varying = (name for name, column in self._values.items() if column.ndim == 1 and column.dtype.kind in "iuf")
        chosen = list(names) or [name for name in varying if np.ptp(self[name]) > 0.0]
        panels: dict[str, list[str]] = {}
        for name in chosen:
            if not isinstance(name, str):
                raise StudyError(f"column {name!r}: expected names of columns, one by one")
            if not np.issubdtype(self[name].dtype, np.number):
                raise StudyError(f"column '{name}' holds no numbers")
            if name != self.along:
                panels.setdefault(self._units[name] or name.rpartition(".")[2], []).append(name)
        if not panels:
            raise StudyError(f"{self.title}: no column that varies along {self.along}")
        return dict(list(panels.items())[:MOST_PANELS]) if not names else panels


def _frozen(column: Sequence[Any] | NDArray[Any]) -> NDArray[Any]:
    array = np.array(column)
    array.flags.writeable = False
    return array


def _arrow(values: Mapping[str, Sequence[Any] | NDArray[Any]], units: Mapping[str, str]) -> pyarrow.Table:
    require_extra("tables")
    import pyarrow as pa

    arrays = [pa.array(list(column)) for column in values.values()]
    fields = [
        pa.field(name, array.type, metadata={"unit": units[name]}) for name, array in zip(values, arrays, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))

# SPDX-License-Identifier: Apache-2.0
"""Results as Python objects: runs, analyses, sizes and comparisons, with numbers, data frames and figures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mech_twin.capabilities.sizing import Sizing
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.trajectory import Residual
from mech_twin.errors import StudyError
from mech_twin.measurements.columns import Columns, Numbers
from mech_twin.process.dependencies import require_extra
from mech_twin.roles import own_name
from mech_twin.samples import Event

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from matplotlib.figure import Figure

    from mech_twin.studies.run_comparison import ComparedRun, Comparison

__all__ = ["Analysis", "Columns", "Numbers", "Run", "RunComparison", "SizingResult"]


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
        Closed-form numbers of a cycle and metrics of the run.
    samples : Columns
        All columns at every step.
    events : tuple of Event
        Impacts and changes of state in order of time, at their exact times.
    residuals : dict of Residual
        Worst value of each residual, and its limit; ``broken`` if the limit is exceeded.
    remarks : tuple of str
        Remarks on results outside the validity of the model.
    """

    machine: str
    parameters: Parameters
    summary: Numbers
    samples: Columns
    events: tuple[Event, ...]
    residuals: dict[str, Residual]
    remarks: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether every residual stayed within its limit."""
        return not any(residual.broken for residual in self.residuals.values())

    @cached_property
    def in_shorter_steps(self) -> Numbers:
        """Metrics of the run repeated with shorter coupling steps, computed at the first access.

        Digits that agree do not depend on the step; see `digits`.

        Raises
        ------
        StudyError
            The run has no samples, no shorter step is allowed, or the run with it fails.
        """
        from mech_twin.parameters.load import catalogue_entry
        from mech_twin.studies.shorter_steps import checked_numbers

        times = self.samples["time_s"]
        if not len(times):
            raise StudyError(f"{self.machine}: expected a run with samples, which tell its duration")
        machine = catalogue_entry(self.machine).build(self.parameters)
        found = checked_numbers(machine, float(times[-1]), set(self.summary) - set(machine.report()))
        return Numbers(f"{self.summary.title}, in shorter steps", dict(found.numbers))

    @property
    def digits(self) -> dict[str, Any]:
        """Every number with the digits that do not depend on the step; both numbers if these are too few."""
        from mech_twin.studies.shorter_steps import in_common_digits

        return in_common_digits(self.summary, self.in_shorter_steps)

    def plot(self, *names: str) -> Figure:
        """Return a figure of samples over time; see `Columns.plot`."""
        return self.samples.plot(*names)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the samples as a DataFrame; see `Columns.to_pandas`."""
        return self.samples.to_pandas()

    def to_arrow(self) -> pyarrow.Table:
        """Return the samples as a table; see `Columns.to_arrow`."""
        return self.samples.to_arrow()

    def named(self, label: str) -> ComparedRun:
        """Return the run as one side of a comparison."""
        from mech_twin.studies.run_comparison import ComparedRun

        broken = tuple(name for name, residual in self.residuals.items() if residual.broken)
        tree = configuration_tree(self.parameters)
        return ComparedRun(
            label, self.machine, tree, dict(self.summary), broken, dict(self.samples), self.samples.units
        )

    def __repr__(self) -> str:
        return f"{self.summary!r}\n{len(self.events)} events, {'sound' if self.sound else 'a residual is broken'}"


@dataclass(frozen=True, repr=False)
class RunComparison:
    """Differences of two runs; ``found`` has settings, numbers, and those beyond the tolerance.

    ``sides`` are the two runs; empty if the comparison was read from a document.
    """

    found: Comparison
    sides: tuple[ComparedRun, ComparedRun] | tuple[()] = ()

    def __repr__(self) -> str:
        found = self.found
        settings = [f"  {item.name}: {item.first}, {item.second}" for item in found.settings]
        apart = f"{len(found.beyond)} of {len(found.numbers)} numbers differ by more than {found.tolerance:g}"
        return "\n".join([f"{found.machine}: {' and '.join(found.labels)}", *settings, apart])

    def to_pandas(self) -> pandas.DataFrame:
        """Return every number of both sides and its relative difference, by name; needs the extra 'pandas'."""
        require_extra("pandas")
        import pandas as pd

        rows = [item[1:] for item in self.found.numbers]
        index = pd.Index([item.name for item in self.found.numbers], name="quantity")
        return pd.DataFrame(rows, index=index, columns=[*self.found.labels, "relative"])

    def plot(self, panels: int = 6) -> Figure:
        """Return a figure of the columns that differ most, both runs in each panel."""
        from mech_twin.studies.run_comparison import columns_apart, drawn_side_by_side

        if not self.sides:
            raise StudyError("nothing to draw: the document of a comparison holds no columns of the two runs")
        names = columns_apart(*self.sides, panels)
        if not names:
            raise StudyError("nothing to draw: no column differs")
        figure: Figure = drawn_side_by_side(*self.sides, names)
        return figure


@dataclass(frozen=True, repr=False)
class Analysis:
    """The closed-form analysis of a machine: numbers of one cycle, and columns over one turn of the crank."""

    machine: str
    parameters: Parameters
    summary: Numbers
    cycle: Columns

    def __repr__(self) -> str:
        return f"{self.summary!r}\n{self.cycle!r}"

    def plot(self, *names: str) -> Figure:
        """Return a figure of the cycle over the crank angle; see `Columns.plot`."""
        return self.cycle.plot(*names)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the columns of the cycle as a DataFrame; see `Columns.to_pandas`."""
        return self.cycle.to_pandas()

    def to_arrow(self) -> pyarrow.Table:
        """Return the columns of the cycle as a table; see `Columns.to_arrow`."""
        return self.cycle.to_arrow()


@dataclass(frozen=True, repr=False)
class SizingResult(Sizing):
    """Sizes of a machine's parts (`Sizing`), exportable as a data frame and a figure."""

    def __repr__(self) -> str:
        name = own_name(self.machine, self.parameters)
        return f"{Numbers(f'{name}: least {self.objective}', self.sizes)!r}\nbinding: {self.binding}"

    def to_pandas(self) -> pandas.DataFrame:
        """Return the sizes with their units, by configuration key; needs the extra 'pandas'."""
        return Numbers(self.machine, self.sizes).to_pandas()

    @property
    def around(self) -> Columns:
        """Metrics at other choices near the result.

        Raises
        ------
        StudyError
            If the sizing has no trade-off.
        """
        if not self.trade_off:
            raise StudyError(f"{self.machine}: this sizing has no other choices to compare")
        names = list(self.trade_off[0])
        rows = {name: [row[name] for row in self.trade_off] for name in names}
        return Columns(f"{own_name(self.machine, self.parameters)}: around the choice", names[0], rows)

    def plot(self, *names: str) -> Figure:
        """Return a figure of the metrics near the result; see `Columns.plot`."""
        return self.around.plot(*names)

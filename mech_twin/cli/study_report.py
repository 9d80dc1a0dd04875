# SPDX-License-Identifier: Apache-2.0
"""The report of a study: machine, settings that are not as installed, question, tables, picture, versions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from mech_twin.capabilities.design import Design
from mech_twin.capabilities.sizing import Sizing
from mech_twin.cli.console import numbered, say, write_text
from mech_twin.cli.run_summary import in_common_digits
from mech_twin.declarations.captions import titled, unit_of
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.report_page import page, picture, section, versions
from mech_twin.studies.design_scan import DesignScan
from mech_twin.studies.parameter_sweep import Sweep
from mech_twin.studies.run_comparison import changed_settings
from mech_twin.studies.shorter_steps import told as digits_told

DPI = 120
MARGIN_DIGITS = 6  # beyond them a constraint binds
MOST_ROWS = 1000  # of a table; all of them are in the table that the study wrote


class Studied(NamedTuple):
    """What a study was asked, and its configuration; where a report is asked for, it is written."""

    asked: Any
    parameters: Parameters

    def report(self, title: str, options: Mapping[str, Any], parts: Callable[[], Sequence[str]]) -> None:
        """Write the report, if one is asked for: what was asked, and what was found."""
        asked, file = self.asked, self.asked.report
        if file is None:
            return
        changed = changed_settings(asked.machine, configuration_tree(self.parameters))
        head = [
            f"<p>{versions()}</p>",
            section("Settings that differ from the machine as installed", ("key", "installed", "here"), changed),
            section("Asked", ("option", "value"), list(_told(options))),
        ]
        write_text(file, page(f"{asked.machine}: {title}", [*head, *parts()]), force=True)
        say(f"wrote {file}")

    def options(self, *names: str) -> dict[str, Any]:
        """Return options by name."""
        return {name: getattr(self.asked, name) for name in names}


def report_sweep(studied: Studied, done: Sweep, names: Sequence[str]) -> None:
    """Write the report of a sweep, with these numbers of each point."""

    def parts() -> list[str]:
        axes = [(key, len(set(values)), min(values), max(values)) for key, values in _axes(done).items()]
        rows = [
            (*done.asked.changes(point.index).values(), *(point.numbers.get(name) for name in names), point.refused)
            for point in done.points[:MOST_ROWS]
        ]
        left = len(done.points) - len(rows)
        return [
            section("Varied", ("key", "values", "from", "to"), axes),
            "" if done.picture is None else picture(f"{studied.asked.machine}: sweep", done.picture),
            section("Points", (*done.asked.keys, *names, "refused"), rows),
            f"<p>{left} more points stand in {done.table.name}.</p>" if left > 0 else "",
        ]

    studied.report(f"sweep of {', '.join(done.asked.keys)}", {}, parts)


def constraint_rows(answer: Sizing) -> list[tuple[Any, ...]]:
    """Return what is asked and reached, the margin and its unit, and whether it binds, of each constraint."""
    beside = {} if answer.in_shorter_steps is None else answer.in_shorter_steps.numbers
    rows = []
    for c in answer.constraints:
        text, margin = c.text, c.margin
        if beside.get(c.name, c.value) != c.value:
            again = replace(c, value=beside[c.name])
            text = f"{c.demand} (has {digits_told(c.name, c.value, beside)})"
            margin = digits_told(c.name, c.margin, {c.name: again.margin})
        rows.append((text, margin, unit_of(c.name), "binds" if c.binds else "holds" if c.holds else "not met"))
    return rows


def report_sizing(studied: Studied, answer: Sizing) -> None:
    """Write the report of a sizing."""

    def parts() -> list[str]:
        trade_off = [tuple(row.values()) for row in answer.trade_off]
        metrics = in_common_digits(answer.metrics, answer.in_shorter_steps)
        return [
            f"<p>Objective: {answer.objective}; tolerance {answer.tolerance:g}; binding: {answer.binding}.</p>",
            section("Sizes", ("key", "value", "unit"), numbered(answer.sizes)),
            section("Numbers", ("quantity", "value", "unit"), numbered(metrics)),
            section("Constraints", ("constraint", "margin", "unit", "state"), constraint_rows(answer)),
            section("Trade-off", tuple(answer.trade_off[0]) if trade_off else (), trade_off),
        ]

    studied.report("sizing", {}, parts)


def report_search(studied: Studied, found: Sequence[Design], options: Mapping[str, Any]) -> None:
    """Write the report of a search: the designs, and how far each is from its constraints."""
    objectives = options["objective"]
    margins = [{name: round(value, MARGIN_DIGITS) for name, value in each.margins.items()} for each in found]
    several = len(objectives) > 1
    studied.report(
        "Pareto front" if several else "best design",
        options,
        lambda: [
            _records("Designs", [{**each.variables, **each.objectives} for each in found]),
            _front(found, objectives) if several else "",
            _records("Margins of the constraints; 0 binds", margins),
        ],
    )


def report_designs(studied: Studied, found: DesignScan, best: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the report of a scan: how many designs are feasible, and the best for each objective."""
    counts = [("designs", found.designs), ("feasible", len(found.feasible)), ("feasible share", found.share)]
    rows = [{"best": name, **row} for name, row in best.items()]
    options = studied.options("count", "bound", "limit", "seed")
    studied.report(
        "designs", options, lambda: [section("Designs", ("quantity", "value"), counts), _records("Best designs", rows)]
    )


def _front(found: Sequence[Design], objectives: Sequence[str]) -> str:
    """Return the first two objectives of a front as a figure."""
    from mech_twin.capabilities.plots import house_style, sheet

    with house_style(), TemporaryDirectory() as folder:
        figure, (axes,) = sheet()
        axes.plot(*([each.objectives[name] for each in found] for name in objectives[:2]), "o")
        axes.set_xlabel(titled(objectives[0]))
        axes.set_ylabel(titled(objectives[1]))
        file = Path(folder) / "front.png"
        figure.savefig(file, dpi=DPI)
        return picture(f"Pareto front of {', '.join(objectives[:2])}", file)


def _records(title: str, rows: Sequence[Mapping[str, Any]]) -> str:
    return section(title, tuple(map(titled, rows[0])) if rows else (), [tuple(row.values()) for row in rows])


def _told(options: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the options that say something, those of a group one by one."""
    for name, value in options.items():
        if isinstance(value, Mapping):
            yield from _told(value)
        elif isinstance(value, list | tuple):
            yield from [(name, ", ".join(map(str, value)))] if value else []
        else:
            yield titled(name), value


def _axes(done: Sweep) -> dict[str, list[Any]]:
    changes = [done.asked.changes(point.index) for point in done.points]
    return {key: [each[key] for each in changes] for key in done.asked.keys}

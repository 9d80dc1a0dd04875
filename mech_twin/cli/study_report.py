# SPDX-License-Identifier: Apache-2.0
"""The report of a study: machine, settings that are not as installed, question, tables, picture, versions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from mech_twin.capabilities.design import Design
from mech_twin.capabilities.long_run import RegimeAnswer, SynthesisAnswer
from mech_twin.capabilities.sizing import Sizing
from mech_twin.cli.console import say
from mech_twin.cli.run_summary import in_common_digits
from mech_twin.declarations.captions import titled, unit_of
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.output_file import check_output_file, written_file
from mech_twin.files.report_page import page, picture, section, versions
from mech_twin.studies.design_scan import DesignScan
from mech_twin.studies.parameter_sweep import Sweep
from mech_twin.studies.run_comparison import changed_settings
from mech_twin.studies.shorter_steps import told as digits_told

DPI = 120
MARGIN_DIGITS = 6  # beyond them a constraint binds
MOST_ROWS = 1000  # of a table; all of them are in the table that the study wrote


def check_report(report: Path | None, *, force: bool) -> None:
    """Raise an OutputError where the report could not be written."""
    if report is not None:
        check_output_file(report, force=force, suffixes=(".html",))


def report_sweep(report: Path, done: Sweep, machine: str, parameters: Parameters, names: Sequence[str]) -> None:
    """Write the report of a sweep, with these numbers of each point."""
    axes = [(key, len(set(values)), min(values), max(values)) for key, values in _axes(done).items()]
    rows = [
        (*done.asked.changes(point.index).values(), *(point.numbers.get(name) for name in names), point.refused)
        for point in done.points[:MOST_ROWS]
    ]
    left = len(done.points) - len(rows)
    parts = [
        *_head(machine, parameters),
        section("Varied", ("key", "values", "from", "to"), axes),
        "" if done.picture is None else picture(f"{machine}: sweep", done.picture),
        section("Points", (*done.asked.keys, *names, "refused"), rows),
        f"<p>{left} more points stand in {done.table.name}.</p>" if left > 0 else "",
    ]
    _write(report, f"{machine}: sweep of {', '.join(done.asked.keys)}", parts)


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


def report_sizing(report: Path, answer: Sizing, parameters: Parameters) -> None:
    """Write the report of a sizing."""
    sizes = [(key, value, unit_of(key)) for key, value in answer.sizes.items()]
    metrics = in_common_digits(answer.metrics, answer.in_shorter_steps)
    numbers = [(key, value, unit_of(key)) for key, value in metrics.items()]
    trade_off = [tuple(row.values()) for row in answer.trade_off]
    parts = [
        *_head(answer.machine, parameters),
        f"<p>Objective: {answer.objective}; tolerance {answer.tolerance:g}; binding: {answer.binding}.</p>",
        section("Sizes", ("key", "value", "unit"), sizes),
        section("Numbers", ("quantity", "value", "unit"), numbers),
        section("Constraints", ("constraint", "margin", "unit", "state"), constraint_rows(answer)),
        section("Trade-off", tuple(answer.trade_off[0]) if trade_off else (), trade_off),
    ]
    _write(report, f"{answer.machine}: sizing", parts)


class Studied(NamedTuple):
    """What a study was asked: the file of its report, the machine, its configuration, and the options by name."""

    report: Path
    machine: str
    parameters: Parameters
    options: Mapping[str, Any]

    def write(self, title: str, parts: Sequence[str]) -> None:
        """Write the report: what was asked, and what was found."""
        asked = section("Asked", ("option", "value"), list(_told(self.options)))
        _write(self.report, f"{self.machine}: {title}", [*_head(self.machine, self.parameters), asked, *parts])


def report_search(asked: Studied, found: Sequence[Design]) -> None:
    """Write the report of a search: the designs, and how far each is from its constraints."""
    objectives = asked.options["objective"]
    margins = [{name: round(value, MARGIN_DIGITS) for name, value in each.margins.items()} for each in found]
    parts = [
        _records("Designs", [{**each.variables, **each.objectives} for each in found]),
        _front(found, objectives) if len(objectives) > 1 else "",
        _records("Margins of the constraints; 0 binds", margins),
    ]
    asked.write("Pareto front" if len(objectives) > 1 else "best design", parts)


def report_designs(asked: Studied, found: DesignScan) -> None:
    """Write the report of a scan: how many designs are feasible, and the best for each objective."""
    best = [{"best": name, **found.best(name)} for name in found.objectives] if len(found.feasible) else []
    counts = [("designs", found.designs), ("feasible", len(found.feasible)), ("feasible share", found.share)]
    asked.write("designs", [section("Designs", ("quantity", "value"), counts), _records("Best designs", best)])


def report_synthesis(asked: Studied, found: SynthesisAnswer) -> None:
    """Write the report of a synthesis: the cycles side by side."""
    titles = dict.fromkeys(title for cycle in found.cycles for title in cycle.lines)
    rows = [(title, *(cycle.lines.get(title, "-") for cycle in found.cycles)) for title in titles]
    heads = ("", *(cycle.name for cycle in found.cycles))
    asked.write("one-impact cycle", [section("Cycles", heads, rows), f"<p>Chosen: {found.chosen}.</p>"])


def report_regimes(asked: Studied, found: RegimeAnswer, file: Path) -> None:
    """Write the report of a map of regimes, with its picture where that is one for a page."""
    drawn = picture(f"{asked.machine}: regimes", file) if file.suffix == ".png" else ""
    asked.write(f"regimes over {found.key}", [drawn, section("Regimes", found.columns, found.rows[:MOST_ROWS])])


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


def _head(machine: str, parameters: Parameters) -> list[str]:
    changed = changed_settings(machine, configuration_tree(parameters))
    heads = ("key", "installed", "here")
    return [f"<p>{versions()}</p>", section("Settings that differ from the machine as installed", heads, changed)]


def _axes(done: Sweep) -> dict[str, list[Any]]:
    changes = [done.asked.changes(point.index) for point in done.points]
    return {key: [each[key] for each in changes] for key in done.asked.keys}


def _write(report: Path, title: str, parts: Sequence[str]) -> None:
    with written_file(report, force=True) as file:
        file.write_text(page(title, parts), encoding="utf-8")
    say(f"wrote {report}")

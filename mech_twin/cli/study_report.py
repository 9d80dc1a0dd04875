# SPDX-License-Identifier: Apache-2.0
"""The report of a study: machine, settings that are not as installed, question, tables, picture, versions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mech_twin.capabilities.sizing import Sizing
from mech_twin.cli.console import say
from mech_twin.declarations.captions import unit_of
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.output_file import check_output_file, written_file
from mech_twin.files.report_page import page, picture, section, versions
from mech_twin.studies.parameter_sweep import Sweep
from mech_twin.studies.run_comparison import changed_settings

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


def report_sizing(report: Path, answer: Sizing, parameters: Parameters) -> None:
    """Write the report of a sizing."""
    sizes = [(key, value, unit_of(key)) for key, value in answer.sizes.items()]
    numbers = [(key, value, unit_of(key)) for key, value in answer.metrics.items()]
    held = [
        (c.text, c.margin, unit_of(c.name), "binds" if c.binds else "holds" if c.holds else "not met")
        for c in answer.constraints
    ]
    trade_off = [tuple(row.values()) for row in answer.trade_off]
    parts = [
        *_head(answer.machine, parameters),
        f"<p>Objective: {answer.objective}; tolerance {answer.tolerance:g}; binding: {answer.binding}.</p>",
        section("Sizes", ("key", "value", "unit"), sizes),
        section("Numbers", ("quantity", "value", "unit"), numbers),
        section("Constraints", ("constraint", "margin", "unit", "state"), held),
        section("Trade-off", tuple(answer.trade_off[0]) if trade_off else (), trade_off),
    ]
    _write(report, f"{answer.machine}: sizing", parts)


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

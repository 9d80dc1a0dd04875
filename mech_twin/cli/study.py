# SPDX-License-Identifier: Apache-2.0
"""What all answers of ``mech-twin study`` share: axes, limits and bounds as they are written, files, and the report."""

import math
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from mech_twin.capabilities.design import Design, InShorterSteps
from mech_twin.capabilities.progress import listening
from mech_twin.capabilities.sizing import Sizing
from mech_twin.cli.console import ShownTable, count_bar, numbers_table, print_tables, time_left_notice, write_text
from mech_twin.cli.option_values import assigned
from mech_twin.cli.study_verbs import HELP, Study
from mech_twin.declarations.captions import titled, unit_of
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.report_page import page, picture, section, versions
from mech_twin.parameters.load import scalar
from mech_twin.parameters.written_configuration import write_configuration
from mech_twin.studies.declared_studies import asked_of
from mech_twin.studies.run_comparison import changed_settings
from mech_twin.studies.shorter_steps import common_digits

MOST_VALUES = 1_000_000
RANGE = f"from:to:count, from:to:count:log or a,b,c; 1 to {MOST_VALUES} finite values, above 0 where the range is log"
DPI = 120
MOST_ROWS = 1000  # of a table of a report; all of them are in the table that the study wrote


def axes_of(texts: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """Return keys and values of ``KEY=from:to:count``, ``KEY=from:to:count:log`` or ``KEY=a,b,c``."""
    return assigned("--over", texts, f"KEY={RANGE}", lambda values: (_range if ":" in values else _list)(values))


def _range(values: str) -> tuple[float, ...]:
    first, last, number, *rest = values.split(":")
    low, high, count, logarithmic = float(first), float(last), int(number), rest == ["log"]
    if (rest and not logarithmic) or not (math.isfinite(low) and math.isfinite(high)):
        raise ValueError(values)
    if not 1 <= count <= MOST_VALUES or (logarithmic and min(low, high) <= 0.0):
        raise ValueError(values)
    if count == 1:
        return (low,)
    if logarithmic:
        ratio = math.log(high / low) / (count - 1)
        return (low, *(low * math.exp(ratio * i) for i in range(1, count - 1)), high)
    return (low, *(low + (high - low) * i / (count - 1) for i in range(1, count - 1)), high)


def _list(values: str) -> tuple[Any, ...]:
    try:
        found = scalar(f"[{values}]")
    except yaml.YAMLError as error:
        raise ValueError(values) from error
    if not found or not all(isinstance(value, int | float | str | bool) for value in found):
        raise ValueError(values)
    return tuple(found)


def shows_limits(texts: Sequence[str], machine: str, capability: str) -> bool:
    """Show a study's limits with their usual values where ``help`` is asked for; return whether it was."""
    if HELP not in texts:
        return False
    question = asked_of(machine, capability, f"nothing to {capability}")
    usual = {name: "as configured" if math.isnan(value) else value for name, value in question.limits.items()}
    print_tables(numbers_table(f"{machine}: limits and their usual values", usual))
    return True


def limits_of(texts: Sequence[str]) -> dict[str, float]:
    """Return names and numbers of ``NAME=VALUE``."""
    number = ("NAME=NUMBER", lambda value: not math.isnan(value))
    return assigned("--limit", texts, "NAME=NUMBER", float, number)


def ranges_of(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return names and ranges of ``NAME=LOW:HIGH``, either left out where there is none; a number alone is HIGH."""

    def ends(values: str) -> tuple[float, float]:
        low, _, high = values.rpartition(":")
        return float(low or -math.inf), float(high or math.inf)

    return assigned("--limit", texts, "NAME=HIGH or NAME=LOW:HIGH", ends)


def bounds_of(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return names and bounds of ``NAME=LOW:HIGH``, or of ``NAME=VALUE`` for a variable that is held."""

    def ends(values: str) -> tuple[float, float]:
        low, _, high = values.partition(":")
        return float(low), float(high or low)

    rising = ("NAME=LOW:HIGH, LOW not above HIGH", lambda ends: ends[0] <= ends[1])
    return assigned("--bound", texts, "NAME=LOW:HIGH", ends, rising)


@contextmanager
def progress_of(title: str) -> Iterator[None]:
    """Show how far an answer says it is; where no terminal listens, how long it will take, once."""
    with count_bar(title) as bar, listening(bar or time_left_notice(title)):
        yield


def notes_of(**request: object) -> list[str]:
    """Return the header of a written file: the command and its options other than None."""
    command = f"  {shlex.join(['mech-twin', *sys.argv[1:]])}"
    return [command, *(f"{name}: {_listed(value)}" for name, value in request.items() if value is not None)]


def write_found(request: Study, parameters: Parameters, **found: object) -> None:
    """Write the configuration that was found; its head tells the command, and what was asked and found."""
    write_configuration(request.machine, parameters, request.output, request.config, notes_of(**found))


def _listed(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def write_report(
    request: Study,
    title: str,
    options: Mapping[str, Any],
    tables: Sequence[ShownTable],
    remarks: Sequence[str] = (),
    pictures: Sequence[str] = (),
) -> None:
    """Write the report, if one is asked for: what was asked, and what was found."""
    if request.report is None:
        return
    changed = changed_settings(request.machine, configuration_tree(request.parameters))
    asked = [(name, _listed(value)) for name, value in options.items() if value not in ((), [], None)]
    parts = [
        f"<p>{versions()}</p>",
        section("Settings that differ from the machine as installed", ("key", "installed", "here"), changed),
        section("Asked", ("option", "value"), asked),
        *(_section(each) for each in tables),
        *(f"<p>{escape(remark)}</p>" for remark in remarks),
        *pictures,
    ]
    write_text(request.report, page(f"{request.machine}: {title}", parts), force=True)


def _section(table: ShownTable) -> str:
    """Return a table of a report, the first rows of a long one."""
    count = len(table.rows)
    cut = f" (the first {MOST_ROWS} of {count})" if count > MOST_ROWS else ""
    return section(table.title + cut, table.heads, table.rows[:MOST_ROWS])


def options_of(request: Study, *names: str) -> dict[str, Any]:
    """Return options by name."""
    return {name: getattr(request, name) for name in names}


def numbers_beside(shorter: InShorterSteps | None) -> Mapping[str, float]:
    """Return the numbers of the run in shorter steps; none where there was no such run."""
    return {} if shorter is None else shorter.numbers


def constraint_rows(answer: Sizing) -> list[tuple[Any, ...]]:
    """Return limit, value, margin with unit, and whether it binds, for each constraint."""
    beside = numbers_beside(answer.in_shorter_steps)
    rows = []
    for c in answer.constraints:
        text, margin, shown = c.text, c.margin, common_digits(c.name, c.value, beside)
        if shown != c.value:
            again = replace(c, value=beside[c.name])
            text = f"{c.demand} (has {shown})"
            margin = common_digits(c.name, c.margin, {c.name: again.margin})
        rows.append((text, margin, unit_of(c.name), "binds" if c.binds else "holds" if c.holds else "not met"))
    return rows


def front_picture(found: Sequence[Design], objectives: Sequence[str]) -> str:
    """Return the first two objectives of a front as a figure of a report."""
    from mech_twin.capabilities.plots import house_style, sheet

    with house_style(), TemporaryDirectory() as folder:
        figure, (axes,) = sheet()
        axes.plot(*([each.objectives[name] for each in found] for name in objectives[:2]), "o")
        axes.set_xlabel(titled(objectives[0]))
        axes.set_ylabel(titled(objectives[1]))
        file = Path(folder) / "front.png"
        figure.savefig(file, dpi=DPI)
        return picture(f"Pareto front of {', '.join(objectives[:2])}", file)

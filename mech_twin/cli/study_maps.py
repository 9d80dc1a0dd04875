# SPDX-License-Identifier: Apache-2.0
"""Answers of ``mech-twin study MACHINE`` over a range of a key: ``sweep`` and ``regimes``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from mech_twin.cli.console import counted, print_csv, print_json, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.study_options import axes_of, checked_output, study_errors
from mech_twin.cli.study_report import MOST_ROWS, Studied, report_sweep
from mech_twin.cli.study_verbs import RegimesVerb, SweepVerb
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.files.output_file import check_output_file
from mech_twin.files.report_page import picture, section
from mech_twin.process.dependencies import require_extra
from mech_twin.studies import regimes, sweep
from mech_twin.studies.parameter_sweep import Sweep
from mech_twin.studies.sweep_points import Point
from mech_twin.studies.sweep_table import varies

SHOWN_ROWS = 20
TABLE = (".parquet", ".csv")
PICTURE = (".png", ".svg", ".pdf")


def answer_sweep(asked: SweepVerb) -> None:
    """Sweep, and say what was written."""
    table = checked_output(asked, "sweep.parquet", TABLE)
    if table.suffix != ".csv":
        require_extra("tables")
    if not asked.no_picture:
        check_output_file(table.with_suffix(".png"), force=asked.force)
        require_extra("plots")
    parameters = asked.parameters
    with study_errors(), counted("sweeping") as progress:
        try:
            done = sweep(
                asked.machine, axes_of(asked.over), table, parameters=parameters, outputs=tuple(asked.number),
                duration_s=asked.duration_s, cores=asked.cores, scheduler=asked.scheduler,
                picture=not asked.no_picture, progress=progress,
            )  # fmt: skip
        except KeyboardInterrupt:
            say(f"interrupted; finished points are kept beside {table}: the same command goes on from there")
            raise SystemExit(130) from None
    names, varying = done.outputs, _varying(done.points, done.outputs)
    report_sweep(Studied(asked, parameters), done, varying)
    if asked.as_json:
        print_json(_sweep_record(asked.machine, configuration_tree(parameters), done))
    elif asked.as_csv:
        print_csv((*done.asked.keys, *names, "refused"), [_cells(done, point, names, "") for point in done.points])
    else:
        _show_sweep(asked, done, varying)


def _sweep_record(machine: str, config: Any, done: Sweep) -> dict[str, Any]:
    rows = [{**done.asked.changes(point.index), **point.numbers, "refused": point.refused} for point in done.points]
    return {
        "machine": machine, "config": config, "points": len(done.points), "resumed": done.resumed,
        "refused": sum(bool(point.refused) for point in done.points), "table": str(done.table),
        "picture": None if done.picture is None else str(done.picture), "rows": rows,
    }  # fmt: skip


def _show_sweep(asked: SweepVerb, done: Sweep, varying: Sequence[str]) -> None:
    """Write the points, their numbers that vary, and what is left out."""
    names = done.outputs
    shown_names, shown = (names, done.points) if asked.everything else (varying, done.points[:SHOWN_ROWS])
    title = f"{asked.machine}: {len(done.points)} points, {len(names)} numbers"
    rows = [_cells(done, point, shown_names, "refused")[:-1] for point in shown]
    print_table(title, (*done.asked.keys, *shown_names), rows, wide=asked.everything, more="--all")
    left, fixed = len(done.points) - len(shown), len(names) - len(shown_names)
    omitted = [f"{left} more points"] * (left > 0) + [f"{fixed} numbers that do not vary"] * (fixed > 0)
    if omitted:
        say(f"{' and '.join(omitted)} with --all")
    refused = [point for point in done.points if point.refused]
    if refused:
        say(f"{len(refused)} points refused, the first: {refused[0].refused}")
    if done.resumed:
        say(f"{done.resumed} points were finished before")
    say(f"wrote {done.table}" + (f" and {done.picture}" if done.picture else ""))


def _cells(done: Sweep, point: Point, names: Sequence[str], absent: str) -> tuple[Any, ...]:
    numbers = (point.numbers.get(name, absent) for name in names)
    return (*done.asked.changes(point.index).values(), *numbers, point.refused)


def _varying(points: Sequence[Point], names: Sequence[str]) -> list[str]:
    """Return the numbers that are not the same at every point, rounding apart."""
    columns = {name: [point.numbers[name] for point in points if name in point.numbers] for name in names}
    return [name for name, column in columns.items() if varies(column)]


def answer_regimes(asked: RegimesVerb) -> None:
    """Show the regime at each value, equal ones that follow each other in one row; write the bifurcation picture."""
    machine, shape = asked.machine, asked.form
    out = checked_output(asked, "regimes.png", PICTURE, "plots")
    axes = axes_of(asked.over)
    if len(axes) != 1:
        raise CommandError("--over: a regime map has one key")
    ((key, values),) = axes.items()
    with study_errors(), counted("regimes") as progress:
        studied = Studied(asked, asked.parameters)
        found = regimes(
            machine, values, key, parameters=studied.parameters, settling_periods=asked.settling, progress=progress
        )
        found.write_picture(out)
    studied.report(
        f"regimes over {key}",
        studied.options("over", "settling"),
        lambda: [
            picture(f"{machine}: regimes", out) if out.suffix == ".png" else "",
            section("Regimes", found.columns, found.rows[:MOST_ROWS]),
        ],
    )
    if shape == "json":
        print_json({"machine": machine, "key": key, "regimes": found.records, "picture": out})
        return
    if shape == "csv":
        print_csv(found.columns, found.rows)
    elif shape == "wide":
        print_table("regimes", found.columns, found.rows, wide=True)
    else:
        spans = joined(found.rows)
        print_table("regimes", ("from", "to", *found.columns[1:]), spans)
        say(f"{len(found.rows)} values of {key} in {len(spans)} rows; each value with --all")
    say(f"wrote {out}")


def joined(rows: Sequence[Sequence[Any]]) -> list[tuple[Any, ...]]:
    """Return rows (value, regime, period, impacts, ..., blow) that follow each other with the same regime as one.

    It has the first and the last value, and of the last column the least and the greatest.
    """
    spans: list[tuple[Any, ...]] = []
    for _, run in groupby(rows, key=lambda row: tuple(row[1:-1])):
        group = list(run)
        blows = [row[-1] for row in group]
        least, most = min(blows), max(blows)
        shown = f"{least:.4g}" if least == most else f"{least:.4g} to {most:.4g}"
        spans.append((group[0][0], group[-1][0], *group[0][1:-1], shown))
    return spans

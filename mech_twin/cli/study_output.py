# SPDX-License-Identifier: Apache-2.0
"""Answers of ``mech-twin study MACHINE sweep`` and ``size``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mech_twin.capabilities.sizing import Sizing
from mech_twin.cli.console import print_csv, print_json, print_numbers, print_table, say
from mech_twin.cli.run_summary import how_told, in_common_digits, shorter_record
from mech_twin.cli.study_options import HELP, axes_of, counted, limits_of, notes_of, shows_limits, study_errors, told
from mech_twin.cli.study_report import check_report, constraint_rows, report_sizing, report_sweep
from mech_twin.cli.study_verbs import SizeVerb, SweepVerb
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.files.output_file import YAML_SUFFIXES, check_output_file
from mech_twin.parameters.load import assignments, machine_parameters
from mech_twin.parameters.written_configuration import write_configuration
from mech_twin.process.dependencies import require_extra
from mech_twin.studies import size, sweep
from mech_twin.studies.parameter_sweep import Sweep
from mech_twin.studies.sweep_points import Point
from mech_twin.studies.sweep_table import varies

SHOWN_ROWS = 20
TABLE = (".parquet", ".csv")


def answer_sweep(request: SweepVerb) -> None:
    """Sweep, and say what was written."""
    table = request.out or Path(f"{Path(request.machine).stem}-sweep.parquet")
    check_output_file(table, force=request.force, suffixes=TABLE)
    if not request.no_picture:
        check_output_file(table.with_suffix(".png"), force=request.force)
    check_report(request.report, force=request.force)
    if table.suffix != ".csv":
        require_extra("tables")
    if not request.no_picture:
        require_extra("plots")
    parameters = machine_parameters(request.machine, request.config, assignments(request.settings))
    with study_errors(), counted("sweeping") as progress:
        try:
            done = sweep(
                request.machine,
                axes_of(request.over),
                table,
                parameters=parameters,
                outputs=tuple(request.number),
                duration_s=request.duration_s,
                cores=request.cores,
                scheduler=request.scheduler,
                picture=not request.no_picture,
                progress=progress,
            )
        except KeyboardInterrupt:
            say(f"interrupted; finished points are kept beside {table}: the same command goes on from there")
            raise SystemExit(130) from None
    keys, names = done.asked.keys, done.outputs
    if request.report is not None:
        varied = _varying(done.points, names)
        report_sweep(request.report, done, request.machine, parameters, varied)
    if request.as_json:
        document: dict[str, Any] = {
            "machine": request.machine,
            "config": configuration_tree(parameters),
            "points": len(done.points),
            "resumed": done.resumed,
            "refused": sum(bool(point.refused) for point in done.points),
            "table": str(done.table),
            "picture": None if done.picture is None else str(done.picture),
            "rows": [
                {**done.asked.changes(point.index), **point.numbers, "refused": point.refused} for point in done.points
            ],
        }
        print_json(document)
        return
    if request.as_csv:
        print_csv((*keys, *names, "refused"), [_cells(done, point, names, "") for point in done.points])
        return
    varying = names if request.everything else _varying(done.points, names)
    shown = done.points if request.everything else done.points[:SHOWN_ROWS]
    title = f"{request.machine}: {len(done.points)} points, {len(names)} numbers"
    rows = [_cells(done, point, varying, "refused")[:-1] for point in shown]
    print_table(title, (*keys, *varying), rows, wide=request.everything, more="--all")
    left = len(done.points) - len(shown)
    fixed = len(names) - len(varying)
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


def answer_size(asked: SizeVerb) -> None:
    """Size, write the configuration, and say which constraint binds."""
    machine, config, limits = asked.machine, asked.config, asked.limit
    out = asked.out or Path(f"{Path(machine).stem}-sized.yaml")
    if HELP not in limits:
        check_output_file(out, force=asked.force, suffixes=YAML_SUFFIXES)
        check_report(asked.report, force=asked.force)
    if shows_limits(limits, machine, "sizing"):
        return
    parameters = machine_parameters(machine, config, assignments(asked.settings))
    with study_errors(), told(f"sizing {machine}"):
        answer = size(
            machine, parameters, limits=limits_of(limits), objective=asked.objective, tolerance=asked.tolerance
        )
        notes = notes_of(objective=answer.objective, tolerance=answer.tolerance, binding=answer.binding)
        write_configuration(machine, answer.parameters, out, config, notes)
    if asked.report is not None:
        report_sizing(asked.report, answer, parameters)
    if asked.as_json:
        print_json(
            {
                "machine": answer.machine,
                "config": configuration_tree(answer.parameters),
                "objective": answer.objective,
                "tolerance": answer.tolerance,
                "sizes": answer.sizes,
                "metrics": answer.metrics,
                "binding": answer.binding,
                "constraints": [
                    {
                        "name": c.name,
                        "value": c.value,
                        "limit": c.limit,
                        "side": c.side,
                        "holds": c.holds,
                        "binds": c.binds,
                    }
                    for c in answer.constraints
                ],
                "trade_off": answer.trade_off,
                "configuration": str(out),
                **shorter_record(answer.in_shorter_steps),
            }
        )
        return
    metrics = in_common_digits(answer.metrics, answer.in_shorter_steps)
    print_numbers(f"{machine}: sizes", {**answer.sizes, **metrics})
    print_table("constraints", ("constraint", "margin", "unit", "state"), constraint_rows(answer))
    if answer.trade_off:
        trade_off = [tuple(row.values()) for row in answer.trade_off]
        print_table("trade-off", tuple(answer.trade_off[0]), trade_off, marked=_chosen(answer))
    say(f"binding: {answer.binding}")
    if answer.tolerance > 0.0:
        say(f"holds with every assumed value off by up to {100.0 * answer.tolerance:g} %")
    if answer.in_shorter_steps is not None:
        say(how_told(answer.in_shorter_steps.beside_s, answer.in_shorter_steps.step_s))
    say(f"wrote {out}")


def _chosen(answer: Sizing) -> int | None:
    """Return the row of the trade-off with the sizes that were chosen, if one has all of them."""
    numbers = {**answer.metrics, **{key.replace(".", "_"): value for key, value in answer.sizes.items()}}
    for i, row in enumerate(answer.trade_off):
        shared = [name for name in row if name in numbers]
        if shared and all(_near(row[name], numbers[name]) for name in shared):
            return i
    return None


def _near(one: float | str, other: float | str) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    return math.isclose(one, other, rel_tol=1e-9)

# SPDX-License-Identifier: Apache-2.0
"""Answers of ``mech-twin study MACHINE``: each writes what it found to a file, and shows it."""

import math
import time
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from mech_twin.capabilities.design import Design
from mech_twin.cli import study
from mech_twin.cli.console import (
    INTERRUPTED,
    CommandError,
    ShownTable,
    count_bar,
    numbers_table,
    print_csv,
    print_json,
    print_table,
    print_tables,
    records_table,
    say,
)
from mech_twin.cli.run_summary import digits_note, shorter_record
from mech_twin.cli.study_verbs import DesignsVerb, RegimesVerb, SearchVerb, SizeVerb, SweepVerb, SynthesiseVerb
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.files.output_file import check_output_file
from mech_twin.files.report_page import picture
from mech_twin.process.dependencies import require_extra
from mech_twin.studies import designs, regimes, search, search_runs, size, sweep, synthesise
from mech_twin.studies.declared_studies import asked_of, searches_by_runs
from mech_twin.studies.design_scan import asked_objectives, design_question
from mech_twin.studies.parameter_sweep import Sweep
from mech_twin.studies.shorter_steps import in_common_digits
from mech_twin.studies.sweep_table import varies

POINTS = 9  # of a Pareto front
NO_QUESTION = "no design question; its runs are searched with --objective NAME and --bound KEY=LOW:HIGH"
ROBUST = ("margin", "basin_fraction", "tolerance", "stroke_ratio", "starts", "seed")  # what the cycle is asked for
SHOWN_ROWS = 20


def answer_size(request: SizeVerb) -> None:
    """Size, write the configuration, and say which constraint binds."""
    machine = request.machine
    if study.shows_limits(request.limit, machine, "sizing"):
        return
    out, parameters = request.output, request.parameters
    with study.progress_of(f"sizing {machine}"):
        limits = study.limits_of(request.limit)
        answer = size(machine, parameters, limits=limits, objective=request.objective, tolerance=request.tolerance)
        found = {name: getattr(answer, name) for name in ("objective", "tolerance", "binding")}
        study.write_found(request, answer.parameters, **found)
    shorter = answer.in_shorter_steps
    chosen = {**answer.metrics, **{key.replace(".", "_"): value for key, value in answer.sizes.items()}}
    marked = next((i for i, row in enumerate(answer.trade_off) if _is_chosen(row, chosen)), None)
    sizes = {**answer.sizes, **in_common_digits(answer.metrics, study.numbers_beside(shorter))}
    tables = [
        numbers_table(f"{machine}: sizes", sizes),
        ShownTable("constraints", ("constraint", "margin", "unit", "state"), study.constraint_rows(answer)),
        records_table("trade-off", answer.trade_off, marked),
    ]
    remarks = [f"binding: {answer.binding}"]
    if answer.tolerance > 0.0 and all(constraint.holds for constraint in answer.constraints):
        each = ", ".join(answer.uncertain)
        remarks.append(f"holds with each of these off by up to {100.0 * answer.tolerance:g} %: {each}")
    if shorter is not None:
        remarks.append(digits_note(shorter.beside_s, shorter.step_s))
    asked = {"objective": answer.objective, "limit": request.limit, "tolerance": answer.tolerance}
    study.write_report(request, "sizing", asked, tables, remarks)
    if request.as_json:
        shown = ("name", "value", "limit", "side", "holds", "binds")
        fields = ("objective", "tolerance", "uncertain", "sizes", "metrics", "binding")
        document = {name: getattr(answer, name) for name in fields}
        document["constraints"] = [{name: getattr(each, name) for name in shown} for each in answer.constraints]
        head = {"machine": answer.machine, "config": configuration_tree(answer.parameters)}
        tail = {"trade_off": answer.trade_off, "configuration": out, **shorter_record(shorter)}
        print_json({**head, **document, **tail})
        return
    print_tables(*tables)
    say(*remarks)


def _is_chosen(row: Mapping[str, float | str], numbers: Mapping[str, float | str]) -> bool:
    """Return whether a row of the trade-off has the numbers that were chosen, as far as it tells them."""
    shared = [(row[name], numbers[name]) for name in row if name in numbers]
    return bool(shared) and all(
        one == other if isinstance(one, str) or isinstance(other, str) else math.isclose(one, other, rel_tol=1e-9)
        for one, other in shared
    )


def answer_search(request: SearchVerb) -> None:
    """Search, write the configuration of the first design found, and show all."""
    by_runs = searches_by_runs(request.machine)
    _check_search(request, by_runs=by_runs)
    if not by_runs and study.shows_limits(request.limit, request.machine, "design"):
        return
    out, several = request.output, len(request.objective) > 1
    if request.report is not None and several:
        require_extra("plots")
    with study.progress_of(f"searching {'runs' if by_runs else 'designs'} of {request.machine}"):
        found = _searched(request, by_runs=by_runs)
        first, shorter = found[0], found[0].in_shorter_steps
        of_runs = {"limits": request.limit, "duration_s": request.duration_s or 0.0} if by_runs else {}
        wanted = tuple(request.objective)
        wanted = wanted if by_runs else asked_objectives(design_question(request.machine), wanted)
        study.write_found(request, first.parameters, objective=wanted, **of_runs, seed=request.seed)
    options = study.options_of(request, "objective", "bound", "limit", *(("duration_s",) if by_runs else ()), "seed")
    options["objective"] = wanted
    rows = [
        {**each.variables, **in_common_digits(each.objectives, study.numbers_beside(each.in_shorter_steps))}
        for each in found
    ]
    title = f"Pareto front of {', '.join(options['objective'])}" if several else "best design"
    near = dict(sorted(first.margins.items(), key=lambda item: item[1]))
    tables = [
        numbers_table(title, rows[0]) if by_runs else records_table(title, rows, 0 if len(rows) > 1 else None),
        numbers_table(
            f"margins of the {'limits' if by_runs else 'constraints'} (least first; 0 binds)",
            in_common_digits(near, study.numbers_beside(shorter)),
        ),
    ]
    pictures = [study.front_picture(found, options["objective"])] if several and request.report is not None else []
    remarks = [digits_note(shorter.beside_s, shorter.step_s)] if shorter is not None else []
    remarks += ["the configuration is the first of the front"] if len(found) > 1 else []
    study.write_report(request, title, options, tables, remarks, pictures)
    if request.as_json:
        front = [
            {
                **design.variables, **design.objectives, **shorter_record(design.in_shorter_steps),
                "margins": design.margins, "config": configuration_tree(design.parameters),
            }
            for design in found
        ]  # fmt: skip
        head = {"machine": request.machine, "objectives": list(first.objectives), "seed": request.seed}
        print_json({**head, "designs": front, "configuration": out})
        return
    print_tables(*tables)
    say(*remarks)


def _check_search(request: SearchVerb, *, by_runs: bool) -> None:
    """Raise where an option is of the other kind of search."""
    if by_runs:
        if not request.bound or not request.objective:
            asked_of(request.machine, "design", NO_QUESTION)
        if len(request.objective) > 1 or request.points is not None:
            raise CommandError("a search by runs has one objective and no Pareto front")
        return
    for name, value in (("--duration", request.duration_s), ("--cores", request.cores)):
        if value is not None:
            raise CommandError(f"{name} {value:g}: is of a search by runs, with --objective and --bound of its own")
    if request.points is not None and len(request.objective) < 2:
        raise CommandError(f"--points {request.points}: expected several --objective, which give a Pareto front")


def _searched(request: SearchVerb, *, by_runs: bool) -> list[Design]:
    of_both: dict[str, Any] = {"parameters": request.parameters, "seed": request.seed}
    bounds = study.bounds_of(request.bound)
    if by_runs:
        of_both |= {"duration_s": request.duration_s or 0.0, "cores": request.cores}
        limits = study.ranges_of(request.limit)
        return [search_runs(request.machine, request.objective[0], bounds, limits=limits, **of_both)]
    of_both |= {"limits": study.limits_of(request.limit), "points": request.points or POINTS}
    return search(request.machine, tuple(request.objective), bounds=bounds, **of_both)


def answer_designs(request: DesignsVerb) -> None:
    """Scan the space, and say how fast and what the best are."""
    if study.shows_limits(request.limit, request.machine, "design"):
        return
    out, parameters = request.out, request.parameters
    with count_bar("designs") as progress:
        begun = time.monotonic()
        found = designs(
            request.machine, request.count, parameters=parameters, bounds=study.bounds_of(request.bound),
            limits=study.limits_of(request.limit), progress=progress,
            **study.options_of(request, "seed", "cores", "scheduler"),
        )  # fmt: skip
        taken = time.monotonic() - begun
        if out is not None:
            notes = study.notes_of(machine=request.machine, seed=request.seed, designs=request.count)
            found.write(out, {"written by": "\n".join(notes)})
    best = {name: found.best(name) for name in found.objectives} if len(found.feasible) else {}
    numbers = {"designs": found.designs, "feasible": len(found.feasible), "feasible_share": found.share}
    tables = [
        numbers_table("designs", numbers),
        records_table("best designs", [{"best": name, **row} for name, row in best.items()]),
    ]
    study.write_report(request, "designs", study.options_of(request, "count", "bound", "limit", "seed"), tables)
    if request.as_json:
        print_json({"machine": request.machine, **numbers, "best": best, "table": out})
        return
    print_tables(*tables)
    say(f"{found.designs / taken:.0f} designs a second")


def answer_synthesise(request: SynthesiseVerb) -> None:
    """Show the cycles side by side; write the configuration of the chosen one."""
    machine, speed = request.machine, request.impact_speed_m_per_s
    out = request.output
    with study.progress_of(f"synthesising a cycle of {machine}"):
        options, periods = study.options_of(request, *ROBUST), request.periods
        found = synthesise(machine, speed, parameters=request.parameters, options=options, periods=periods)
        asked = {"impact_speed_m_per_s": speed, "seed": request.seed, "cycle": found.chosen}
        study.write_found(request, found.cycle(found.chosen).parameters, **asked)
    titles = dict.fromkeys(title for cycle in found.cycles for title in cycle.lines)
    rows = [(title, *(cycle.lines.get(title, "-") for cycle in found.cycles)) for title in titles]
    heads = ("", *(cycle.name for cycle in found.cycles))
    table = ShownTable("one-impact cycle", heads, rows)
    asked = {"impact_speed_m_per_s": speed, **options, "periods": periods}
    study.write_report(request, "one-impact cycle", asked, [table], [f"chosen: {found.chosen}"])
    if request.as_json:
        cycles = {cycle.name: cycle.record for cycle in found.cycles}
        print_json({"machine": machine, **found.asked, **cycles, "chosen": found.chosen, "configuration": out})
        return
    print_tables(table)


def answer_sweep(request: SweepVerb) -> None:
    """Sweep, and say what was written."""
    table = request.output
    if table.suffix != ".csv":
        require_extra("tables")
    if not request.no_picture:
        check_output_file(table.with_suffix(".png"), force=request.force)
        require_extra("plots")
    parameters = request.parameters
    with count_bar("sweeping") as progress:
        try:
            done = sweep(
                request.machine, study.axes_of(request.over), table, parameters=parameters,
                outputs=tuple(request.number), duration_s=request.duration_s, picture=not request.no_picture,
                progress=progress, **study.options_of(request, "cores", "scheduler"),
            )  # fmt: skip
        except OSError as error:  # of the file of points that it goes on from
            raise CommandError(f"{error.filename}: cannot be written: {error.strerror}") from error
        except KeyboardInterrupt:
            say(f"interrupted; finished points are kept beside {table}: the same command goes on from there")
            raise SystemExit(INTERRUPTED) from None
    names = done.outputs
    columns = {name: [point.numbers[name] for point in done.points if name in point.numbers] for name in names}
    varying = [name for name in columns if request.number or varies(columns[name])] or list(columns)  # rounding apart
    pictures = [] if done.picture is None else [picture(f"{request.machine}: sweep", done.picture)]
    asked, table_shown = study.options_of(request, "over", "duration_s"), _points_table(request, done, varying)
    study.write_report(request, f"sweep of {', '.join(done.asked.keys)}", asked, [table_shown], pictures=pictures)
    if request.as_json:
        rows = [{**done.asked.changes(point.index), **point.numbers, "refused": point.refused} for point in done.points]
        head = {"machine": request.machine, "config": configuration_tree(parameters), "points": len(rows)}
        head |= {"resumed": done.resumed, "refused": sum(bool(point.refused) for point in done.points)}
        print_json({**head, "table": done.table, "picture": done.picture, "rows": rows})
    elif request.as_csv:
        values = (done.asked.changes(point.index).values() for point in done.points)
        numbers = ((*(point.numbers.get(name, "") for name in names), point.refused) for point in done.points)
        print_csv((*done.asked.keys, *names, "refused"), [(*v, *n) for v, n in zip(values, numbers, strict=True)])
    else:
        _show_sweep(request, done, varying)


def _show_sweep(request: SweepVerb, done: Sweep, varying: Sequence[str]) -> None:
    """Write the points, their numbers that vary, and what is left out."""
    table = _points_table(request, done, done.outputs if request.everything else varying)
    shown = table.rows if request.everything else table.rows[:SHOWN_ROWS]
    print_table(table.title, table.heads, shown, wide=request.everything, more="--all")
    left, fixed = len(table.rows) - len(shown), len(done.outputs) + len(done.asked.keys) - len(table.heads)
    omitted = [f"{left} more points"] * (left > 0) + [f"{fixed} numbers that do not vary"] * (fixed > 0)
    if omitted:
        say(f"{' and '.join(omitted)} with --all")
    refused = [point for point in done.points if point.refused]
    if refused:
        say(f"points refused: {len(refused)}, the first: {refused[0].refused}")
    if done.resumed:
        say(f"points finished before: {done.resumed}")
    if done.picture:
        say(f"wrote {done.picture}")


def _points_table(request: SweepVerb, done: Sweep, names: Sequence[str]) -> ShownTable:
    """Return the points with these numbers of each; one that was refused has none."""
    rows = []
    for point in done.points:
        absent = "refused" if point.refused else "-"  # a number that this point alone lacks
        numbers = (point.numbers.get(name, absent) for name in names)
        rows.append((*done.asked.changes(point.index).values(), *numbers))
    title = f"{request.machine}: points: {len(rows)}, numbers: {len(done.outputs)}"
    return ShownTable(title, (*done.asked.keys, *names), rows)


def answer_regimes(request: RegimesVerb) -> None:
    """Show the regime at each value, equal ones that follow each other in one row; write the bifurcation picture."""
    machine, out, axes = request.machine, request.output, study.axes_of(request.over)
    if len(axes) != 1:
        raise CommandError("--over: a regime map has one key")
    ((key, values),) = axes.items()
    with count_bar("regimes") as progress:
        settling = request.settling
        found = regimes(
            machine, values, key, parameters=request.parameters, settling_periods=settling, progress=progress
        )
        found.write_picture(out)
    tables = [ShownTable("regimes", found.columns, found.rows)]
    asked = study.options_of(request, "over", "settling")
    study.write_report(request, f"regimes over {key}", asked, tables, pictures=[picture(f"{machine}: regimes", out)])
    if request.as_json:
        print_json({"machine": machine, "key": key, "regimes": found.records, "picture": out})
    elif request.as_csv:
        print_csv(found.columns, found.rows)
    elif request.everything:
        print_table("regimes", found.columns, found.rows, wide=True)
    else:
        spans = joined(found.rows)
        print_table("regimes", ("from", "to", *found.columns[1:]), spans)
        say(f"{len(found.rows)} values of {key} in {len(spans)} rows; each value with --all")


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

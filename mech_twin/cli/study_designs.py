# SPDX-License-Identifier: Apache-2.0
"""Answers of ``mech-twin study MACHINE`` that find a machine: ``size``, ``search``, ``designs``, ``synthesise``."""

from __future__ import annotations

import math
import time

from mech_twin.capabilities.design import Design
from mech_twin.capabilities.sizing import Sizing
from mech_twin.cli.console import counted, print_json, print_numbers, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.run_summary import how_told, in_common_digits, shorter_record
from mech_twin.cli.study_options import (
    bounds_of,
    check_report,
    checked_output,
    limits_of,
    notes_of,
    ranges_of,
    shows_limits,
    study_errors,
    told,
)
from mech_twin.cli.study_report import Studied, constraint_rows, report_designs, report_search, report_sizing
from mech_twin.cli.study_verbs import DesignsVerb, SearchVerb, SizeVerb, SynthesiseVerb
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.output_file import YAML_SUFFIXES, check_output_file
from mech_twin.files.report_page import section
from mech_twin.parameters.written_configuration import write_configuration
from mech_twin.process.dependencies import require_extra
from mech_twin.studies import designs, search, search_runs, size, synthesise
from mech_twin.studies.asking import asked_of, searches_by_runs
from mech_twin.studies.design_scan import asked_objectives, design_question

POINTS = 9  # of a Pareto front
NO_QUESTION = "no design question; its runs are searched with --objective NAME and --bound KEY=LOW:HIGH"
ROBUST = ("margin", "basin_fraction", "tolerance", "stroke_ratio", "starts", "seed")  # what the cycle is asked for


def answer_size(asked: SizeVerb) -> None:
    """Size, write the configuration, and say which constraint binds."""
    machine, limits = asked.machine, asked.limit
    if shows_limits(limits, machine, "sizing"):
        return
    out = checked_output(asked, "sized.yaml", YAML_SUFFIXES)
    parameters = asked.parameters
    with study_errors(), told(f"sizing {machine}"):
        answer = size(
            machine, parameters, limits=limits_of(limits), objective=asked.objective, tolerance=asked.tolerance
        )
        notes = notes_of(objective=answer.objective, tolerance=answer.tolerance, binding=answer.binding)
        write_configuration(machine, answer.parameters, out, asked.config, notes)
    report_sizing(Studied(asked, parameters), answer)
    if asked.as_json:
        shown = ("name", "value", "limit", "side", "holds", "binds")
        document = {name: getattr(answer, name) for name in ("objective", "tolerance", "sizes", "metrics", "binding")}
        document["constraints"] = [{name: getattr(each, name) for name in shown} for each in answer.constraints]
        head = {"machine": answer.machine, "config": configuration_tree(answer.parameters)}
        tail = {"trade_off": answer.trade_off, "configuration": out, **shorter_record(answer.in_shorter_steps)}
        print_json({**head, **document, **tail})
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


def answer_search(asked: SearchVerb) -> None:
    """Search, write the configuration of the first design found, and show all."""
    by_runs = searches_by_runs(asked.machine)
    _check_search(asked, by_runs=by_runs)
    if not by_runs and shows_limits(asked.limit, asked.machine, "design"):
        return
    several = len(asked.objective) > 1
    extras = ("plots",) if asked.report is not None and several else ()
    out = checked_output(asked, "found.yaml", YAML_SUFFIXES, *extras)
    parameters = asked.parameters
    studied = Studied(asked, parameters)
    with study_errors(), told(f"searching {'runs' if by_runs else 'designs'} of {asked.machine}"):
        found = _searched(asked, parameters, by_runs=by_runs)
        first, shorter = found[0], found[0].in_shorter_steps
        of_runs = {"limits": asked.limit, "duration_s": asked.duration_s or 0.0} if by_runs else {}
        objectives = asked.objective[0] if by_runs else tuple(first.objectives)
        notes = notes_of(objective=objectives, **of_runs, seed=asked.seed)
        write_configuration(asked.machine, first.parameters, out, asked.config, notes)
    options = studied.options("objective", "bound", "limit", *(("duration_s",) if by_runs else ()), "seed")
    if not by_runs:
        options["objective"] = asked_objectives(design_question(asked.machine), tuple(asked.objective))
    report_search(studied, found, options)
    rows = [{**design.variables, **in_common_digits(design.objectives, design.in_shorter_steps)} for design in found]
    if asked.as_json:
        front = [
            {
                **design.variables, **design.objectives, **shorter_record(design.in_shorter_steps),
                "margins": design.margins, "config": configuration_tree(design.parameters),
            }
            for design in found
        ]  # fmt: skip
        head = {"machine": asked.machine, "objectives": list(first.objectives), "seed": asked.seed}
        print_json({**head, "designs": front, "configuration": out})
        return
    near = dict(sorted(first.margins.items(), key=lambda item: item[1]))
    if by_runs:
        print_numbers("best design", rows[0])
    else:
        title = f"Pareto front of {', '.join(asked.objective)}" if several else "best design"
        print_table(title, tuple(rows[0]), [tuple(row.values()) for row in rows], marked=0 if len(rows) > 1 else None)
    if near or not by_runs:
        of = "limits" if by_runs else "constraints"
        print_numbers(f"margins of the {of} (least first; 0 binds)", in_common_digits(near, shorter))
    if shorter is not None:
        say(how_told(shorter.beside_s, shorter.step_s))
    say(f"wrote {out}" + (" (the first of the front)" if len(found) > 1 else ""))


def _check_search(asked: SearchVerb, *, by_runs: bool) -> None:
    """Raise where an option is of the other kind of search."""
    if by_runs:
        if not asked.bound or not asked.objective:
            asked_of(asked.machine, "design", NO_QUESTION)
        if len(asked.objective) > 1 or asked.points is not None:
            raise CommandError("a search by runs has one objective and no Pareto front")
        return
    for name, value in (("--duration", asked.duration_s), ("--cores", asked.cores)):
        if value is not None:
            raise CommandError(f"{name} {value:g}: is of a search by runs, with --objective and --bound of its own")
    if asked.points is not None and len(asked.objective) < 2:
        raise CommandError(f"--points {asked.points}: expected several --objective, which give a Pareto front")


def _searched(asked: SearchVerb, parameters: Parameters, *, by_runs: bool) -> list[Design]:
    bounds = bounds_of(asked.bound)
    if by_runs:
        limits, duration_s = ranges_of(asked.limit), asked.duration_s or 0.0
        return [
            search_runs(
                asked.machine, asked.objective[0], bounds, parameters=parameters, limits=limits, duration_s=duration_s,
                seed=asked.seed, cores=asked.cores,
            )
        ]  # fmt: skip
    return search(
        asked.machine, tuple(asked.objective), parameters=parameters, bounds=bounds, limits=limits_of(asked.limit),
        seed=asked.seed, points=asked.points or POINTS,
    )  # fmt: skip


def answer_designs(asked: DesignsVerb) -> None:
    """Scan the space, and say how fast and what the best are."""
    count, out = asked.count, asked.out
    if out is not None:
        check_output_file(out, force=asked.force, suffixes=(".parquet",))
    if shows_limits(asked.limit, asked.machine, "design"):
        return
    check_report(asked.report, force=asked.force)
    if out is not None:
        require_extra("tables")
    parameters = asked.parameters
    with study_errors(), counted("designs") as progress:
        begun = time.monotonic()
        found = designs(
            asked.machine, count, parameters=parameters, bounds=bounds_of(asked.bound), limits=limits_of(asked.limit),
            seed=asked.seed, cores=asked.cores, scheduler=asked.scheduler, progress=progress,
        )  # fmt: skip
        taken = time.monotonic() - begun
        if out is not None:
            notes = notes_of(machine=asked.machine, seed=asked.seed, designs=count)
            found.write(out, {"written by": "\n".join(notes)})
    best = {name: found.best(name) for name in found.objectives} if len(found.feasible) else {}
    report_designs(Studied(asked, parameters), found, best)
    numbers = {"designs": found.designs, "feasible": len(found.feasible), "feasible_share": found.share}
    if asked.as_json:
        print_json({"machine": asked.machine, **numbers, "best": best, "table": out})
        return
    print_numbers("designs", {**numbers, **{f"best {name}": row[name] for name, row in best.items()}})
    say(f"{found.designs / taken:.0f} designs a second" + (f"; wrote {out}" if out else ""))


def answer_synthesise(asked: SynthesiseVerb) -> None:
    """Show the cycles side by side; write the configuration of the chosen one."""
    machine, speed = asked.machine, asked.impact_speed_m_per_s
    out = checked_output(asked, "robust.yaml", YAML_SUFFIXES)
    with study_errors(), told(f"synthesising a cycle of {machine}"):
        studied = Studied(asked, asked.parameters)
        options = studied.options(*ROBUST)
        found = synthesise(machine, speed, parameters=studied.parameters, options=options, periods=asked.periods)
        notes = notes_of(impact_speed_m_per_s=speed, seed=asked.seed, cycle=found.chosen)
        write_configuration(machine, found.cycle(found.chosen).parameters, out, asked.config, notes)
    titles = dict.fromkeys(title for cycle in found.cycles for title in cycle.lines)
    rows = [(title, *(cycle.lines.get(title, "-") for cycle in found.cycles)) for title in titles]
    heads = ("", *(cycle.name for cycle in found.cycles))
    parts = [section("Cycles", heads, rows), f"<p>Chosen: {found.chosen}.</p>"]
    studied.report("one-impact cycle", found.asked, lambda: parts)
    if asked.as_json:
        cycles = {cycle.name: cycle.record for cycle in found.cycles}
        print_json({"machine": machine, **found.asked, **cycles, "chosen": found.chosen, "configuration": out})
        return
    print_table("one-impact cycle", heads, rows)
    say(f"wrote {out}")

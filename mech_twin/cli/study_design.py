# SPDX-License-Identifier: Apache-2.0
"""Answers of ``mech-twin study MACHINE search`` and ``designs``, of any machine that has a design question."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_json, print_numbers, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.run_summary import how_told, in_common_digits, shorter_record
from mech_twin.cli.study_options import counted, limits_of, notes_of, ranges_of, shows_limits, study_errors, told
from mech_twin.cli.study_report import Studied, check_report, report_designs, report_search
from mech_twin.cli.study_verbs import DesignsVerb, SearchVerb
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.files.output_file import YAML_SUFFIXES, check_output_file
from mech_twin.parameters.load import assignments, machine_parameters
from mech_twin.parameters.written_configuration import write_configuration
from mech_twin.process.dependencies import require_extra
from mech_twin.studies import designs, search, search_runs
from mech_twin.studies.asking import asked_of, searches_by_runs
from mech_twin.studies.design_scan import asked_objectives, design_question

POINTS = 9  # of a Pareto front
NO_QUESTION = "no design question; its runs are searched with --objective NAME and --bound KEY=LOW:HIGH"


def bounds_of(texts: list[str]) -> dict[str, tuple[float, float]]:
    """Return names and bounds of ``NAME=LOW:HIGH``, or of ``NAME=VALUE`` for a variable that is held."""
    bounds = {}
    for text in texts:
        name, equals, values = text.partition("=")
        low, _, high = values.partition(":")
        try:
            bounds[name.strip()] = (float(low), float(high or low))
        except ValueError as error:
            raise CommandError(f"--bound {text}: expected NAME=LOW:HIGH") from error
        if not equals or not name.strip():
            raise CommandError(f"--bound {text}: expected NAME=LOW:HIGH")
        if high and float(low) > float(high):
            raise CommandError(
                f"--bound {text}: bounds of {name.strip()}: the lower bound is above the upper one; "
                f"expected {name.strip()}={high}:{low}"
            )
    return bounds


def answer_search(request: SearchVerb) -> None:
    """Search, write the configuration of the first design found, and show all."""
    if searches_by_runs(request.machine):
        if not request.bound or not request.objective:
            asked_of(request.machine, "design", NO_QUESTION)
        _search_by_runs(request)
        return
    for name, value in (("--duration", request.duration_s), ("--cores", request.cores)):
        if value is not None:
            raise CommandError(f"{name} {value:g}: is of a search by runs, with --objective and --bound of its own")
    objectives = tuple(request.objective)
    if request.points is not None and len(objectives) < 2:
        raise CommandError(f"--points {request.points}: expected several --objective, which give a Pareto front")
    if shows_limits(request.limit, request.machine, "design"):
        return
    out = request.out or Path(f"{Path(request.machine).stem}-found.yaml")
    check_output_file(out, force=request.force, suffixes=YAML_SUFFIXES)
    check_report(request.report, force=request.force)
    if request.report is not None and len(objectives) > 1:
        require_extra("plots")
    parameters = machine_parameters(request.machine, request.config, assignments(request.settings))
    with study_errors(), told(f"searching designs of {request.machine}"):
        found = search(
            request.machine,
            objectives,
            parameters=parameters,
            bounds=bounds_of(request.bound),
            limits=limits_of(request.limit),
            seed=request.seed,
            points=request.points or POINTS,
        )
        notes = notes_of(objective=tuple(found[0].objectives), seed=request.seed)
        write_configuration(request.machine, found[0].parameters, out, request.config, notes)
    if request.report is not None:
        wanted = asked_objectives(design_question(request.machine), objectives)
        options = {"objective": wanted, **{name: getattr(request, name) for name in ("bound", "limit", "seed")}}
        report_search(Studied(request.report, request.machine, parameters, options), found)
    rows = [{**design.variables, **design.objectives} for design in found]
    if request.as_json:
        front = [
            {**row, "margins": design.margins, "config": configuration_tree(design.parameters)}
            for row, design in zip(rows, found, strict=True)
        ]
        names = list(found[0].objectives)
        document: dict[str, Any] = {"machine": request.machine, "objectives": names, "seed": request.seed}
        print_json({**document, "designs": front, "configuration": str(out)})
        return
    title = f"Pareto front of {', '.join(objectives)}" if len(objectives) > 1 else "best design"
    print_table(title, tuple(rows[0]), [tuple(row.values()) for row in rows], marked=0 if len(rows) > 1 else None)
    near = sorted(found[0].margins.items(), key=lambda item: item[1])
    print_numbers("margins of the constraints (least first; 0 binds)", dict(near))
    say(f"wrote {out}" + (" (the first of the front)" if len(found) > 1 else ""))


def _search_by_runs(request: SearchVerb) -> None:
    """Search among the runs of a machine that has no design question, write the configuration found, and show it."""
    if len(request.objective) > 1 or request.points is not None:
        raise CommandError("a search by runs has one objective and no Pareto front")
    out = request.out or Path(f"{Path(request.machine).stem}-found.yaml")
    check_output_file(out, force=request.force, suffixes=YAML_SUFFIXES)
    check_report(request.report, force=request.force)
    parameters = machine_parameters(request.machine, request.config, assignments(request.settings))
    objective, duration_s = request.objective[0], request.duration_s or 0.0
    with study_errors(), told(f"searching runs of {request.machine}"):
        found = search_runs(
            request.machine,
            objective,
            bounds_of(request.bound),
            parameters=parameters,
            limits=ranges_of(request.limit),
            duration_s=duration_s,
            seed=request.seed,
            cores=request.cores,
        )
        notes = notes_of(objective=objective, limits=request.limit, duration_s=duration_s, seed=request.seed)
        write_configuration(request.machine, found.parameters, out, request.config, notes)
    if request.report is not None:
        options = {name: getattr(request, name) for name in ("objective", "bound", "limit", "duration_s", "seed")}
        report_search(Studied(request.report, request.machine, parameters, options), [found])
    if request.as_json:
        row = {**found.variables, **found.objectives, **shorter_record(found.in_shorter_steps)}
        front = [{**row, "margins": found.margins, "config": configuration_tree(found.parameters)}]
        names = {"machine": request.machine, "objectives": [objective], "seed": request.seed}
        print_json({**names, "designs": front, "configuration": str(out)})
        return
    shorter = found.in_shorter_steps
    print_numbers("best design", {**found.variables, **in_common_digits(found.objectives, shorter)})
    if found.margins:
        near = sorted(found.margins.items(), key=lambda item: item[1])
        print_numbers("margins of the limits (least first; 0 binds)", in_common_digits(dict(near), shorter))
    if shorter is not None:
        say(how_told(shorter.beside_s, shorter.step_s))
    say(f"wrote {out}")


def answer_designs(request: DesignsVerb) -> None:
    """Scan the space, and say how fast and what the best are."""
    count, out = request.count, request.out
    if out is not None:
        check_output_file(out, force=request.force, suffixes=(".parquet",))
    if shows_limits(request.limit, request.machine, "design"):
        return
    check_report(request.report, force=request.force)
    if out is not None:
        require_extra("tables")
    parameters = machine_parameters(request.machine, request.config, assignments(request.settings))
    with study_errors(), counted("designs") as progress:
        begun = time.monotonic()
        found = designs(
            request.machine,
            count,
            parameters=parameters,
            bounds=bounds_of(request.bound),
            limits=limits_of(request.limit),
            seed=request.seed,
            cores=request.cores,
            scheduler=request.scheduler,
            progress=progress,
        )
        taken = time.monotonic() - begun
        if out is not None:
            notes = notes_of(machine=request.machine, seed=request.seed, designs=count)
            found.write(out, {"written by": "\n".join(notes)})
    if request.report is not None:
        options = {name: getattr(request, name) for name in ("count", "bound", "limit", "seed")}
        report_designs(Studied(request.report, request.machine, parameters, options), found)
    best = {name: found.best(name) for name in found.objectives} if len(found.feasible) else {}
    document: dict[str, Any] = {
        "machine": request.machine,
        "designs": found.designs,
        "feasible": len(found.feasible),
        "feasible_share": found.share,
        "best": best,
        "table": None if out is None else str(out),
    }
    if request.as_json:
        print_json(document)
        return
    numbers = {key: document[key] for key in ("designs", "feasible", "feasible_share")}
    print_numbers("designs", {**numbers, **{f"best {name}": row[name] for name, row in best.items()}})
    say(f"{found.designs / taken:.0f} designs a second" + (f"; wrote {out}" if out else ""))

"""Answers of ``mech-twin study compaction_press search`` and ``designs``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_json, print_numbers, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.study_options import counted, limits_of, require_machine, study_errors
from mech_twin.dependencies import require_extra
from mech_twin.machines.compaction_press.design_configuration import configured_press
from mech_twin.machines.compaction_press.design_problem import REFERENCE_LIMITS, Space
from mech_twin.machines.compaction_press.design_search import Design, InfeasibleSpaceError
from mech_twin.machines.compaction_press.parameters import CompactionPress
from mech_twin.parameters.load import assignments, machine_parameters, write_configuration
from mech_twin.studies import designs, search

MACHINE = "compaction_press"
VARIABLES = ("crank", "length", "height", "pendulum")


def space_of(bounds: list[str], limits: list[str]) -> Space:
    """Return the reference problem's space with these bounds (``crank=0.02:0.12``) and limits changed."""
    reference = Space()
    lower, upper = list(reference.lower_m), list(reference.upper_m)
    for text in bounds:
        name, _, values = text.partition("=")
        low, _, high = values.partition(":")
        try:
            place = VARIABLES.index(name.strip())
            lower[place], upper[place] = float(low), float(high or low)
        except ValueError as error:
            raise CommandError(f"--bound {text}: expected one of {', '.join(VARIABLES)} and =LOW:HIGH in m") from error
    changed = limits_of(limits)
    unknown = [name for name in changed if name not in REFERENCE_LIMITS._fields]
    if unknown:
        raise CommandError(f"no limit '{unknown[0]}'; expected one of {', '.join(REFERENCE_LIMITS._fields)}")
    try:
        return Space(
            (lower[0], lower[1], lower[2], lower[3]),
            (upper[0], upper[1], upper[2], upper[3]),
            REFERENCE_LIMITS._replace(**changed),
        )
    except ValueError as error:
        raise CommandError(f"--bound: {error}") from error


def answer_search(
    machine: str,
    objectives: tuple[str, ...],
    bounds: list[str],
    limits: list[str],
    seed: int,
    points: int,
    out: Path,
    config: Path | None,
    settings: list[str],
    *,
    as_json: bool,
) -> None:
    """Search, write the configuration of the first design found, and show all."""
    require_machine(machine, MACHINE, "search")
    space = space_of(bounds, limits)
    with study_errors():
        try:
            found = search(objectives, space=space, seed=seed, points=points)
        except InfeasibleSpaceError as error:
            raise CommandError(f"infeasible: {error}") from error
        except ValueError as error:
            raise CommandError(str(error)) from error
        parameters = machine_parameters(MACHINE, config, assignments(settings))
        assert isinstance(parameters, CompactionPress)
        chosen = configured_press(parameters, found[0], space.limits)
        write_configuration(MACHINE, chosen, out)
    rows = [_row(design) for design in found]
    if as_json:
        front = [{**row, "margins": design.margins} for row, design in zip(rows, found, strict=True)]
        print_json(
            {"machine": MACHINE, "objectives": objectives, "seed": seed, "designs": front, "configuration": str(out)}
        )
        return
    title = f"best for {objectives[0]}" if len(objectives) == 1 else f"Pareto front of {', '.join(objectives)}"
    print_table(title, tuple(rows[0]), [tuple(row.values()) for row in rows])
    near = sorted(found[0].margins.items(), key=lambda item: item[1])
    print_numbers("margins of the constraints (least first; 0 binds)", dict(near))
    say(f"wrote {out}" + (" (the first of the front)" if len(found) > 1 else ""))


def _row(design: Design) -> dict[str, float]:
    lengths = {name: value for name, value in design._asdict().items() if name.endswith("_m")}
    return {**lengths, **design.objectives}


def answer_designs(
    machine: str,
    count: int,
    bounds: list[str],
    limits: list[str],
    seed: int,
    out: Path | None,
    cores: int | None,
    scheduler: str | None,
    *,
    as_json: bool,
) -> None:
    """Scan the space, and say how fast and what the best are."""
    require_machine(machine, MACHINE, "designs")
    if out is not None:
        require_extra("tables")
    with study_errors(), counted("designs") as progress:
        begun = time.monotonic()
        found = designs(
            count, space=space_of(bounds, limits), seed=seed, cores=cores, scheduler=scheduler, progress=progress
        )
        taken = time.monotonic() - begun
        if out is not None:
            found.write(out)
    best = {name: found.best(name) for name in _objectives()} if len(found.feasible) else {}
    document: dict[str, Any] = {
        "machine": MACHINE,
        "designs": found.designs,
        "feasible": len(found.feasible),
        "feasible_share": found.share,
        "best": best,
        "table": None if out is None else str(out),
    }
    if as_json:
        print_json(document)
        return
    numbers = {key: document[key] for key in ("designs", "feasible", "feasible_share")}
    print_numbers("designs", {**numbers, **{f"best {name}": row[name] for name, row in best.items()}})
    say(f"{found.designs / taken:.0f} designs a second" + (f"; wrote {out}" if out else ""))


def _objectives() -> tuple[str, ...]:
    from mech_twin.machines.compaction_press.design_problem import OBJECTIVES

    return OBJECTIVES

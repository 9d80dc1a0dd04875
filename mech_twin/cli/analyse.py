# SPDX-License-Identifier: Apache-2.0
"""``mech-twin analyse``."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from mech_twin.cli.console import CommandError, numbered, print_csv, print_json, print_table, progress
from mech_twin.cli.run_summary import analysed_groups, group_rows, show_groups
from mech_twin.cli.verbs import AnalyseVerb
from mech_twin.declarations.captions import unit_of
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.parameters.load import assignments
from mech_twin.parameters.load import machine as built_machine
from mech_twin.studies.declared_studies import analysed_columns, cycle_positions

COMPONENTS = ("along x", "along y", "along z")
EXTREMES = ("quantity", "least", "greatest", "unit")


def analyse_machine(request: AnalyseVerb) -> None:
    """Write one position, or one cycle in so many positions, and the machine's closed-form metrics."""
    name, crank_deg, cycle = request.machine, request.crank_deg, request.cycle
    if crank_deg is not None and not math.isfinite(crank_deg):
        raise CommandError(f"--crank-deg {crank_deg}: expected a finite angle in degrees")
    machine = built_machine(name, request.config, assignments(request.settings))
    document: dict[str, Any] = {"machine": name, "config": configuration_tree(machine.parameters)}
    document |= {"summary": machine.report()}
    if crank_deg is not None:
        document |= {"crank_deg": crank_deg, "position": machine.analyse(math.radians(crank_deg))}
    if cycle is not None:
        with progress(cycle_positions(cycle), cycle, "analysing") as counted:
            document["cycle"] = analysed_columns(machine, counted)
    if request.as_json:
        print_json(document)
    elif request.as_csv:
        _write_csv(document)
    else:
        _show(document, wide=request.wide)


def _write_csv(document: Mapping[str, Any]) -> None:
    """Write the cycle as columns, else the position, else the metrics."""
    if "cycle" in document:
        columns = _scalar_columns(document["cycle"])
        print_csv(tuple(columns), zip(*columns.values(), strict=True))
        return
    print_csv(("quantity", "value", "unit"), numbered(_scalars(document.get("position", document["summary"]))))


def _show(document: Mapping[str, Any], *, wide: bool) -> None:
    name = document["machine"]
    show_groups(f"{name}: without a run", analysed_groups(document["summary"]))
    if "position" in document:
        title, position = f"{name} at {document['crank_deg']:g} degrees", document["position"]
        rows = {key: value for key, value in position.items() if _is_row(value)}
        show_groups(title, analysed_groups({key: value for key, value in position.items() if key not in rows}))
        _show_rows(title, rows, wide=wide)
    if "cycle" in document:
        cycle = _scalar_columns(document["cycle"])
        groups = {
            group: {key: (key, *_extremes(column), unit_of(key)) for key, column in columns.items()}
            for group, columns in analysed_groups(cycle).items()
        }
        count = len(next(iter(cycle.values())))
        print_table(f"{name}: {count} positions", EXTREMES, group_rows(groups, len(EXTREMES)))


def _by_quantity(rows: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Return the quantities of which every cart has one, each as a row; a list of carts is turned round."""
    turned: dict[str, list[Any]] = {}
    for name, row in rows.items():
        if row and isinstance(row[0], Mapping):
            turned |= {key: [cart.get(key, "") for cart in row] for key in row[0]}
        else:
            turned[name] = list(row)
    return turned


def _show_rows(title: str, given: Mapping[str, Sequence[Any]], *, wide: bool) -> None:
    """Write quantities of which every cart has one, and those with a component along each axis, side by side."""
    rows = _by_quantity(given)
    if not rows:
        return
    count = max(len(row) for row in rows.values())
    table = [(key, unit_of(key), *row, *[""] * (count - len(row))) for key, row in rows.items()]
    of_carts = any(isinstance(item, Mapping) for row in given.values() for item in row)
    heads = tuple(map(str, range(1, count + 1))) if of_carts else COMPONENTS[:count]
    title = f"{title}, by cart" if of_carts else f"{title}, components"
    print_table(title, ("quantity", "unit", *heads), table, wide=wide, more="--wide")


def _is_row(value: Any) -> bool:
    return isinstance(value, list | tuple)


def _scalars(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers, those of each cart by a name of its own: ``rod_force_n.1``."""
    flat: dict[str, Any] = {key: value for key, value in numbers.items() if not _is_row(value)}
    for name, value in _by_quantity({key: row for key, row in numbers.items() if _is_row(row)}).items():
        flat |= {f"{name}.{i}": one for i, one in enumerate(value, 1)}
    return flat


def _scalar_columns(columns: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Return the columns, those of each cart by a name of its own."""
    positions = [_scalars(dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]
    return {name: [position[name] for position in positions] for name in (positions[0] if positions else columns)}


def _extremes(column: Sequence[Any]) -> tuple[Any, Any]:
    numbers = [value for value in column if isinstance(value, int | float)]
    return (min(numbers), max(numbers)) if numbers else (str(column[0]), str(column[-1]))

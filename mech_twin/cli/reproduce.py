"""``mech-twin reproduce``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mech_twin.cli.console import print_json, progress, say
from mech_twin.cli.failure import CommandError
from mech_twin.dependencies import require_extra

if TYPE_CHECKING:
    from mech_twin.capabilities.published import Row

SHOWN_COLUMNS = (
    "source",
    "figure or equation",
    "quantity",
    "inputs",
    "published",
    "computed",
    "error",
    "tolerance",
    "verdict",
    "reason",
)


def reproduce_machines(
    machine: str | None, figures: Path | None, config: Path | None, settings: list[str], *, as_json: bool
) -> None:
    """Write the comparison with the sources and, if asked, their figures; exit code 1 where a gated row fails."""
    from mech_twin.parameters.load import assignments, machine_parameters
    from mech_twin.studies import reproduce
    from mech_twin.studies.reproduction import all_hold, machines_with_published_values

    if figures is not None:
        require_extra("plots")
    parameters = None
    if config is not None or settings:
        if machine is None:
            raise CommandError("--config and --set change one machine: name it before them")
        parameters = machine_parameters(machine, config, assignments(settings))
    rows = reproduce(machine, parameters)
    files: list[Path] = []
    if figures is not None:
        from mech_twin.studies import draw_figures

        machines = machines_with_published_values() if machine is None else (machine,)
        with progress(machines, len(machines), "drawing") as counted:
            for name in counted:
                files += draw_figures(name, figures, parameters)
    hold = all_hold(rows)
    if as_json:
        counts = {verdict: sum(row.verdict == verdict for row in rows) for verdict in {row.verdict for row in rows}}
        document = {
            "machine": machine or "all",
            "all_gated_hold": hold,
            "verdicts": counts,
            "rows": [row.record() for row in rows],
            "figures": [str(file) for file in files],
        }
        print_json(document)
    else:
        show_rows(rows)
        for file in files:
            say(f"wrote {file}")
    if not hold:
        failing = sum(not row.holds for row in rows)
        say(f"mech-twin: {failing} of {sum(row.gated for row in rows)} gated rows do not hold")
        raise SystemExit(1)


def show_rows(rows: Sequence[Row]) -> None:
    """Write the table: as wide as it needs to be where no terminal sets the width."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="published and computed", title_justify="left", header_style="bold", row_styles=("", "dim"))
    for column in SHOWN_COLUMNS:
        right = column in ("published", "computed", "error", "tolerance")
        table.add_column(column, justify="right" if right else "left", overflow="fold", no_wrap=right)
    for row in rows:
        table.add_row(
            row.source,
            row.figure_or_equation,
            row.quantity,
            row.inputs,
            _number(row.published),
            _number(row.computed),
            _error(row),
            _tolerance(row),
            row.verdict if row.holds else f"[bold red]{row.verdict}[/]",
            row.reason,
        )
    Console(width=None if sys.stdout.isatty() else 240).print(table)
    gated = sum(row.gated for row in rows)
    say(f"{len(rows)} rows, {gated} gated, {sum(row.holds and row.gated for row in rows)} of them hold")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.7g}"


def _error(row: Row) -> str:
    if row.error is None:
        return "-"
    return f"{100.0 * row.error:+.3g} %" if row.measure == "relative" else f"{row.error:+.3g}"


def _tolerance(row: Row) -> str:
    if row.tolerance is None:
        return "shown" if row.published is not None else "-"
    if row.measure in ("below", "above"):
        return row.measure
    return f"{100.0 * row.tolerance:.3g} %" if row.measure == "relative" else f"{row.tolerance:.3g}"

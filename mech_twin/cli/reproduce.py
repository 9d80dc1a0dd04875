# SPDX-License-Identifier: Apache-2.0
"""``mech-twin reproduce``."""

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from textwrap import fill

from mech_twin.capabilities.published import PublishedRow
from mech_twin.cli.console import CommandError, busy_bar, print_csv, print_json, print_table, progress, say, say_result
from mech_twin.cli.verbs import ReproduceVerb
from mech_twin.files.output_file import check_output_directory
from mech_twin.process.dependencies import require_extra
from mech_twin.studies import draw_figures, reproduce
from mech_twin.studies.declared_studies import all_hold, machines_with_published_values


def reproduce_machines(request: ReproduceVerb) -> None:
    """Write the comparison with the sources and, if asked, their figures; exit code 1 where a gated row fails."""
    machine, figures = request.machine, request.figures
    if figures is not None:
        check_output_directory(figures, force=request.force)
        require_extra("plots")
    changed = request.config is not None or request.settings
    if changed and machine is None:
        raise CommandError("--config and --set change one machine: name it before them")
    parameters = request.parameters if changed else None
    with busy_bar("computing published values"):
        rows = reproduce(machine, parameters)
    files: list[Path] = []
    if figures is not None:
        machines = machines_with_published_values() if machine is None else (machine,)
        with progress(machines, len(machines), "drawing") as counted:
            for name in counted:
                files += draw_figures(name, figures, parameters)
    hold, gated = all_hold(rows), sum(row.gated for row in rows)
    if request.as_json:
        verdicts, records = Counter(row.verdict for row in rows), [row.record() for row in rows]
        head = {"machine": machine or "all", "all_gated_hold": hold, "verdicts": verdicts}
        print_json({**head, "rows": records, "figures": files})
    elif request.as_csv:
        print_csv(WIDE_COLUMNS, map(_cells, rows))
    else:
        if request.wide:
            print_table("published and computed", WIDE_COLUMNS, map(_cells, rows), piped=WIDE)
        else:
            show_rows(rows)
        counts = Counter(row.verdict for row in rows)  # in the order in which they first appear
        say_result(*(f"{count:5d}  {verdict}" for verdict, count in counts.items()))
        say_result(f"{sum(row.gated and row.holds for row in rows)} of {gated} checks within tolerance")
    if not request.as_json:
        say(*(f"wrote {file}" for file in files))
    if not hold:
        say(f"mech-twin: {sum(not row.holds for row in rows)} of {gated} gated rows do not hold")
        raise SystemExit(1)


WIDE_COLUMNS = (
    *("source", "figure or equation", "quantity", "inputs", "published", "computed", "error", "tolerance"),
    *("verdict", "reason"),
)
WIDE = 240
NARROW = 80
ROUNDING = 1e-12  # an error below is that of floating point and is written as zero


def show_rows(rows: Sequence[PublishedRow]) -> None:
    """Write quantity, numbers, error and verdict, a table for each source and its figures; why not, where not."""
    heads = ("quantity, inputs", "published", "computed", "error", "verdict")
    for (source, item), found in groupby(rows, key=lambda row: (row.source, row.figure_or_equation)):
        group = list(found)
        inputs = [row.inputs.split(", ") for row in group]  # those of all rows are written once below the table
        shared = [words for words in inputs[0] if len(group) > 1 and all(words in each for each in inputs)]
        own = [[words for words in each if words not in shared] for each in inputs]
        table = [
            (", ".join([row.quantity, *words]), _number(row.published, 5), _number(row.computed, 5), *_judged(row))
            for row, words in zip(group, own, strict=True)
        ]
        print_table(f"{source}: {item}", heads, table, piped=NARROW)
        notes = [f"all with {', '.join(shared)}"] if shared else []
        notes += dict.fromkeys(row.reason for row in group if row.verdict != "reproduced" and row.reason)
        say_result(*(fill(note, NARROW, initial_indent="  ", subsequent_indent="    ") for note in notes), "")


def _cells(row: PublishedRow) -> tuple[str, ...]:
    error, verdict = _judged(row)
    numbers = (_number(row.published, 7), _number(row.computed, 7), error, _tolerance(row))
    return (row.source, row.figure_or_equation, row.quantity, row.inputs, *numbers, verdict, row.reason)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}g}"


def _judged(row: PublishedRow) -> tuple[str, str]:
    """Return error and verdict; an error below that of rounding is zero."""
    if row.error is None:
        return "-", row.verdict
    shown = 0.0 if abs(row.error) < ROUNDING else row.error
    return f"{100.0 * shown:+.3g} %" if row.measure == "relative" else f"{shown:+.3g}", row.verdict


def _tolerance(row: PublishedRow) -> str:
    if row.tolerance is None:
        return "shown" if row.published is not None else "-"
    if row.measure in ("below", "above"):
        return row.measure
    return f"{100.0 * row.tolerance:.3g} %" if row.measure == "relative" else f"{row.tolerance:.3g}"

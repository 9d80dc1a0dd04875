# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/monitoring.md from the results of `proof.py`.

python benchmarks/monitoring/tables.py [RESULT.json ...] [--write]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import poisson

RESULTS = Path(__file__).parent / "results"
PAGE = Path(__file__).parents[2] / "docs" / "monitoring.md"
BEGIN, END = "<!-- proof: begin -->", "<!-- proof: end -->"


def healthy_table(results: list[dict[str, Any]]) -> list[str]:
    """Return the rows on false alarms, beside the 95 % interval of a count at the stated rate.

    Views of one motion have the shocks of its supply in common.  D is the variance of the counts of the motions over
    their mean, 1 where all alarms are independent; the interval is that of a Poisson count, widened by its root.
    """
    lines = [
        "| machine | features | order | baseline | healthy cycles | motions | views | ARL0 | alarms | expected | D "
        "| 95 % of alarms |",
        f"|{'---|' * 12}",
    ]
    for each in results:
        healthy, arl0 = each["healthy"], each["asked"]["arl0"]
        if not healthy.get("views"):
            continue
        expected, counts = healthy["cycles"] / arl0, [sum(views) for views in healthy["alarms"]]
        dispersion = (
            max(1.0, float(np.var(counts, ddof=1) / np.mean(counts))) if len(counts) > 1 and sum(counts) else 1.0
        )
        low, high = poisson.interval(0.95, expected / dispersion)
        lines.append(
            f"| {each['machine']} | {each['features']} | {each['order']} | {each['baseline_cycles']} "
            f"| {healthy['cycles']} | {len(counts)} | {healthy['views']} | {arl0:g} | {sum(counts)} "
            f"| {expected:.1f} | {dispersion:.1f} | {dispersion * low:.0f} to {dispersion * high:.0f} |"
        )
    return lines


def fault_table(results: list[dict[str, Any]]) -> list[str]:
    """Return the rows on faults."""
    lines = [
        "| machine | fault | size | runs | found | delay, median | 95 % | one name | group | unknown | none "
        "| wrong group | wrong name |",
        f"|{'---|' * 13}",
    ]
    for each in results:
        for row in each["faults"].values():
            runs, delays = runs_of(row), row["delays"]
            if not runs:
                continue
            shown = [f"{np.quantile(delays, q):.1f}" if delays else "" for q in (0.5, 0.95)]
            size = f"{100.0 * row['size']:.3g} %" if row["unit"] == "1" else f"{row['size']:.3g} {row['unit']}"
            kinds = ("right", "group", "unknown", "none", "wrong_group", "wrong")
            counts = [str(row["kinds"].get(kind, 0)) for kind in kinds]
            cells = [each["machine"], row["fault"], size, str(runs), f"{100.0 * len(delays) / runs:.0f} %", *shown]
            lines.append(f"| {' | '.join([*cells, *counts])} |")
    return lines


def runs_of(row: dict[str, Any]) -> int:
    """Return the runs of a row, those with an alarm before the fault left out."""
    return sum(row["kinds"].values())


def summary(results: list[dict[str, Any]]) -> str:
    """Return how many runs were named wrongly, in a sentence."""
    rows = [row for each in results for row in each["faults"].values()]
    runs, early = sum(map(runs_of, rows)), sum(row["early"] for row in rows)
    wrong, groups = (sum(row["kinds"].get(kind, 0) for row in rows) for kind in ("wrong", "wrong_group"))
    return (
        f"Of {runs} runs with a fault, {wrong} ({100.0 * wrong / max(runs, 1):.2f} %) got a wrong single name and "
        f"{groups} ({100.0 * groups / max(runs, 1):.2f} %) a group without the fault; {early} more had an alarm before "
        "it and are not counted. Baseline, run lengths and delays are in cycles."
    )


def main() -> None:
    """Print the tables, or write them into the page."""
    asked = argparse.ArgumentParser(description="tables of the monitor's proof")
    asked.add_argument("results", type=Path, nargs="*", default=sorted(RESULTS.glob("*[!p].json")))
    asked.add_argument("--write", action="store_true", help="into docs/monitoring.md")
    given = asked.parse_args()
    results = [json.loads(path.read_text(encoding="utf-8")) for path in given.results]
    lines = [*healthy_table(results), "", *fault_table(results), "", summary(results)]
    if not given.write:
        print("\n".join(lines))
        return
    page = PAGE.read_text(encoding="utf-8")
    head, _, rest = page.partition(BEGIN)
    PAGE.write_text("\n".join([f"{head}{BEGIN}", "", *lines, "", END]) + rest.partition(END)[2], encoding="utf-8")


if __name__ == "__main__":
    main()

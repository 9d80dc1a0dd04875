# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/monitoring.md from the results of `proof.py`.

python benchmarks/monitoring/tables.py RESULT.json ... [--write]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "monitoring.md"
BEGIN, END = "<!-- proof: begin -->", "<!-- proof: end -->"


def healthy_table(results: list[dict[str, Any]]) -> list[str]:
    """Return the rows on false alarms."""
    lines = [
        "| machine | features | order | baseline | healthy cycles | ARL0 | alarms | expected | 95 % of them |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for each in results:
        healthy = each["healthy"]
        lines.append(
            f"| {each['machine']} | {each['features']} | {each['order']} | {each['baseline_cycles']} "
            f"| {healthy['cycles']} | {each['arl0_cycles']:g} | {healthy['alarms']} | {healthy['expected']:.1f} "
            f"| {healthy['low']:g} to {healthy['high']:g} |"
        )
    return lines


def fault_table(results: list[dict[str, Any]]) -> list[str]:
    """Return the rows on faults."""
    lines = [
        "| machine | fault | size | runs | found | delay, median | 95 % | one name | group | unknown | none | wrong |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for each in results:
        for row in each["faults"]:
            delays = [f"{row[key]:.1f}" if row[key] is not None else "" for key in ("delay_median", "delay_95")]
            size = f"{100.0 * row['size']:.3g} %" if row["unit"] == "1" else f"{row['size']:.3g} {row['unit']}"
            counts = [str(row.get(f"named_{kind}", "")) for kind in ("right", "group", "unknown", "none", "wrong")]
            cells = [each["machine"], row["fault"], size, str(row["repeats"]), f"{100.0 * row['found']:.0f} %", *delays]
            lines.append(f"| {' | '.join([*cells, *counts])} |")
    return lines


def summary(results: list[dict[str, Any]]) -> str:
    """Return how many runs were named wrongly, in a sentence."""
    rows = [row for each in results for row in each["faults"]]
    named = [row for row in rows if "named_wrong" in row]
    if not named:
        return "Baseline, run lengths and delays are in cycles."
    runs, wrong = sum(row["repeats"] for row in named), sum(row["named_wrong"] for row in named)
    return (
        f"Of {runs} runs with a fault, {wrong} ({100.0 * wrong / max(runs, 1):.1f} %) got a wrong single name or a "
        "group without the fault. Baseline, run lengths and delays are in cycles."
    )


def main() -> None:
    """Print the tables, or write them into the page."""
    asked = argparse.ArgumentParser(description="tables of the monitor's proof")
    asked.add_argument("results", type=Path, nargs="+")
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

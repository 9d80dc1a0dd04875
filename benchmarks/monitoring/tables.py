# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/proof/monitoring.md from the results of `proof.py`.

python benchmarks/monitoring/tables.py [RESULT.json ...] [--write]
"""

from __future__ import annotations

import argparse
import json
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import poisson, t

from mech_twin.capabilities.cycle import Array

RESULTS = Path(__file__).parent / "results"
PAGE = Path(__file__).parents[2] / "docs" / "proof" / "monitoring.md"
MISSED = ("unknown", "none", "wrong_group", "wrong")
BEGIN, END = "<!-- proof: begin -->", "<!-- proof: end -->"


def healthy_table(results: list[dict[str, Any]]) -> list[str]:
    """Return the rows on false alarms, beside what the stated rate makes expect.

    The stated rate is a mean over baselines.  Columns: the interval of a Poisson count at that rate, as if every
    baseline were exact; how far the rates of the baselines scatter beyond a Poisson count; alarms over those expected,
    with the interval that the scatter of the baselines' counts gives (Student's t).
    """
    lines = [
        "| machine | features | baselines | cycles of one | healthy cycles | motions | ARL0 | alarms | expected "
        "| Poisson, 95 % | scatter of baselines | alarms/expected, 95 % |",
        f"|{'---|' * 12}",
    ]
    for each in results:
        pieces, arl0 = each["healthy"], each["asked"]["arl0"]
        if not pieces:
            continue
        alarms = np.array([piece["alarms"] for piece in pieces])
        expected = np.array([piece["cycles"] for piece in pieces]) / arl0
        low, high = poisson.interval(0.95, expected.sum())
        found = ["", ""]  # of one baseline nothing is known of its peers
        if len(pieces) > 1:
            share, half, scatter = share_of_expected(alarms, expected)
            found = [f"{100.0 * scatter:.0f} %", f"{share:.2f}, {share - half:.2f} to {share + half:.2f}"]
        own, motions, cycles = (sum(piece[key] for piece in pieces) for key in ("baseline_cycles", "motions", "cycles"))
        lines.append(
            f"| {each['machine']} | {pieces[0]['features']} | {len(pieces)} | {own / len(pieces):.0f} | {cycles} "
            f"| {motions} | {arl0:g} | {alarms.sum()} | {expected.sum():.1f} | {low:.0f} to {high:.0f} "
            f"| {' | '.join(found)} |"
        )
    return lines if len(lines) > 2 else ["No healthy cycles have been judged yet."]


def share_of_expected(alarms: Array, expected: Array) -> tuple[float, float, float]:
    """Return alarms over expected ones, half its 95 % interval, and the scatter of the baselines' own rates.

    The interval is that of a ratio of sums over baselines; the scatter is what their counts vary by beyond Poisson's,
    as a share of the mean rate.
    """
    share, count = float(alarms.sum() / expected.sum()), len(alarms)
    spread = float(np.sum((alarms - share * expected) ** 2)) / (count - 1)
    half = float(t.ppf(0.975, count - 1)) * sqrt(count * spread) / float(expected.sum())
    beyond = max(0.0, spread - share * float(expected.mean()))
    return share, half, sqrt(beyond) / max(share * float(expected.mean()), 1e-12)


def fault_table(results: list[dict[str, Any]], *, every: bool) -> list[str]:
    """Return the rows on faults; without ``every`` those that were not found and named in each run."""
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
            if not every and all(row["kinds"].get(kind, 0) == 0 for kind in MISSED):
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
        "the fault: a false one, after which nothing is counted. Baseline, run lengths and delays are in cycles."
    )


def main() -> None:
    """Print the tables, or write them into the page without the faults that every run found."""
    asked = argparse.ArgumentParser(description="tables of the monitor's proof")
    asked.add_argument("results", type=Path, nargs="*", default=sorted(RESULTS.glob("*[!py].json")))
    asked.add_argument("--write", action="store_true", help="into docs/proof/monitoring.md")
    given = asked.parse_args()
    results = [json.loads(path.read_text(encoding="utf-8")) for path in given.results]
    lines = [*healthy_table(results), "", *fault_table(results, every=not given.write), "", summary(results)]
    if not given.write:
        print("\n".join(lines))
        return
    page = PAGE.read_text(encoding="utf-8")
    head, _, rest = page.partition(BEGIN)
    PAGE.write_text("\n".join([f"{head}{BEGIN}", "", *lines, "", END]) + rest.partition(END)[2], encoding="utf-8")


if __name__ == "__main__":
    main()

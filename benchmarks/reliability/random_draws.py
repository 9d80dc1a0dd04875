# SPDX-License-Identifier: Apache-2.0
"""Draw random legal configurations of a machine, analyse each and simulate half a second of it.

    python benchmarks/reliability/random_draws.py [MACHINE ...] [--count 2000] [--seed 1] [--workers 1] [--write]
    python benchmarks/reliability/random_draws.py MACHINE --only NUMBER [--seed 1]

Goes on where it was ended, as what became of each draw is kept in build/random_draws.  What breaks is printed as a
parameter file; exit code 1 if there is any.  ``--only`` makes some of the draws once more, ``--write`` puts the counts
into docs/random-configurations.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))

from limited_worker import LimitedWorker, NoAnswerError
from measured import add_rows, here
from random_configurations import BROKEN, RAN, REFUSED_IN_RUN, UNBUILT, Outcome, outcome_of

from mech_twin.machines.catalog import CATALOGUE

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "build" / "random_draws"
LONGEST_S = 1200.0  # of one draw beside other work: more counts as broken
COLUMNS = (
    "machine",
    "seed",
    "drawn",
    "values refused on the way",
    "refused at configuration",
    "ran",
    "refused with one line in the run",
    "broken",
    "worst residual over its limit",
    "slowest",
    "made",
)


class Work(NamedTuple):
    """One draw to be made."""

    machine: str
    seed: int
    number: int


def made(work: Work) -> Outcome:
    """Make a draw; the function that a worker applies."""
    return outcome_of(*work)


def kept(name: str, seed: int) -> dict[int, dict[str, Any]]:
    """Return what is known of a machine's draws, the newest of each."""
    file = KEPT / f"{name}_{seed}.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return {record["number"]: record for record in map(json.loads, lines)}


def make_some(name: str, seed: int, numbers: Sequence[int]) -> None:
    """Make draws in one other process, which is ended where it does not come back in time, and keep each."""
    if not numbers:
        return
    worker = LimitedWorker(made, LONGEST_S)
    for number in numbers:
        try:
            outcome = worker.answer(Work(name, seed, number))
        except NoAnswerError as error:
            outcome = Outcome(number, BROKEN, str(error), 0.0, 0, LONGEST_S, "")
        keep(name, seed, outcome)
    worker.close()


def keep(name: str, seed: int, outcome: Outcome) -> None:
    """Write down what became of a draw, and print it where it broke."""
    text = "" if outcome.end == RAN else outcome.text
    with (KEPT / f"{name}_{seed}.jsonl").open("a", encoding="utf-8") as log:
        log.write(json.dumps(outcome._replace(text=text)._asdict() | {"made": here()}) + "\n")
    if outcome.end == BROKEN:
        print(f"# {name} {seed}/{outcome.number}: {outcome.what}\n{outcome.text}", flush=True)


def row(name: str, seed: int) -> list[Any]:
    """Return the counts of a machine's draws."""
    found = list(kept(name, seed).values())
    ends = Counter(record["end"] for record in found)
    counts = [ends[end] for end in (UNBUILT, RAN, REFUSED_IN_RUN, BROKEN)]
    margin, slowest = max(record["margin"] for record in found), max(record["seconds"] for record in found)
    refused, day = sum(record["refused"] for record in found), max(record["made"] for record in found)
    return [name, seed, len(found), refused, *counts, f"{margin:.2g}", f"{slowest:.1f} s", day]


def main() -> int:
    """Draw, and write what was seen."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINE", help=f"some of {', '.join(CATALOGUE)}; else all")
    parser.add_argument("--count", type=int, default=2000, help="draws of each machine")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1, help="processes that draw at the same time")
    parser.add_argument("--only", type=int, nargs="+", help="numbers of the draws to make once more")
    parser.add_argument("--write", action="store_true", help="write the table into docs/random-configurations.md")
    asked = parser.parse_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    broken = 0
    for name in asked.machines or CATALOGUE:
        done = kept(name, asked.seed)
        numbers = asked.only or [number for number in range(asked.count) if number not in done]
        shares = [numbers[place :: asked.workers] for place in range(asked.workers)]
        with ThreadPoolExecutor(asked.workers) as pool:
            list(pool.map(partial(make_some, name, asked.seed), shares))
        found = row(name, asked.seed)
        print(*found, sep=" | ", flush=True)
        broken += int(found[COLUMNS.index("broken")])
        if asked.write:
            add_rows("random_draws", COLUMNS, [found])
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main())

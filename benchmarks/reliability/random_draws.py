# SPDX-License-Identifier: Apache-2.0
"""Draw random legal configurations of a machine, analyse each and simulate half a second of it.

    python benchmarks/reliability/random_draws.py [MACHINE ...] [--first 0] [--count 2000] [--seed 1] [--workers 1]
    python benchmarks/reliability/random_draws.py MACHINE --only NUMBER [--seed 1]

The machines take turns.  Goes on where it was ended, as what became of each draw is kept in build/random_draws.
What breaks is printed as a parameter file; exit code 1 if there is any.  ``--only`` makes some of the draws once more,
``--write`` puts the counts into docs/proof/random-configurations.md, those from ``--first`` on in a row of their own.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))

from draws.keys import Changed
from draws.outcomes import BROKEN, RAN, REFUSED_IN_RUN, UNBUILT, Outcome, outcome_of
from draws.random_draw import Draw
from limited_worker import LimitedWorker, NoAnswerError
from measured import add_rows, here

from mech_twin.machines.catalog import CATALOGUE

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "build" / "random_draws"
LONGEST_CPU_S = 60.0  # processor time of one configuration: more counts as broken
LONGEST_S = 3600.0  # of one by the clock beside other work: more is no work but waiting, and broken as well
TURN_LENGTH = 50  # draws of a machine before the next one's turn
ENDS = (UNBUILT, RAN, REFUSED_IN_RUN, BROKEN)
COUNTED = (UNBUILT, RAN, "refused with one line in the run", BROKEN, "worst residual over its limit", "slowest")
COLUMNS = ("machine", "seed", "drawn", "values refused on the way", *COUNTED, "made")


class Work(NamedTuple):
    """One configuration to be made: its machine, its number, what is told of it, and how it is made."""

    machine: str
    number: int
    told: str
    make: Callable[[], Draw | Changed]


def made(work: Work) -> Outcome:
    """Make a configuration; the function of a worker, whose process ends where it takes too much processor time."""
    signal.setitimer(signal.ITIMER_PROF, LONGEST_CPU_S)
    outcome = outcome_of(work.number, work.make)
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    return outcome


def answer(worker: LimitedWorker, work: Work) -> Outcome:
    """Return what became of a configuration, made in another process with a limited time; print it where it broke."""
    try:
        outcome = worker.answer(work)
    except NoAnswerError as error:
        what = f"{error}; at most {LONGEST_CPU_S:g} s of processor time"
        outcome = Outcome(work.number, BROKEN, what, seconds=LONGEST_CPU_S)
    if outcome.end == BROKEN:
        print(f"# {work.machine} {work.told}: {outcome.what}\n{outcome.text}", flush=True)
    return outcome


def counted(found: Sequence[Outcome]) -> list[Any]:
    """Return the cells of a row that both tables have: how often each end was, the worst margin, the slowest."""
    ends = Counter(outcome.end for outcome in found)
    margin, slowest = max(outcome.margin for outcome in found), max(outcome.seconds for outcome in found)
    return [*(ends[end] for end in ENDS), f"{margin:.2g}", f"{slowest:.1f} s"]


def kept(name: str, seed: int) -> dict[int, dict[str, Any]]:
    """Return what is known of a machine's draws, the newest of each."""
    file = KEPT / f"{name}_{seed}.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return {record["number"]: record for record in map(json.loads, lines)}


def make_some(worker: LimitedWorker, seed: int, works: Sequence[Work]) -> None:
    """Make draws and keep what became of each."""
    for work in works:
        outcome = answer(worker, work)
        text = "" if outcome.end == RAN else outcome.text
        with (KEPT / f"{work.machine}_{seed}.jsonl").open("a", encoding="utf-8") as log:
            log.write(json.dumps(outcome._replace(text=text)._asdict() | {"made": here()}) + "\n")


def turns(missing: Mapping[str, Sequence[int]]) -> Iterator[tuple[str, Sequence[int]]]:
    """Yield a machine and the numbers of its next draws, machine after machine, till none is missing."""
    longest = max(map(len, missing.values()))
    for begin in range(0, longest, TURN_LENGTH):
        for name, numbers in missing.items():
            if begin < len(numbers):
                yield name, numbers[begin : begin + TURN_LENGTH]


def row(name: str, seed: int, first: int) -> list[Any]:
    """Return the counts of a machine's draws from a number on."""
    records = [dict(record) for number, record in kept(name, seed).items() if number >= first]
    day = max(record.pop("made") for record in records)
    found = [Outcome(**record) for record in records]
    drawn = f"{seed}, from {first} on" if first else seed
    return [name, drawn, len(found), sum(outcome.refused for outcome in found), *counted(found), day]


def missing_numbers(name: str, seed: int, first: int, count: int) -> list[int]:
    """Return which draws of a machine have not been made, of ``count`` from the first one on."""
    done = kept(name, seed)
    return [number for number in range(first, first + count) if number not in done]


def main() -> int:
    """Draw, and write what was seen."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINE", help=f"some of {', '.join(CATALOGUE)}; else all")
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--count", type=int, default=2000, help="draws of each machine")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1, help="processes that draw at the same time")
    parser.add_argument("--only", type=int, nargs="+", help="numbers of the draws to make once more")
    parser.add_argument("--write", action="store_true", help="write the table into docs/proof/random-configurations.md")
    asked = parser.parse_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    subprocess.run([sys.executable, str(ROOT / "test" / "compile_kernels.py")], check=True)  # no draw pays for them
    names = asked.machines or list(CATALOGUE)
    missing = {name: asked.only or missing_numbers(name, asked.seed, asked.first, asked.count) for name in names}
    workers = [LimitedWorker(made, LONGEST_S) for _ in range(asked.workers)]
    with ThreadPoolExecutor(asked.workers) as pool:
        for name, numbers in turns(missing):
            made_by = partial(Draw, name, asked.seed)
            works = [Work(name, number, f"{asked.seed}/{number}", partial(made_by, number)) for number in numbers]
            shares = [works[place :: asked.workers] for place in range(asked.workers)]
            list(pool.map(make_some, workers, [asked.seed] * asked.workers, shares))
            print(*row(name, asked.seed, asked.first), sep=" | ", flush=True)
    for worker in workers:
        worker.close()
    rows = [row(name, asked.seed, asked.first) for name in names]
    if asked.write:
        add_rows("random_draws", COLUMNS, rows, naming=2)  # machine and seed
    return int(any(found[COLUMNS.index("broken")] for found in rows))


if __name__ == "__main__":
    sys.exit(main())

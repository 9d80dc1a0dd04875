# SPDX-License-Identifier: Apache-2.0
"""Change one key of an installed configuration, and two, to every value that makes another machine of it.

    python benchmarks/reliability/value_pairs.py [MACHINE ...] [--workers 1] [--write]

Options, small counts, zeros and what is left out are paired with each other and with other sizes of every number; each
machine is analysed and simulated for half a second, its drive switched off and on again.  What breaks is printed as a
parameter file; exit code 1 if there is any.  ``--write`` puts the counts into docs/proof/random-configurations.md.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))

from changed_values import Change, outcome_of, paired_changes, single_changes, told
from limited_worker import LimitedWorker, NoAnswerError
from measured import add_rows, here
from random_configurations import BROKEN, RAN, REFUSED_IN_RUN, UNBUILT, Outcome

from mech_twin.machines.catalog import CATALOGUE

ROOT = Path(__file__).resolve().parents[2]
LONGEST_CPU_S = 60.0  # processor time of one configuration: more counts as broken
LONGEST_S = 3600.0
COLUMNS = (
    "machine",
    "one key",
    "two keys",
    "refused at configuration",
    "ran",
    "refused with one line in the run",
    "broken",
    "worst residual over its limit",
    "slowest",
    "made",
)


class Work(NamedTuple):
    """One configuration to be made."""

    machine: str
    number: int
    made: tuple[Change, ...]


def made(work: Work) -> Outcome:
    """Make a configuration; the function that a worker applies, which is ended where it takes too long."""
    signal.setitimer(signal.ITIMER_PROF, LONGEST_CPU_S)
    outcome = outcome_of(*work)
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    return outcome


def make_some(worker: LimitedWorker, works: Sequence[Work]) -> list[Outcome]:
    """Return what became of some configurations, and print those that broke."""
    found = []
    for work in works:
        try:
            outcome = worker.answer(work)
        except NoAnswerError as error:
            what = f"{told(work.made)}: {error}; at most {LONGEST_CPU_S:g} s of processor time"
            outcome = Outcome(work.number, BROKEN, what, 0.0, 0, LONGEST_CPU_S, "")
        if outcome.end == BROKEN:
            print(f"# {work.machine}: {outcome.what}\n{outcome.text}", flush=True)
        found.append(outcome)
    return found


def row(name: str, workers: Sequence[LimitedWorker], pool: ThreadPoolExecutor) -> list[Any]:
    """Return the counts of a machine."""
    singles, pairs = single_changes(name), paired_changes(name)
    works = [Work(name, number, made) for number, made in enumerate(singles + pairs)]
    shares = [works[place :: len(workers)] for place in range(len(workers))]
    found = [outcome for share in pool.map(make_some, workers, shares) for outcome in share]
    ends = Counter(outcome.end for outcome in found)
    counts = [ends[end] for end in (UNBUILT, RAN, REFUSED_IN_RUN, BROKEN)]
    margin, slowest = max(outcome.margin for outcome in found), max(outcome.seconds for outcome in found)
    return [name, len(singles), len(pairs), *counts, f"{margin:.2g}", f"{slowest:.1f} s", here()]


def main() -> int:
    """Make all of them, and write what was seen."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINE", help=f"some of {', '.join(CATALOGUE)}; else all")
    parser.add_argument("--workers", type=int, default=1, help="processes that work at the same time")
    parser.add_argument("--write", action="store_true", help="write the table into docs/proof/random-configurations.md")
    asked = parser.parse_args()
    subprocess.run([sys.executable, str(ROOT / "test" / "compile_kernels.py")], check=True)  # none pays for them
    workers, rows = [LimitedWorker(made, LONGEST_S) for _ in range(asked.workers)], []
    with ThreadPoolExecutor(asked.workers) as pool:
        for name in asked.machines or list(CATALOGUE):
            rows.append(row(name, workers, pool))
            print(*rows[-1], sep=" | ", flush=True)
    for worker in workers:
        worker.close()
    if asked.write:
        add_rows("value_pairs", COLUMNS, rows)
    return int(any(found[COLUMNS.index("broken")] for found in rows))


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""Change one key of an installed configuration, and two, to every value that makes another machine of it.

    python benchmarks/reliability/value_pairs.py [MACHINE ...] [--workers 1] [--write]

Options, small counts, zeros and what is left out are paired with each other and with other sizes of every number; each
machine is analysed and simulated for half a second, its drive switched off and on again.  What breaks is printed as a
parameter file; exit code 1 if there is any.  ``--write`` puts the counts into docs/proof/random-configurations.md.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))

from draws.keys import Changed, paired_changes, single_changes, told
from draws.outcomes import Outcome
from limited_worker import LimitedWorker
from measured import add_rows, here
from random_draws import COUNTED, LONGEST_S, ROOT, Work, answer, counted, made

from mech_twin.machines.catalog import CATALOGUE

COLUMNS = ("machine", "one key", "two keys", *COUNTED, "made")


def make_some(worker: LimitedWorker, works: Sequence[Work]) -> list[Outcome]:
    """Return what became of some configurations."""
    return [answer(worker, work) for work in works]


def row(name: str, workers: Sequence[LimitedWorker], pool: ThreadPoolExecutor) -> list[Any]:
    """Return the counts of a machine."""
    singles, pairs = single_changes(name), paired_changes(name)
    works = [Work(name, n, told(both), partial(Changed, name, both)) for n, both in enumerate(singles + pairs)]
    shares = [works[place :: len(workers)] for place in range(len(workers))]
    found = [outcome for share in pool.map(make_some, workers, shares) for outcome in share]
    return [name, len(singles), len(pairs), *counted(found), here()]


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

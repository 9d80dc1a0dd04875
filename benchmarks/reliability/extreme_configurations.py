# SPDX-License-Identifier: Apache-2.0
"""Set every number of every machine's configuration to extreme values, and analyse and simulate each.

    python benchmarks/reliability/extreme_configurations.py [MACHINE ...] [--share 0.1] [--write]

What is neither answered nor refused in one line is printed; exit code 1 if there is any.  ``--write`` writes the counts
into docs/proof/reliability.md.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))

from draws.keys import Change, extreme_changes
from draws.outcomes import ANSWERED, BALANCE, REFUSED, VERBS, CommandOutcome, command_outcome
from limited_worker import LimitedWorker, NoAnswerError
from measured import add_rows, here

from mech_twin.machines.catalog import CATALOGUE

LONGEST_S = 120.0  # of one case beside other work: more counts as endless
FIRST_S = 600.0  # of the first, which may compile
SEED = 1
COLUMNS = ("machine", "keys", "configurations", ANSWERED, REFUSED, BALANCE, "broken", "slowest", "made")


def outcome_of_case(case: tuple[str, Change]) -> CommandOutcome:
    """Return what became of a machine's change; the function that a worker applies."""
    return command_outcome(*case)


def tried(name: str, share: float) -> tuple[list[Change], list[CommandOutcome]]:
    """Try a share of a machine's cases; print what is wrong, at once."""
    chosen = extreme_changes(name)
    if share < 1.0:
        chosen = random.Random(f"{SEED} {name}").sample(chosen, round(share * len(chosen)))
    outcomes = []
    warm = LimitedWorker(outcome_of_case, FIRST_S)
    warm.answer((name, Change(("coupling", "step_s"), 1e-4)))
    warm.close()
    worker = LimitedWorker(outcome_of_case, LONGEST_S)
    for case in chosen:
        try:
            outcome = worker.answer((name, case))
        except NoAnswerError as error:
            outcome = CommandOutcome(dict.fromkeys(VERBS, str(error)), LONGEST_S)
        outcomes.append(outcome)
        for verb, end in outcome.ends.items():
            if end not in {ANSWERED, REFUSED, BALANCE}:
                print(f"{name} {case.key}={case.value!r} {verb}: {end}", flush=True)
    worker.close()
    return chosen, outcomes


def row(name: str, chosen: list[Change], outcomes: list[CommandOutcome]) -> list[Any]:
    """Return the counts of a machine."""
    # of the ends of a case the worst counts: what is wrong, a balance, a refusal, an answer
    good = (BALANCE, REFUSED, ANSWERED)
    counts = Counter(
        "broken" if not set(one.ends.values()) <= set(good) else next(end for end in good if end in one.ends.values())
        for one in outcomes
    )
    keys = len({case.key for case in chosen})
    slowest = max(outcome.seconds for outcome in outcomes)
    ends = [counts[end] for end in (ANSWERED, REFUSED, BALANCE, "broken")]
    return [name, keys, len(chosen), *ends, f"{slowest:.1f} s", here()]


def main() -> int:
    """Try the machines, and write what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="*", metavar="MACHINE")
    parser.add_argument("--share", type=float, default=1.0, help="of the cases, drawn with a fixed seed")
    parser.add_argument("--write", action="store_true", help="write the table into docs/proof/reliability.md")
    asked = parser.parse_args()
    broken = 0
    for name in asked.machines or CATALOGUE:
        found = row(name, *tried(name, asked.share))
        print(*found, sep=" | ", flush=True)
        broken += int(found[COLUMNS.index("broken")])
        if asked.write:
            add_rows("extreme_configurations", COLUMNS, [found])
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""Send every signal to every verb at every moment, and look at how it ends.

    python benchmarks/reliability/signals.py [VERB ...] [--write]

One row a verb and moment: the codes, the longest time to the end, what was wrong.  ``--write`` writes the table into
docs/proof/reliability.md.  Exit code 1 if anything was wrong.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", "56")

from measured import add_rows, here
from signal_cases import SIGNALS, VERBS, faults, seen_after

COLUMNS = ("verb", "signals sent", "longest time to the end, s", "exit codes", "wrong", "made")


def seen_at(name: str, moment: str) -> tuple[list[int | None], float, list[str]]:
    """Return the exit codes of a verb that gets every signal at a moment, the longest time (s), and what was wrong."""
    codes, longest, wrong = [], 0.0, []
    for number in SIGNALS:
        for group in (False, True):
            with tempfile.TemporaryDirectory() as folder:
                place = Path(folder)
                seen = seen_after(VERBS[name], moment, number, place, group)
                wrong += [f"{number.name}: {fault}" for fault in faults(VERBS[name], moment, number, seen, place)]
            codes.append(seen.code)
            longest = max(longest, seen.took_s)
    return codes, longest, wrong


def row(name: str) -> tuple[list[object], list[str]]:
    """Return the row of a verb, and what was wrong."""
    sent, times, told, wrong = 0, [], [], []
    for moment in VERBS[name].moments:
        codes, longest, faulty = seen_at(name, moment)
        print(name, moment, codes, f"{longest:.2f} s", *faulty, sep=" | ", flush=True)
        sent += len(codes)
        times.append(f"{moment} {longest:.2f}")
        told.append((moment, ", ".join(str(code) for code in dict.fromkeys(codes))))
        wrong += faulty
    first = told[0][1]
    codes_cell = "; ".join([first, *(f"{moment} {codes}" for moment, codes in told if codes != first)])
    return [f"`{name}`", sent, ", ".join(times), codes_cell, len(wrong), here()], wrong


def main() -> int:
    """Go through the matrix."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verbs", nargs="*", metavar="VERB", help=f"of {', '.join(VERBS)}")
    parser.add_argument("--write", action="store_true", help="write the table into docs/proof/reliability.md")
    asked = parser.parse_args()
    broken = 0
    for name in asked.verbs or VERBS:
        found, wrong = row(name)
        broken += len(wrong)
        if asked.write:
            add_rows("signals", COLUMNS, [found])
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main())

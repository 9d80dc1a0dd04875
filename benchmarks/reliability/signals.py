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

COLUMNS = ("verb and moment", "signals sent", "exit codes", "longest time to the end", "wrong", "made")


def row(name: str, moment: str) -> tuple[list[object], list[str]]:
    """Return the row of a verb and moment, and what was wrong."""
    codes, longest, wrong = [], 0.0, []
    for number in SIGNALS:
        for group in (False, True):
            with tempfile.TemporaryDirectory() as folder:
                place = Path(folder)
                seen = seen_after(VERBS[name], moment, number, place, group)
                wrong += [f"{number.name}: {fault}" for fault in faults(VERBS[name], moment, number, seen, place)]
            codes.append(seen.code)
            longest = max(longest, seen.took_s)
    told = ", ".join(str(code) for code in dict.fromkeys(codes))
    return [f"`{name}`, {moment}", len(codes), told, f"{longest:.2f} s", len(wrong), here()], wrong


def main() -> int:
    """Go through the matrix."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verbs", nargs="*", metavar="VERB", help=f"of {', '.join(VERBS)}")
    parser.add_argument("--write", action="store_true", help="write the table into docs/proof/reliability.md")
    asked = parser.parse_args()
    broken = 0
    for name in asked.verbs or VERBS:
        for moment in VERBS[name].moments:
            found, wrong = row(name, moment)
            print(*found, *wrong, sep=" | ", flush=True)
            broken += len(wrong)
            if asked.write:
                add_rows("signals", COLUMNS, [found])
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main())

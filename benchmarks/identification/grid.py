# SPDX-License-Identifier: Apache-2.0
"""What is found of each machine on a synthetic stand, beside the truth, and what is never to be called identified.

    python benchmarks/identification/grid.py [MACHINE]... [--seed N] [--write]

Ends with exit code 1 where a key that cannot be told is called identified, or where the interval of a combination, or
of a key that is called identified, misses the truth by more than its own half width.  A combination is asked where the
held keys truly are within the ranges that stand beside it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from evidence import write_rows
from interval_coverage import question_of
from synthetic_stand import STANDS, Stand

from mech_twin.studies.identification.identification import Identification, identified
from mech_twin.studies.identification.verdicts import Combination, KeyVerdict

HEADS = ("machine", "key", "true", "configured", "found", "95 % from", "to", "verdict", "holds")


def holds(told: KeyVerdict | Combination, true: float, margin: float = 0.0) -> bool:
    """Return whether an interval, made wider by a share of its half width, holds the truth."""
    far = margin * 0.5 * (told.high_95 - told.low_95)
    return told.low_95 - far <= true <= told.high_95 + far


def rows_of(stand: Stand, found: Identification) -> Iterator[tuple[object, ...]]:
    """Yield a row of each key and of each combination."""
    true = stand.truth()
    for key in found.keys:
        numbers = (true[key.key], key.before, key.estimate, key.low_95, key.high_95)
        told = key.verdict == "identified"
        yield (
            *(f"{stand.name}, {stand.duration_s:g} s", key.key, *(f"{number:.6g}" for number in numbers)),
            *(key.verdict, ("yes" if holds(key, true[key.key]) else "no") if told else ""),
        )
    for each in found.combinations:
        true_one, *rest = (f"{n:.6g}" for n in (each.of(true), each.estimate, each.low_95, each.high_95))
        kept = ("yes" if holds(each, each.of(true)) else "no") if each.applies(true) else "not asked"
        words = f"{each.formula}, for {each.condition}"
        yield (f"{stand.name}, {stand.duration_s:g} s", words, true_one, "", *rest, "combination", kept)


def wrongly_told(stand: Stand, found: Identification) -> list[str]:
    """Return the keys that are called identified and cannot be, and what is far outside its interval."""
    true = stand.truth()
    told = [key for key in found.keys if key.verdict == "identified"]
    keys = [key.key for key in told if key.key in stand.never or not holds(key, true[key.key], 1.0)]
    said = [each for each in found.combinations if each.applies(true)]
    return keys + [each.formula for each in said if not holds(each, each.of(true), 1.0)]


def main() -> None:
    words = argparse.ArgumentParser()
    words.add_argument("machines", nargs="*", default=list(STANDS))
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--write", action="store_true", help="into docs/proof/identification.md")
    asked = words.parse_args()
    wrong: list[str] = []
    for name in asked.machines:
        stand = STANDS[name]
        with tempfile.TemporaryDirectory() as folder:
            found = identified(question_of(stand, None), [stand.run(Path(folder), asked.seed)])
        rows = list(rows_of(stand, found))
        for row in rows:
            print(*row, sep="; ")
        wrong += [f"{name} {key}" for key in wrongly_told(stand, found)]
        fits = ", ".join(f"{each.channel} {each.fit_percent:.2f}" for each in found.channels)
        print(f"{found.seconds:.1f} s; fit of the channels, %: {fits}", flush=True)
        if asked.write:
            write_rows("grid", HEADS, rows)
    print("wrongly told:", wrong or "none")
    sys.exit(int(bool(wrong)))


if __name__ == "__main__":
    main()

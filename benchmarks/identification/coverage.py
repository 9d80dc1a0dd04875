# SPDX-License-Identifier: Apache-2.0
"""How often the 95 % intervals hold the truth: seeded repeats of a synthetic measurement, each identified anew.

    python benchmarks/identification/coverage.py MACHINE [--repeats N] [--first SEED]

Prints a row a key: how often it was called identified, and how often its interval then held the truth; and every key
that was called identified though it cannot be.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from synthetic_stand import STANDS

from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.identification import IdentificationQuestion, identified
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration


def main() -> None:
    words = argparse.ArgumentParser()
    words.add_argument("machine", choices=list(STANDS))
    words.add_argument("--repeats", type=int, default=50)
    words.add_argument("--first", type=int, default=0)
    asked = words.parse_args()
    stand = STANDS[asked.machine]
    base = machine_parameters(stand.name)
    configured = dict(zip(stand.keys, KeyedConfiguration(stand.name, base, stand.keys).values().tolist(), strict=True))
    true = {**configured, **stand.true}
    told, held, wrong, seconds = defaultdict(int), defaultdict(int), [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(asked.first, asked.first + asked.repeats):
            run = stand.run(Path(folder), seed)
            began = time.monotonic()
            found = identified(IdentificationQuestion(stand.name, base, stand.keys), [run])
            seconds.append(time.monotonic() - began)
            for key in found.keys:
                if key.verdict != "identified":
                    continue
                told[key.key] += 1
                held[key.key] += key.low_95 <= true[key.key] <= key.high_95
                if key.key in stand.never:
                    wrong.append((seed, key))
            print(f"seed {seed}, {seconds[-1]:.1f} s, {sum(held.values())} of {sum(told.values())} held", flush=True)
    print(f"{stand.name}: {len(seconds)} repeats, {sum(seconds) / len(seconds):.1f} s each in the mean")
    for key in stand.keys:
        if told[key]:
            print(f"  {key}: identified {told[key]} times, held {held[key]} times, {100 * held[key] / told[key]:.1f} %")
    every, all_held = sum(told.values()), sum(held.values())
    print(
        f"  all: {all_held} of {every}, {100.0 * all_held / max(every, 1):.1f} %; wrongly identified: {wrong or 'none'}"
    )


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""What is found of each machine on a synthetic stand, beside the truth, and what is never to be called identified.

    python benchmarks/identification/grid.py [MACHINE]...

Ends with exit code 1 where a key that cannot be told is called identified, or an interval misses the truth by more
than its own width.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from synthetic_stand import STANDS

from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.identification import IdentificationQuestion, identified
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration


def main() -> None:
    wrong = False
    for name in sys.argv[1:] or STANDS:
        stand = STANDS[name]
        base = machine_parameters(name)
        keyed = KeyedConfiguration(name, base, stand.keys)
        true = {**dict(zip(stand.keys, keyed.values().tolist(), strict=True)), **stand.true}
        with tempfile.TemporaryDirectory() as folder:
            run = stand.run(Path(folder), 0)
            found = identified(IdentificationQuestion(name, base, stand.keys), [run])
        print(f"{name}: {stand.duration_s:g} s of run, {found.seconds:.1f} s")
        for key in found.keys:
            numbers = (
                f"{true[key.key]:12.6g} {key.before:12.6g} {key.estimate:12.6g} [{key.low_95:.6g}, {key.high_95:.6g}]"
            )
            print(f"  {key.key:34} {numbers} {key.verdict}")
            if key.verdict == "identified":
                far = 0.5 * (key.high_95 - key.low_95)
                outside = not key.low_95 - far <= true[key.key] <= key.high_95 + far
                if outside or key.key in stand.never:
                    wrong = True
                    print("    WRONG")
        for each in found.combinations:
            print(f"  {each.formula}: {each.estimate:.6g} [{each.low_95:.6g}, {each.high_95:.6g}]")
        print(
            "  fit of the channels, %:",
            ", ".join(f"{c.channel} {c.fit_percent:.2f}" for c in found.channels),
            flush=True,
        )
    sys.exit(int(wrong))


if __name__ == "__main__":
    main()

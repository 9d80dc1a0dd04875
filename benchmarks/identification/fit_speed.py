# SPDX-License-Identifier: Apache-2.0
"""How long a whole identification takes: ten seconds of the breaker's stand, all eight keys open.

    OPENBLAS_NUM_THREADS=1 python benchmarks/identification/fit_speed.py [--duration-s 10]

On all cores; kernels are loaded before.  Printed are seconds by the clock and of the processor, these over those of one
simulation of the recording (least of three), and what became of each key.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from interval_coverage import question_of
from synthetic_stand import SHORT_STANDS, STANDS, Stand

from mech_twin.studies.identification.identification import Identification, identified
from mech_twin.studies.named_rollouts import rollout


def found_in(stand: Stand) -> tuple[Identification, float, float]:
    """Return what is found of a stand, and how long that took (s): by the clock, and of the processor."""
    with tempfile.TemporaryDirectory() as folder:
        run = stand.run(Path(folder), 0)
    clock_s, processor_s = time.perf_counter(), time.process_time()
    found = identified(question_of(stand, None), [run])
    return found, time.perf_counter() - clock_s, time.process_time() - processor_s


def simulated_s(stand: Stand) -> float:
    """Return the least processor time of three simulations of a stand's run, with the columns of its sensors (s)."""
    columns, times = [each["is"] for each in stand.sensors if not each["is"].startswith("event.")], []
    for _ in range(3):
        began = time.process_time()
        rollout(stand.name, stand.duration_s, stand.true, columns=columns)
        times.append(time.process_time() - began)
    return min(times)


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration-s", type=float, default=10.0)
    duration_s = parser.parse_args().duration_s
    found_in(SHORT_STANDS["mb10_breaker"])
    stand = replace(STANDS["mb10_breaker"], duration_s=duration_s)
    found, clock_s, processor_s = found_in(stand)
    once_s = simulated_s(stand)
    print(f"breaker, {duration_s:g} s, {len(found.keys)} keys: {clock_s:.1f} s, {processor_s:.1f} s of the processor")
    print(f"  one simulation {once_s:.3f} s: the fit takes {processor_s / once_s:.0f} times as long")
    for key in found.keys:
        print(f"  {key.key}: {key.estimate:.6g} [{key.low_95:.6g}, {key.high_95:.6g}] {key.verdict}")


if __name__ == "__main__":
    main()

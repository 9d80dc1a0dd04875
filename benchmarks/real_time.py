# SPDX-License-Identifier: Apache-2.0
"""Does a run hold real time?  ``python benchmarks/real_time.py [SECONDS]`` runs the breaker, recorded and shown.

Prints what was sent and recorded, how late the latest step was, and the margin: how fast the same run goes when
nothing holds it back, start and end left out by the difference of two runs.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from mech_twin.nodes.domain import settle_domain

MACHINE = "mb10_breaker"
UNPACED_S = (5.0, 20.0)


def main() -> None:
    """Run, and print what was seen."""
    settle_domain()
    duration = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    print(f"paced by the clock: {duration:g} s simulated in {timed('realtime', duration):.2f} s, start included")
    short, long = (timed("max", length) for length in UNPACED_S)
    print(f"unpaced: {(UNPACED_S[1] - UNPACED_S[0]) / (long - short):.2f} times real time")


def timed(pace: str, duration: float) -> float:
    """Return how long a run takes, recorded and shown, and print what was seen of it."""
    from mech_twin.nodes.composition import run_in_process
    from mech_twin.nodes.options import RunOptions
    from mech_twin.parameters.load import machine_parameters

    with tempfile.TemporaryDirectory() as folder:
        bag, picture = Path(folder) / "bag", str(Path(folder) / "view.rrd")
        options = RunOptions(pace=pace, duration_s=duration, recorder=True, viewer=True)
        cpu, wall = time.process_time(), time.monotonic()
        outcome = run_in_process(MACHINE, machine_parameters(MACHINE), options, bag, picture)
        cpu, wall = time.process_time() - cpu, time.monotonic() - wall
        lost = sum(n - outcome.recorded[name] for name, n in outcome.sent.items() if name in outcome.recorded)
        late = f"; latest step {worst_lag_s(bag) * 1e3:.0f} ms late" if pace == "realtime" else ""
        print(f"  {sum(outcome.recorded.values())} messages recorded, {lost} not; CPU {cpu / wall:.0%} of a core{late}")
    return wall


def worst_lag_s(bag: Path) -> float:
    """Return how late the latest step was, as the linkage said."""
    from mech_twin.recording.bag_reader import BagReader
    from mech_twin.recording.decode import MessageDecoder

    with BagReader(bag) as reader:
        decoder = MessageDecoder(reader.topics)
        rows = [decoder.decode(row) for row in reader.messages(topics=["/diagnostics"])]
    said = [status.values for row in rows for status in row.status if status.name.endswith("/linkage")]
    return max(float(pair.value) for values in said for pair in values if pair.key == "worst lag s")


if __name__ == "__main__":
    main()

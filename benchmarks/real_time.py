# SPDX-License-Identifier: Apache-2.0
"""Does a run hold real time?  ``python benchmarks/real_time.py [SECONDS] [--write]``: the breaker, recorded and shown.

What was sent and recorded, the processor time, how late the latest step was, and the margin: how fast the same run goes
when nothing holds it back, start and end left out by the difference of two runs.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from comparison import Table, measure

from mech_twin.nodes.run.domain import settle_domain

MACHINE = "mb10_breaker"
PACED_S = 20.0
UNPACED_S = (3.0, 9.0)


class Run(NamedTuple):
    """What was seen of a run: wall clock and processor time (s), messages, and how late the latest step was (s)."""

    wall_s: float
    process_s: float
    recorded: int
    lost: int
    late_s: float


def ran(pace: str, duration_s: float) -> Run:
    """Run the machine, recorded and shown."""
    from mech_twin.nodes.exchange.base_node import RunOptions
    from mech_twin.nodes.run.composition import run_in_process
    from mech_twin.parameters.load import machine_parameters

    with tempfile.TemporaryDirectory() as folder:
        bag, picture = Path(folder) / "bag", str(Path(folder) / "view.rrd")
        options = RunOptions(pace=pace, duration_s=duration_s, recorder=True, viewer=True)
        process, wall = time.process_time(), time.monotonic()
        outcome = run_in_process(MACHINE, machine_parameters(MACHINE), options, bag, picture)
        process, wall = time.process_time() - process, time.monotonic() - wall
        lost = sum(n - outcome.received[name] for name, n in outcome.sent.items() if name in outcome.received)
        return Run(wall, process, sum(outcome.received.values()), lost, worst_lag_s(bag))


def worst_lag_s(bag: Path) -> float:
    """Return how late the latest step was, as the linkage said."""
    from mech_twin.recording.bag_reader import BagReader
    from mech_twin.recording.measured_topics import MessageDecoder

    with BagReader(bag) as reader:
        decoder = MessageDecoder(reader.topics)
        rows = [decoder.decode(row) for row in reader.messages(topics=["/diagnostics"])]
    said = [status.values for row in rows for status in row.status if status.name.endswith("/linkage")]
    return max(float(pair.value) for values in said for pair in values if pair.key == "worst lag s")


def measured(duration_s: float) -> list[Table]:
    """Return the table of a run by the wall clock and of its margin."""
    settle_domain()
    short, long = (ran("max", length) for length in UNPACED_S)
    paced = ran("realtime", duration_s)
    rows = [
        ("wall clock of the run, start included", f"{paced.wall_s:.2f} s"),
        ("processor time, of one core", f"{paced.process_s / paced.wall_s:.0%}"),
        ("messages recorded", paced.recorded),
        ("messages lost", paced.lost),
        ("latest step was late by", f"{1e3 * paced.late_s:.0f} ms"),
        ("unpaced, times real time", f"{(UNPACED_S[1] - UNPACED_S[0]) / (long.wall_s - short.wall_s):.2f}"),
    ]
    how = f"{MACHINE} at its step of 1 ms for {duration_s:g} s, all nodes in one process, recorded, shown into a file."
    return [Table(how, ("what", "found"), rows)]


def main() -> None:
    """Measure for so many seconds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seconds", type=float, nargs="?", default=PACED_S)
    parser.add_argument("--write", action="store_true", help="put the table into docs/proof/performance.md")
    asked = parser.parse_args()
    measure("real_time", lambda: measured(asked.seconds), write=asked.write)


if __name__ == "__main__":
    main()

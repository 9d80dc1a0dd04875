"""Does a run hold real time?  ``python benchmarks/real_time.py [SECONDS]`` runs the breaker, recorded and shown.

Prints what was sent and recorded by topic, and how late the latest step was.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from mech_twin.nodes.domain import settle_domain

MACHINE = "mb10_breaker"


def main() -> None:
    """Run, and print what was seen."""
    settle_domain()
    from mech_twin.nodes.crew import run_in_process
    from mech_twin.nodes.options import RunOptions
    from mech_twin.parameters.load import machine_parameters
    from mech_twin.recording.bag_reader import BagReader
    from mech_twin.recording.decode import Decoder

    duration = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    with tempfile.TemporaryDirectory() as folder:
        options = RunOptions(pace="realtime", duration_s=duration, recorder=True, viewer=True)
        bag, picture = Path(folder) / "bag", str(Path(folder) / "view.rrd")
        cpu, wall = time.process_time(), time.monotonic()
        outcome = run_in_process(MACHINE, machine_parameters(MACHINE), options, bag, picture)
        cpu, wall = time.process_time() - cpu, time.monotonic() - wall
        lost = {name: n - outcome.recorded.get(name, 0) for name, n in outcome.sent.items() if name in outcome.recorded}
        print(f"{duration:g} s simulated in {wall:.2f} s (start included), CPU {cpu / wall:.0%} of a core")
        print(f"recorded {sum(outcome.recorded.values())} messages, not recorded {sum(lost.values())}")
        with BagReader(bag) as reader:
            decoder = Decoder(reader.topics)
            statuses = [
                status
                for row in reader.messages(topics=["/diagnostics"])
                for status in decoder.decode(row).status
                if status.name.endswith("/linkage")
            ]
        print(f"latest step: {max(float(_value(status, 'worst lag s')) for status in statuses) * 1e3:.1f} ms late")


def _value(status: object, key: str) -> str:
    return next(item.value for item in status.values if item.key == key)  # type: ignore[attr-defined]


if __name__ == "__main__":
    main()

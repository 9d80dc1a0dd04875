# SPDX-License-Identifier: Apache-2.0
"""A process ends, and keeps what it has recorded, though its middleware never lets go."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mech_twin.nodes.exchange import spinner

# holds the interpreter's lock for a minute, as the middleware does
STUCK = """
import ctypes, sys
from pathlib import Path
from mech_twin.nodes.exchange import spinner
from mech_twin.nodes.exchange.base_node import TwinNode

class Stuck(TwinNode):
    outputs = ()
    def __init__(self): pass
    def close(self): Path(sys.argv[1]).write_text("closed")
    def destroy_node(self): ctypes.PyDLL(None).sleep(60)

spinner.LIMIT_S = 0.5
spinner.destroy_nodes([Stuck()])
"""


def test_what_never_lets_go_is_ended_after_all_is_closed(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", STUCK, str(tmp_path / "file")], check=False, timeout=40)
    assert done.returncode == -signal.SIGALRM
    assert (tmp_path / "file").read_text() == "closed"


def test_somebody_elses_alarm_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[int] = []
    monkeypatch.setattr(spinner, "LIMIT_S", 30.0)
    before = signal.signal(signal.SIGALRM, lambda number, frame: heard.append(number))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        spinner.destroy_nodes([])
        end = time.monotonic() + 5.0
        while not heard and time.monotonic() < end:
            time.sleep(0.01)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert heard == [signal.SIGALRM]

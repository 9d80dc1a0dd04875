# SPDX-License-Identifier: Apache-2.0
"""Memory, threads and open files of a run do not grow: the short form of ``benchmarks/reliability/soak.py``."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from footprint import FootprintLog
from process_run import ProcessRun

SOAK_S = 30.0
GROWTH_MIB = 3.0  # of some 260: what the allocator moves about


@pytest.mark.slow
def test_memory_threads_and_open_files_stay_as_they_are(ros_domain: int, tmp_path: Path) -> None:
    log = FootprintLog()
    with ProcessRun("winding_drum", tmp_path, recorder=True, pace="max") as run:
        run.start_all()
        end = time.monotonic() + SOAK_S
        while time.monotonic() < end:
            run.spin_for(1.0)
            run.checked()
            log.look(time.monotonic(), {role: process.pid for role, process in run.processes.items()})
        assert run.step > 5000
        assert run.finish("recorder") == 0
    for role in log.rows:
        assert log.growth_mib(role) < GROWTH_MIB, f"{role}: {log.told(role)}"
        assert log.changes(role) == (0, 0), f"{role}: {log.told(role)}"

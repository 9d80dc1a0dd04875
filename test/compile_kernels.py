# SPDX-License-Identifier: Apache-2.0
"""Compile the kernels of every machine, and of pages, ahead of the tests: one a process, one process a core.

    python test/compile_kernels.py

Tests that run side by side would each compile a kernel that neither finds.  What is compiled already is loaded.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from rollout_cases import CASES

import mech_twin
from mech_twin.engine.run import warm_up, warm_up_run
from mech_twin.kernels.kernel import compiled_count
from mech_twin.parameters.load import machine

LONGEST_FIRST = ("mb10_breaker", "roller_former", "page")
PAGE = Path(__file__).parents[1] / "config" / "pages" / "breaker.yaml"  # the kernels of any page but its own mechanics


def compiled(name: str) -> tuple[str, int, float]:
    """Take steps of a machine in each way there is; return its name, how many kernels that compiled, and the time."""
    begun = time.perf_counter()
    cases = [machine(name, None, overrides) for case, overrides in CASES if case == name]
    for built in cases or [machine(name, PAGE)]:
        warm_up(built)
        warm_up_run(built)
        mech_twin.rollout(built, duration_s=2 * built.coupling_step_s)
    return name, compiled_count(), time.perf_counter() - begun


def main() -> None:
    """Compile, and say what each machine took."""
    others = sorted({name for name, _ in CASES} - {*LONGEST_FIRST})
    names = [*LONGEST_FIRST, *others]
    cores = len(os.sched_getaffinity(0))
    spawning = multiprocessing.get_context("spawn")  # no state of this process in the others
    with ProcessPoolExecutor(min(cores, len(names)), mp_context=spawning, max_tasks_per_child=1) as pool:
        for done in as_completed([pool.submit(compiled, name) for name in names]):
            name, count, took_s = done.result()
            sys.stdout.write(f"{name}: {count} kernels compiled, {took_s:.0f} s\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()

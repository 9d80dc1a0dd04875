# SPDX-License-Identifier: Apache-2.0
"""A terminal is told that kernels compile, and how many; warnings of the compiler are passed on."""

from __future__ import annotations

import logging
import os
import subprocess
import sys

import pytest

from mech_twin.cli.console import FIRST_TOLD_S, CompileProgress
from mech_twin.machines.catalog import CATALOGUE

COMPILING_FOR_REAL = """
import logging, sys
from mech_twin.cli import console
now, lines = [0.0], []
handler = console.CompileProgress(lines.append, lambda: now[0])
logger = logging.getLogger(console.LOGGER)
logger.addHandler(handler)
logger.setLevel(logging.INFO)
assert "numba" not in sys.modules, "the command line does not load the compiler for it"
from mech_twin.kernels.kernel import kernel
from mech_twin.kernels.cache import COMPILING
doubled, halved = kernel(lambda x: 2.0 * x), kernel(lambda x: 0.5 * x)
assert (doubled(1.0), lines) == (2.0, [f"{COMPILING}\\n"])
now[0] = 7.0
assert halved(1.0) == 0.5
assert lines[1:] == ["  kernels compiled, once: 1 in 7 s, going on\\n"], lines
handler.close()
assert doubled(1) == 2.0
assert len(lines) == 2, "after its end it observes no longer"
"""
FIRST_RUN = """
import atexit, sys
from mech_twin.cli.main import main
from mech_twin.kernels.cache import compiled_count
atexit.register(lambda: sys.stderr.write(f"compiled {compiled_count()}"))
main()
"""


@pytest.mark.slow
def test_each_compilation_is_counted() -> None:
    subprocess.run([sys.executable, "-c", COMPILING_FOR_REAL], check=True, timeout=250)


def test_lines_come_at_growing_intervals() -> None:
    now, lines = [0.0], []
    handler = CompileProgress(lines.append, lambda: now[0])
    for second in range(100):
        now[0] = float(second)
        handler.compiling("a kernel", second + 1)
    told_s = [int(line.split(" in ")[1].split()[0]) for line in lines]
    assert told_s == [5, 10, 20, 40, 80]
    assert told_s[0] == FIRST_TOLD_S


def test_a_warning_of_the_compiler_is_passed_on_and_begins_nothing() -> None:
    lines: list[str] = []
    handler = CompileProgress(lines.append)
    handler.handle(logging.LogRecord("mech_twin.kernels", logging.WARNING, __file__, 1, "%s: damaged", ("file",), None))
    handler.close()
    assert lines == ["file: damaged\n"]


@pytest.mark.slow
def test_a_first_run_compiles_as_many_kernels_as_its_page_counts_to(ros_domain, tmp_path) -> None:
    words = ["run", "impact_mass", "--view", "none", "--no-record", "--duration", "0.05", "--pace", "max"]
    folders = {"MECH_TWIN_CACHE_DIR": str(tmp_path / "kernels"), "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", FIRST_RUN, *words]
    done = subprocess.run(command, check=True, env=os.environ | folders, capture_output=True, text=True, timeout=500)
    count = int(done.stderr.rpartition("compiled ")[2])
    assert CATALOGUE["impact_mass"].kernels == 10 * -(-count // 10)

# SPDX-License-Identifier: Apache-2.0
"""A signal that arrives where the compiler drops exceptions ends the process all the same, and at once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("ros_domain")]
# the compiler calls Python from finalizers and from callbacks of C, at which the interpreter drops what is raised
PLACES = {
    "finalizer": ("llvmlite.binding.ffi", "ObjectRef", "close"),
    "callback": ("numba.core.codegen", "JITCodeLibrary", "_object_compiled_hook"),
}
SIGNALLED = """
import importlib, os, sys
module, kind, name = {place!r}
owner = getattr(importlib.import_module(module), kind)
original, calls = getattr(owner, name), []
def signalled(*arguments):
    calls.append(name)
    if len(calls) == 3:
        sys.stderr.write("sent\\n")
        os.kill(os.getpid(), {number})
    return original(*arguments)
setattr(owner, name, signalled)
sys.argv = {words!r}
{call}
"""
COMMAND = "from mech_twin.cli.main import main; main()"
DOORS = {
    "simulate": (COMMAND, ["mech-twin", "simulate", "winding_drum", "--duration", "1", "--bag", "BAG"]),
    "run": (COMMAND, ["mech-twin", "run", "winding_drum", "--view", "none", "--record", "BAG"]),
    "node": (
        "from mech_twin.nodes.run.executables import linkage_node; linkage_node()",
        ["linkage_node", "--ros-args", "-p", "machine:=winding_drum"],
    ),
}
NUMBERS = (signal.SIGINT, signal.SIGTERM)
# each door at each place, and each of both with either signal
CASES = [(door, place, NUMBERS[(i + j) % 2]) for i, door in enumerate(DOORS) for j, place in enumerate(PLACES)]


@pytest.mark.parametrize(("door", "place", "number"), CASES)
def test_a_signal_while_compiling_ends_the_process(
    door: str, place: str, number: signal.Signals, tmp_path: Path
) -> None:
    call, words = DOORS[door]
    bag = tmp_path / "bag"
    script = SIGNALLED.format(
        place=PLACES[place], number=int(number), call=call, words=[str(bag) if w == "BAG" else w for w in words]
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False,
        env={**os.environ, "MECH_TWIN_CACHE_DIR": str(tmp_path / "kernels")},
    )  # fmt: skip
    assert "sent" in done.stderr, "nothing was compiled"
    assert done.returncode == 128 + number, done.stderr
    assert "Traceback" not in done.stderr
    assert "ignored" not in done.stderr
    assert not bag.exists(), "a recording was open"

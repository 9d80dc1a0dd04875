# SPDX-License-Identifier: Apache-2.0
"""A signal within an import or a library's callback ends a program with 128 + N and without a trace."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mech_twin.process.interruption import INTERRUPTED_LINE

# sends the signal to itself the moment that a module begins to be imported; without one, lists them instead
PROGRAM = """
import os, sys
from mech_twin.programs import {program}
def heard(event, given):
    if event == "import":
        if not {module!r}:
            sys.stdout.write(given[0] + "\\n")
        if given[0] == {module!r}:
            os.kill(os.getpid(), {number})
sys.addaudithook(heard)
{program}()
"""
LOADED = {
    "command": {"typer", "mech_twin.cli.main", "mech_twin.cli.study_verbs"},
    "linkage_node": {"argparse", "mech_twin.nodes.run.executables", "mech_twin.machines.catalog", "pydantic"},
}
WORDS = {"command": ["--version"], "linkage_node": ["--help"]}
MOMENTS = 4
ROOT = Path(__file__).resolve().parents[2]


def done(program: str, module: str = "", number: int = 0, **options: object) -> subprocess.CompletedProcess[str]:
    code = PROGRAM.format(program=program, module=module, number=int(number))
    command = [sys.executable, "-c", code, *WORDS[program]]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, **options)  # type: ignore[call-overload]


@pytest.mark.parametrize("program", LOADED)
def test_a_signal_while_importing_ends_a_program_without_a_trace(program: str) -> None:
    modules = [name for name in done(program).stdout.splitlines() if name.replace(".", "").isidentifier()]
    assert set(modules) >= LOADED[program]
    chance = random.Random(f"{program} while importing")
    for module in [modules[0], *chance.sample(modules, MOMENTS)]:
        number = chance.choice([signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
        ended = done(program, module, number)
        assert ended.returncode == 128 + number, (module, ended.stderr)
        assert ended.stderr == (INTERRUPTED_LINE if number == signal.SIGINT else ""), module


def test_a_program_that_is_told_to_outlive_its_terminal_does() -> None:
    ended = done("command", "typer", signal.SIGHUP, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.startswith("mech-twin ")


# the signal comes where Python 3.11 turns an exception into another one, and where a callback drops it
IN_A_CLASS = """
import os
class Field:
    def __set_name__(self, owner, name):
        os.kill(os.getpid(), {number})
class Model:
    field = Field()
"""
IN_A_CALLBACK = """
import os, weakref
class Gone:
    pass
gone = Gone()
kept = weakref.ref(gone, lambda reference: os.kill(os.getpid(), {number}))
del gone
"""
UNDER_WAY = {
    "a verb": "from mech_twin.process.interruption import interruptible as answering",
    "a node": "from mech_twin.process.interruption import StopSignal\ndef answering():\n    return stop.interrupting()",
}
IMPORT = """
from contextlib import nullcontext
{opening}
with {around} as stop, answering():
    import imported
    print("went on")
"""


@pytest.mark.parametrize("module", [IN_A_CLASS, IN_A_CALLBACK])
@pytest.mark.parametrize("kind", UNDER_WAY)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_machine_is_imported_is_neither_lost_nor_changed(
    module: str, kind: str, number: signal.Signals, tmp_path: Path
) -> None:
    (tmp_path / "imported.py").write_text(module.format(number=int(number)))
    around = "StopSignal()" if kind == "a node" else "nullcontext()"
    (tmp_path / "program.py").write_text(IMPORT.format(opening=UNDER_WAY[kind], around=around))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    command = [sys.executable, str(tmp_path / "program.py")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=environment)
    line = INTERRUPTED_LINE if number == signal.SIGINT and kind == "a verb" else ""
    assert (ended.returncode, ended.stdout, ended.stderr) == (128 + number, "", line)


# its error takes the place of the exception: "user-defined function raised exception"
IN_A_LIBRARY = """
import os, sqlite3
from contextlib import nullcontext
from mech_twin.cli.console import report_cli_errors
{opening}
rows = sqlite3.connect(":memory:")
rows.create_function("ask", 0, lambda: os.kill(os.getpid(), {number}))
with report_cli_errors(), {around} as stop, answering():
    rows.execute("select ask()")
"""


@pytest.mark.parametrize("kind", UNDER_WAY)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_librarys_callback_is_not_taken_for_an_error_of_the_library(
    kind: str, number: signal.Signals
) -> None:
    around = "StopSignal()" if kind == "a node" else "nullcontext()"
    code = IN_A_LIBRARY.format(opening=UNDER_WAY[kind], around=around, number=int(number))
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert (ended.returncode, ended.stdout) == (128 + number, "")
    assert ended.stderr == (INTERRUPTED_LINE if number == signal.SIGINT else "")

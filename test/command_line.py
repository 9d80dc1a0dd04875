# SPDX-License-Identifier: Apache-2.0
"""The command line, run in this process or as a program."""

from __future__ import annotations

import io
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from mech_twin.cli.main import main


class Ended(NamedTuple):
    """How a command ended: exit code, standard output, standard error."""

    code: Any
    out: str
    err: str


def mech_twin(*words: str | Path | float) -> Ended:
    """Run ``mech-twin`` with these words."""
    output, errors = io.StringIO(), io.StringIO()
    code: Any = 0
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(output), redirect_stderr(errors):
        patch.setattr(sys, "argv", ["mech-twin", *map(str, words)])
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return Ended(code, output.getvalue(), errors.getvalue())


def in_a_process(*words: str | Path) -> Ended:
    """Run ``mech-twin`` as a program, which a run of nodes needs to answer signals."""
    done = subprocess.run(
        [sys.executable, "-m", "mech_twin", *map(str, words)], capture_output=True, text=True, timeout=200, check=False
    )
    return Ended(done.returncode, done.stdout, done.stderr)

# SPDX-License-Identifier: Apache-2.0
"""Run two lists of commands side by side: the first at idle priority, in the time that the second leaves.

    python test/side_by_side.py COMMAND... beside COMMAND... [then COMMAND...]

Tests over topics wait half of their time, and quiet tests need nothing but a processor.  What the quiet ones say is
shown at their end.  The exit code is 1 if a command failed; a command that follows a failed one is not run.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress


def parted(words: Sequence[str], mark: str) -> list[list[str]]:
    """Return the words in parts, ended by ``mark``."""
    parts: list[list[str]] = [[]]
    for word in words:
        if word == mark:
            parts.append([])
        else:
            parts[-1].append(word)
    return parts


def main(words: Sequence[str]) -> int:
    """Run the commands; return the exit code."""
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    quiet, others = parted(words, "beside")
    with tempfile.TemporaryFile("w+") as said, subprocess.Popen(quiet, stdout=said) as beside:
        with suppress(OSError):  # a system without idle priority runs both alike
            os.sched_setscheduler(beside.pid, os.SCHED_IDLE, os.sched_param(0))  # what it starts is idle too
        try:
            failed = any(subprocess.run(command, check=False).returncode for command in parted(others, "then"))
            failed = beside.wait() != 0 or failed
        finally:
            beside.terminate()
        said.seek(0)
        sys.stdout.write(said.read())
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

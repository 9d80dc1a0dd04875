# SPDX-License-Identifier: Apache-2.0
"""Starts and ends the process of a bench, and provides its address."""

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mech_twin.errors import ViewerError
from mech_twin.process.closing import Closing
from mech_twin.process.terminal_output import printable
from mech_twin.view.bench.link import FEED, PREFIX

LOOPBACK = "127.0.0.1"
STOP_LIMIT_S = 2.0
PROGRAM = "from mech_twin.nodes.run.bench_process import main; main()"


def _to_stderr(line: str) -> None:
    sys.stderr.write(printable(line) + "\n")


class StartedBench(Closing):
    """The running bench; a context manager.

    Its process ends with the thread that starts it, even by SIGKILL.

    Parameters
    ----------
    port : int or None
        Port of the page; None or 0 selects a free one.
    open_to_other_hosts : bool
        Listen on all interfaces instead of the loopback interface; a warning is announced.
    history_bytes : int
        Size of the history of pictures for pages opened later.
    hall : mapping, optional
        Folder of recordings, and machines to run, for a start page.
    announce : callable
        Receives the warning (default: standard error).

    Raises
    ------
    ViewerError
        The port is in use, or the process ended; one line.
    """

    def __init__(
        self,
        port: int | None = None,
        *,
        open_to_other_hosts: bool = False,
        history_bytes: int = 32 << 20,
        hall: Mapping[str, Any] | None = None,
        announce: Callable[[str], None] = _to_stderr,
    ) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="mech_twin_bench_"))  # accessible to this user only
        settings = {
            "port": port or 0,
            "folder": str(self._folder),
            "others": open_to_other_hosts,
            "history_bytes": history_bytes,
            "parent": os.getpid(),
            "hall": hall,
        }
        # own session: Ctrl-C in the terminal reaches only the run, which then ends the bench
        self._process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            answer = self._answer_to(json.dumps(settings))
            if "error" in answer:
                self._process.wait(STOP_LIMIT_S)  # it ends by itself
                raise ViewerError(f"view: {answer['error']}")
        except BaseException:
            self.close()
            raise
        self.port = int(answer["port"])
        self._token = answer["token"]
        if open_to_other_hosts:
            announce(
                f"view: OPEN TO OTHER HOSTS, in plain text: page on port {self.port}, all interfaces of "
                f"{socket.gethostname()}; anyone with the whole address can watch and command"
            )

    @property
    def url(self) -> str:
        """Address of the page with its token, after a # so that browsers do not transmit it."""
        return f"http://{LOOPBACK}:{self.port}/#{self._token}"

    @property
    def place(self) -> str:
        """Address for messages to the bench; see `BenchLink`."""
        return f"{PREFIX}{self._folder / FEED}"

    @property
    def pid(self) -> int | None:
        """Process id of the bench; None if it does not run."""
        return self._process.pid if self._process.poll() is None else None

    def close(self) -> None:
        """End the bench and remove its files; idempotent."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None and not stream.closed:
                stream.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _answer_to(self, line: str) -> dict[str, str]:
        """Send the process its configuration; return its answer."""
        stdin, stdout = self._process.stdin, self._process.stdout
        if stdin is None or stdout is None:
            raise ViewerError("view: the page's process has no input or output")
        try:
            stdin.write(line + "\n")
            stdin.close()
        except BrokenPipeError:
            pass
        answer = stdout.readline()
        if not answer:
            raise ViewerError(f"view: the page's process ended at once with code {self._process.wait()}")
        found: dict[str, str] = json.loads(answer)
        return found

"""The viewer's server as a process of its own: bound to this machine, ended by its process number.

The Python call that serves the viewer binds every interface and has no option against it, and the wrapper script
orphans the server when it is killed.  So the binary itself is started here.
"""

from __future__ import annotations

import http.client
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from urllib.parse import quote

from mech_twin.dependencies import extra_needed

LOOPBACK = "127.0.0.1"
EVERYWHERE = "0.0.0.0"  # bound only when the caller asks for it by name
STOP_LIMIT_S = 0.8


class ViewerError(RuntimeError):
    """The viewer cannot be started; the message is one line."""


def _to_stderr(line: str) -> None:
    sys.stderr.write(line + "\n")


def viewer_binary() -> Path:
    """Return the viewer's own binary.

    Raises
    ------
    ViewerError
        If the viewer package, or the binary in it, is not installed.
    """
    found = find_spec("rerun_cli")
    if found is None or found.origin is None:
        raise ViewerError(f"viewer: {extra_needed('view')}")
    binary = Path(found.origin).parent / "rerun"
    if not binary.is_file():
        raise ViewerError(f"viewer: no binary at {binary}")
    return binary


def free_port() -> int:
    """Return a port nobody listens on at this moment."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        port: int = probe.getsockname()[1]
        return port


def _claimed_port(port: int | None, address: str, purpose: str) -> int:
    """Return the port to use; say which one is busy, before anything is started."""
    if port is None or port == 0:
        return free_port()
    if not 1 <= port <= 65535:
        raise ViewerError(f"viewer: {purpose} port {port}: expected 1 to 65535")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((address, port))
        except OSError as reason:
            why = "is busy" if reason.errno == 98 else f"cannot be used ({reason.strerror})"
            raise ViewerError(f"viewer: {purpose} port {port} on {address} {why}; name another one") from reason
    return port


class ViewerProcess:
    """The running server; a context manager.

    Start it from a thread that lives as long as the viewer shall: where the system offers it, the server is tied to
    that thread and ends with it, even when this process is killed.

    Parameters
    ----------
    port : int or None
        Port of the web page; a free one when None or 0.
    grpc_port : int or None
        Port that takes the samples; a free one when None or 0.
    open_to_other_hosts : bool
        Bind every interface instead of this machine alone; what is opened is announced.
    memory_limit : str
        What the server keeps for pages opened late; the oldest goes first.
    ready_limit_s : float
        How long the server may take until it answers.
    announce : callable
        Takes the line that says what was opened (default: standard error).

    Raises
    ------
    ViewerError
        Port busy, binary missing, server ended early or not ready in time; one line.
    """

    def __init__(
        self,
        port: int | None = None,
        *,
        grpc_port: int | None = None,
        open_to_other_hosts: bool = False,
        memory_limit: str = "512MiB",
        ready_limit_s: float = 15.0,
        announce: Callable[[str], None] = _to_stderr,
    ) -> None:
        address = EVERYWHERE if open_to_other_hosts else LOOPBACK
        binary = viewer_binary()
        self.web_port = _claimed_port(port, address, "web")
        self.grpc_port = _claimed_port(grpc_port, address, "data")
        if self.web_port == self.grpc_port:
            raise ViewerError(f"viewer: web and data port are both {self.web_port}; name two")
        self._room = Path(tempfile.mkdtemp(prefix="mech_twin_view_"))
        try:
            self._process = self._started(binary, address, memory_limit)
            self._wait_until_ready(ready_limit_s)
        except BaseException:
            self.close()
            raise
        if open_to_other_hosts:
            announce(
                f"viewer: OPEN TO OTHER HOSTS, without password: web page on port {self.web_port}, "
                f"data on port {self.grpc_port}, all interfaces of {socket.gethostname()}"
            )

    _process: subprocess.Popen[bytes] | None = None

    @property
    def grpc_url(self) -> str:
        """Address that a Stage connects to."""
        return f"rerun+http://{LOOPBACK}:{self.grpc_port}/proxy"

    @property
    def web_url(self) -> str:
        """Address to open in a browser."""
        return f"http://{LOOPBACK}:{self.web_port}/?url={quote(self.grpc_url, safe='')}&hide_welcome_screen"

    @property
    def pid(self) -> int | None:
        """Process number of the server, None when it is not running."""
        return self._process.pid if self._process is not None and self._process.poll() is None else None

    def close(self) -> None:
        """End the server within a second and remove what it left; harmless when called again."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        shutil.rmtree(self._room, ignore_errors=True)

    def __enter__(self) -> ViewerProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _started(self, binary: Path, address: str, memory_limit: str) -> subprocess.Popen[bytes]:
        command = [str(binary), "--serve-web", "--bind", address, "--port", str(self.grpc_port)]
        command += ["--web-viewer-port", str(self.web_port), "--server-memory-limit", memory_limit]
        tie = shutil.which("setpriv")
        if tie is not None:  # same process number: setpriv replaces itself by the binary
            command = [tie, "--pdeathsig", "TERM", "--", *command]
        with (self._room / "log").open("wb") as log:
            # a session of its own: Ctrl-C in the terminal reaches the run, which then ends the server in order
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=self._environment(),
                start_new_session=True,
            )

    def _environment(self) -> dict[str, str]:
        """Return the environment of the server: a configuration of its own with analytics off, plain log text."""
        settings = self._room / "rerun"
        settings.mkdir()
        content = {
            "analytics_enabled": False,
            "analytics_id": "",
            "metadata": {},
            "config_file_path": str(settings / "analytics.json"),
            "data_dir_path": str(settings / "analytics"),
        }
        (settings / "analytics.json").write_text(json.dumps(content))
        room = str(self._room)
        return os.environ | {
            "XDG_CONFIG_HOME": room,
            "XDG_DATA_HOME": room,
            "NO_COLOR": "1",
            "TELEMETRY_ENABLED": "false",
        }

    def _wait_until_ready(self, limit_s: float) -> None:
        process = self._process
        end = time.monotonic() + limit_s
        while process is not None and time.monotonic() < end:
            if process.poll() is not None:
                raise ViewerError(f"viewer: ended at once with code {process.returncode}: {self._last_words()}")
            if self._answers():
                return
            time.sleep(0.02)
        raise ViewerError(f"viewer: not ready after {limit_s:g} s on ports {self.web_port} and {self.grpc_port}")

    def _answers(self) -> bool:
        page = http.client.HTTPConnection(LOOPBACK, self.web_port, timeout=1.0)
        try:
            page.request("GET", "/")
            ready = page.getresponse().status == http.HTTPStatus.OK
            with socket.create_connection((LOOPBACK, self.grpc_port), timeout=1.0):
                return ready
        except (OSError, http.client.HTTPException):
            return False
        finally:
            page.close()

    def _last_words(self) -> str:
        lines = (self._room / "log").read_text(errors="replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        return said[-1] if said else "it said nothing"

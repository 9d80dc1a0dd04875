# SPDX-License-Identifier: Apache-2.0
"""What a run opens to the network: nothing by default, and with one explicit option what it says."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from mech_twin.nodes.run.domain import DISCOVERY, settle_domain

pytestmark = pytest.mark.usefixtures("ros_domain")
LOOPBACK = "127.0.0.1"
PROFILE = Path(__file__).resolve().parents[2] / "config" / "fastdds_loopback.xml"
DDS_PORT = 7400
ARGUMENTS = ("run", "vibration_crank", "--no-record", "--view", "web")


NETWORK_OF_ITS_OWN = ("unshare", "--net") if os.geteuid() == 0 else ("unshare", "--map-root-user", "--net")
LOOPBACK_UP = """
import fcntl, socket, struct
with socket.socket() as handle:
    fcntl.ioctl(handle, 0x8914, struct.pack("16sH14s", b"lo", 0x49, b""))  # SIOCSIFFLAGS: up, loopback, running
"""


@contextmanager
def running(
    folder: Path, *options: str, prefix: tuple[str, ...] = (), first: str = "", **environment: str
) -> Iterator[tuple[list[psutil.Process], str]]:
    """Give the processes of a run that has begun to step, and what it wrote so far."""
    code = first + "from mech_twin.cli.main import main; main()"
    log = folder / "log"
    with log.open("wb") as out:
        command = [*prefix, sys.executable, "-c", code, *ARGUMENTS, *options]
        process = subprocess.Popen(command, stdout=out, stderr=out, env={**os.environ, **environment})
    try:
        end = time.monotonic() + 60.0
        while "starting" not in log.read_text() and time.monotonic() < end and process.poll() is None:
            time.sleep(0.1)
        while not dds_sockets([psutil.Process(process.pid)]) and time.monotonic() < end:
            time.sleep(0.1)
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
        yield family, log.read_text()
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


LISTEN = "0A"


def sockets_of(process: psutil.Process, kind: str) -> list[tuple[str, int, str]]:
    """Return address, port and state of a process's IPv4 sockets, read in the network it lives in."""
    folder = Path(f"/proc/{process.pid}")
    own = set()
    for link in (folder / "fd").iterdir():
        with suppress(FileNotFoundError):  # closed meanwhile
            own.add(str(link.readlink()))
    found = []
    for line in (folder / "net" / kind).read_text().splitlines()[1:]:
        fields = line.split()
        if f"socket:[{fields[9]}]" in own:
            address, port = fields[1].split(":")
            found.append((socket.inet_ntoa(bytes.fromhex(address)[::-1]), int(port, 16), fields[3]))
    return found


def listening(family: list[psutil.Process]) -> list[tuple[str, int]]:
    """Return address and port of every TCP socket that takes connections; there are none of IPv6."""
    assert not [s for process in family for s in process.net_connections("tcp6") if s.status == psutil.CONN_LISTEN]
    found = [s for process in family for s in sockets_of(process, "tcp")]
    return [(address, port) for address, port, state in found if state == LISTEN]


def dds_sockets(family: list[psutil.Process]) -> list[tuple[str, int]]:
    """Return address and port of the UDP sockets on which DDS receives in this test's domain."""
    first = multicast_port()
    found = [s for process in family for s in sockets_of(process, "udp")]
    return [(address, port) for address, port, _ in found if first <= port < first + 250]


def multicast_port() -> int:
    """Return the port on which DDS would hear announcements of other hosts."""
    return DDS_PORT + 250 * int(os.environ["ROS_DOMAIN_ID"])


@pytest.mark.slow
def test_a_run_listens_on_loopback_only(tmp_path: Path) -> None:
    with running(tmp_path) as (family, told):
        sockets = listening(family)
        assert sockets
        assert {address for address, _ in sockets} == {LOOPBACK}
        assert multicast_port() not in {port for _, port in dds_sockets(family)}
        assert "OPEN" not in told


@pytest.mark.slow
def test_with_the_loopback_profile_dds_too_receives_on_loopback_only(tmp_path: Path) -> None:
    with running(tmp_path, FASTRTPS_DEFAULT_PROFILES_FILE=str(PROFILE)) as (family, _):
        assert {address for address, _ in dds_sockets(family)} == {LOOPBACK}


@pytest.mark.slow
def test_opening_up_is_one_option_that_says_what_it_opens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(DISCOVERY)
    apart = {"prefix": NETWORK_OF_ITS_OWN, "first": LOOPBACK_UP}  # what is opened here, nobody outside can see
    with running(tmp_path, "--open-to-other-hosts", **apart) as (family, told):
        sockets = listening(family)
        assert {address for address, _ in sockets} == {"0.0.0.0"}
        assert multicast_port() in {port for _, port in dds_sockets(family)}
        assert re.search(r"topics: OPEN TO OTHER HOSTS.*domain \d+", told)
        ports = {str(port) for _, port in sockets}
        assert ports <= set(re.findall(r"\d+", next(line for line in told.splitlines() if "view: OPEN" in line)))


def test_a_range_the_user_has_set_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DISCOVERY, "OFF")
    assert settle_domain(open_to_other_hosts=True) == "OFF"
    monkeypatch.delenv(DISCOVERY)
    assert settle_domain() == "LOCALHOST"

# SPDX-License-Identifier: Apache-2.0
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from synthetic_four_bar import drawing, frame

from mech_twin.view.rerun_scene import RerunScene
from mech_twin.view.viewer_process import ViewerError, ViewerProcess, free_port

PARENT = """
import sys, time
from mech_twin.view.viewer_process import ViewerProcess
viewer = ViewerProcess()
print(viewer.pid, flush=True)
time.sleep(60)
"""


@pytest.fixture
def viewer():
    with ViewerProcess() as process:
        yield process


def listening_addresses(port):
    """Return the local addresses of listening sockets on a port, as the kernel tells them."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            address, number = local.split(":")
            if int(number, 16) == port and state == "0A":
                found.add(address)
    return found


def test_the_server_listens_on_this_machine_alone(viewer):
    loopback = {"0100007F"}
    assert listening_addresses(viewer.web_port) == loopback
    assert listening_addresses(viewer.grpc_port) == loopback
    assert viewer.web_url.startswith(f"http://127.0.0.1:{viewer.web_port}/")


def test_opening_to_other_hosts_is_one_option_and_says_what_it_opens():
    said = []
    with ViewerProcess(open_to_other_hosts=True, announce=said.append) as viewer:
        assert listening_addresses(viewer.web_port) == {"00000000"}
        assert len(said) == 1
        assert str(viewer.web_port) in said[0]
        assert str(viewer.grpc_port) in said[0]


def test_nothing_is_said_when_nothing_is_opened():
    said = []
    with ViewerProcess(announce=said.append):
        assert said == []


@pytest.mark.parametrize("which", ["web", "data"])
def test_a_busy_port_is_named_in_one_line(which):
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        port = holder.getsockname()[1]
        with pytest.raises(ViewerError, match=f"^viewer: {which} port {port} on 127.0.0.1 is busy") as refusal:
            ViewerProcess(**({"port": port} if which == "web" else {"grpc_port": port}))
    assert "\n" not in str(refusal.value)


def test_a_port_out_of_range_is_refused():
    with pytest.raises(ViewerError, match="web port 70000: expected 1 to 65535"):
        ViewerProcess(70000)


def test_the_same_port_for_both_is_refused():
    port = free_port()
    with pytest.raises(ViewerError, match=f"both {port}"):
        ViewerProcess(port, grpc_port=port)


def test_the_server_ends_within_a_second_and_frees_its_ports(viewer):
    pid, port = viewer.pid, viewer.web_port
    begin = time.monotonic()
    viewer.close()
    assert time.monotonic() - begin < 1.0
    assert viewer.pid is None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    with ViewerProcess(port) as again:
        assert again.web_port == port


def test_closing_twice_is_harmless(viewer):
    viewer.close()
    viewer.close()


def test_no_process_stays_behind_when_the_run_is_killed():
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    end = time.monotonic() + 5.0
    while time.monotonic() < end and _runs(pid):
        time.sleep(0.02)
    assert not _runs(pid)


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_server_that_has_gone_does_not_end_the_run(viewer):
    scene = RerunScene("four_bar", grpc_url=viewer.grpc_url)
    for step in range(2000):
        now = frame(step)
        scene.frame(now.motor, now.linkage, now.forces, now.body)
        if step == 500:
            viewer.close()
        if scene.drawing_due(now.linkage.time_s):
            scene.drawing(drawing(step))
    begin = time.monotonic()
    assert not scene.close()
    assert time.monotonic() - begin < 1.0
    assert not scene.close()


def test_a_server_that_listens_takes_everything(viewer):
    scene = RerunScene("four_bar", grpc_url=viewer.grpc_url, flush_limit_s=10.0)
    for step in range(200):
        scene.frame(linkage=frame(step).linkage)
    assert scene.close()

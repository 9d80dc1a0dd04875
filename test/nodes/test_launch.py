# SPDX-License-Identifier: Apache-2.0
"""What the launch files start and end: their plan always, the launch itself where the launch library is installed."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.nodes.run import executables
from mech_twin.nodes.run.domain import DISCOVERY
from mech_twin.nodes.run.executables import LaunchRequest
from mech_twin.recording.bag_reader import BagReader

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 90.0
NODES = ("motor_node", "linkage_node", "force_node", "body_node", "frames_node", "recorder_node", "viewer_node")


@pytest.mark.parametrize("machine", CATALOGUE)
def test_a_launch_starts_every_role_of_the_machine_and_the_linkage_last(machine: str) -> None:
    planned = [program.name for program in executables.programs(LaunchRequest(machine, frames="false"))]
    bodies = ["body"] if CATALOGUE[machine].has_body else []
    assert planned == ["motor", "force_analysis", *bodies, "linkage"]


def test_a_recorder_and_a_viewer_are_started_first_and_waited_for() -> None:
    request = LaunchRequest("winding_drum", record="DIR", view="run.rrd")
    first, second, third, *_ = executables.programs(request)
    assert first == ("recorder_node", "recorder", ("--directory", "DIR"))
    assert second == ("viewer_node", "viewer", ("--place", "run.rrd"))
    assert third == ("frames_node", "frames", ())
    asked = executables.parameters(request)
    assert asked["run.recorder"] is True
    assert asked["run.viewer"] is True


def test_a_namespace_of_its_own_has_a_clock_of_its_own() -> None:
    assert executables.namespace(LaunchRequest("winding_drum")) == "/winding_drum"
    assert executables.remappings(LaunchRequest("winding_drum")) == []
    told = LaunchRequest("winding_drum", "hall/left")
    assert executables.namespace(told) == "/hall/left"
    assert executables.remappings(told) == [("/clock", "/hall/left/clock")]


def test_a_parameter_file_is_passed_alone(tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text("/**: {ros__parameters: {}}\n", encoding="utf-8")
    assert executables.parameter_files(LaunchRequest("winding_drum", params_file=str(own))) == [str(own)]
    assert executables.parameter_files(LaunchRequest("winding_drum")) == []
    with pytest.raises(ConfigurationError, match=r"params_file gone\.yaml: no such file"):
        executables.parameter_files(LaunchRequest("winding_drum", params_file="gone.yaml"))


@pytest.mark.parametrize("duration", ["ten", "-1", "nan", "inf", ""])
def test_a_duration_that_is_no_length_of_time_is_refused(duration: str) -> None:
    with pytest.raises(ConfigurationError, match="expected seconds, 0 or more"):
        executables.parameters(LaunchRequest("winding_drum", duration=duration))


def test_several_machines_have_namespaces_recordings_and_view_files_apart() -> None:
    text = "mb10_breaker, left=winding_drum,hall/right=winding_drum"
    requests = executables.launch_requests(text, "bags", "run.rrd")
    assert [executables.namespace(request) for request in requests] == ["/mb10_breaker", "/left", "/hall/right"]
    assert [request.record for request in requests] == ["bags/mb10_breaker", "bags/left", "bags/hall-right"]
    assert [request.view for request in requests] == [
        f"run-{name}.rrd" for name in ("mb10_breaker", "left", "hall-right")
    ]
    assert len({rule for request in requests for rule in executables.remappings(request)}) == len(requests)


def test_a_page_is_launched_by_its_path_under_its_name() -> None:
    page = str(ROOT / "config" / "pages" / "spring_hammer.yaml")
    alone = LaunchRequest(page)
    assert executables.namespace(alone) == "/spring_hammer"
    assert [program.name for program in executables.programs(alone)] == ["frames", "motor", "force_analysis", "linkage"]
    assert executables.parameters(alone)["machine"] == page
    requests = executables.launch_requests(f"{page},left={page}", "bags")
    assert [(request.machine, request.namespace) for request in requests] == [(page, "spring_hammer"), (page, "left")]


@pytest.mark.parametrize(
    ("machines", "line"),
    [
        ("winding_drum,winding_drum", "namespace winding_drum stands twice; write NAMESPACE=winding_drum"),
        ("drum=windin_drum", "did you mean 'winding_drum'"),
        ("a b=winding_drum", "expected letters, digits and _"),
        (" , ", "expected"),
    ],
)
def test_machines_that_cannot_be_told_apart_are_refused(machines: str, line: str) -> None:
    with pytest.raises(ConfigurationError, match=line):
        executables.launch_requests(machines)


def test_the_users_discovery_range_is_never_overridden() -> None:
    assert executables.discovery("", {}) == ("LOCALHOST", "")
    assert executables.discovery("SUBNET", {}) == ("SUBNET", "")
    assert executables.discovery("", {DISCOVERY: "SUBNET"}) == ("SUBNET", "")
    value, line = executables.discovery("OFF", {DISCOVERY: "SUBNET"})
    assert value == "SUBNET"
    assert line == f"discovery: {DISCOVERY}=SUBNET is set and is not overridden by OFF"


def test_a_run_ends_with_its_last_step_with_a_refusal_and_with_an_error_that_nobody_mends() -> None:
    assert executables.ends_run("linkage", 0, respawn=True)
    assert not executables.ends_run("motor", 0, respawn=False)  # ended by hand, to be replaced
    assert executables.ends_run("recorder", executables.REFUSED, respawn=True)
    assert executables.ends_run("motor", -signal.SIGKILL, respawn=False)
    assert not executables.ends_run("motor", -signal.SIGKILL, respawn=True)
    assert not executables.ends_run("linkage", -signal.SIGSEGV, respawn=True)


# -- the launch itself ------------------------------------------------------------------------------------------------

with_library = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("launch_ros") is None, reason="no launch library; a native installation has it"),
]
LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
path, *words = sys.argv[1:]
service = LaunchService(argv=words)
asked = [tuple(word.split(":=", 1)) for word in words]
service.include_launch_description(
    LaunchDescription([IncludeLaunchDescription(AnyLaunchDescriptionSource(path), launch_arguments=asked)])
)
sys.exit(service.run())
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ros_domain: int) -> Iterator[Path]:
    """Give a prefix in which ament finds the package and its programs, as colcon installs them."""
    prefix = tmp_path / "prefix"
    marker = prefix / "share" / "ament_index" / "resource_index" / "packages" / "mech_twin"
    marker.parent.mkdir(parents=True)
    marker.touch()
    programs = prefix / "lib" / "mech_twin"
    programs.mkdir(parents=True)
    for name in NODES:
        text = f"#!{sys.executable}\nfrom mech_twin.nodes.run.executables import {name}\n{name}()\n"
        (programs / name).write_text(text, encoding="utf-8")
        (programs / name).chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([str(prefix), sys.prefix]))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    yield tmp_path


class Launched:
    """A launch in a process group of its own, and everybody below it."""

    def __init__(self, folder: Path, file: str, *words: str, **environment: str) -> None:
        self._log = folder / "launch.log"
        with self._log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-c", LAUNCH, str(ROOT / "launch" / file), *words],
                stdout=log, stderr=log, start_new_session=True, env={**os.environ, **environment},
            )  # fmt: skip
        self.seen: dict[int, str] = {}

    @property
    def log(self) -> str:
        """What the launch has said so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def nodes(self) -> dict[int, str]:
        """Return the living processes of the session by their programs."""
        found = {}
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if int(fields[3]) == self.process.pid and int(entry.name) != self.process.pid and fields[0] != "Z":
                name = next((w.rpartition(b"/")[2].decode() for w in words if w.endswith(b"_node")), "")
                found[int(entry.name)] = name
        self.seen |= found
        return found

    def until(self, holds: Callable[[], bool]) -> None:
        """Wait until something holds."""
        end = time.monotonic() + LIMIT_S
        while not holds():
            assert time.monotonic() < end, self.log
            time.sleep(0.05)

    def __enter__(self) -> Launched:
        return self

    def __exit__(self, *_: object) -> None:
        for pid in (self.process.pid, *self.nodes()):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.process.wait()


def messages(bag: Path) -> int:
    with BagReader(bag) as reader:
        assert reader.info.finished
        return reader.info.message_count


class TestLaunch:
    """With the library."""

    pytestmark = with_library

    def test_a_launch_ends_with_the_last_step_and_its_recording_is_whole(self, installed: Path) -> None:
        bag = installed / "bag"
        words = ("machine:=winding_drum", "pace:=max", "duration:=1", f"record:={bag}", "namespace:=hall/one")
        with Launched(installed, "twin.launch.py", *words) as launch:
            assert launch.process.wait(LIMIT_S) == 0, launch.log
            assert not launch.nodes()
        assert messages(bag) > 3 * 1001

    def test_a_page_is_launched_by_its_path(self, installed: Path) -> None:
        bag, page = installed / "bag", ROOT / "config" / "pages" / "slider_crank.yaml"
        with Launched(
            installed, "twin.launch.py", f"machine:={page}", "pace:=max", "duration:=1", f"record:={bag}"
        ) as launch:
            assert launch.process.wait(LIMIT_S) == 0, launch.log
        assert messages(bag) > 3 * 1001

    def test_several_machines_end_each_by_itself(self, installed: Path) -> None:
        words = (
            "machines:=left=winding_drum,right=winding_drum",
            "pace:=max",
            "duration:=1",
            f"record:={installed}/bags",
        )
        with Launched(installed, "machines.launch.py", *words) as launch:
            assert launch.process.wait(LIMIT_S) == 0, launch.log
            assert not launch.nodes()
        assert all(messages(installed / "bags" / name) > 3 * 1001 for name in ("left", "right"))

    def test_a_node_that_died_is_started_again_and_rejoins(self, installed: Path) -> None:
        bag = installed / "bag"
        words = ("machine:=winding_drum", "duration:=4", "respawn:=true", f"record:={bag}")
        with Launched(installed, "twin.launch.py", *words) as launch:
            file = bag / "bag_0.mcap"
            launch.until(lambda: file.exists() and file.stat().st_size > 100_000)
            first = {name: pid for pid, name in launch.nodes().items()}
            os.kill(first["motor_node"], signal.SIGKILL)
            launch.until(lambda: any(n == "motor_node" and p != first[n] for p, n in launch.nodes().items()))
            assert launch.process.wait(LIMIT_S) == 0, launch.log
            assert not launch.nodes()
        assert messages(bag) > 3 * 4001

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda number: number.name)
    def test_a_signal_to_the_launch_ends_everybody_during_the_first_compile(
        self, number: signal.Signals, installed: Path
    ) -> None:
        with Launched(
            installed, "twin.launch.py", "machine:=mb10_breaker", MECH_TWIN_CACHE_DIR=str(installed / "kernels")
        ) as launch:
            launch.until(lambda: set(launch.nodes().values()) >= set(NODES[:4]))
            launch.until(lambda: any((installed / "kernels").glob("*/*")))  # compiling
            launch.process.send_signal(number)
            asked = time.monotonic()
            launch.process.wait(LIMIT_S)
            launch.until(lambda: not launch.nodes())
            took_s = time.monotonic() - asked
        assert took_s < 4.5, launch.log  # the library itself waits 5 s before it becomes insistent
        assert "escalating" not in launch.log
        assert not re.search(r"_node-\d+\] Traceback", launch.log)

    def test_a_refusal_ends_the_launch_and_says_why(self, installed: Path) -> None:
        own = installed / "own.yaml"
        own.write_text("/**: {ros__parameters: {package: {wound_m: 1.0}}}\n", encoding="utf-8")
        with Launched(installed, "twin.launch.py", "machine:=winding_drum", f"params_file:={own}") as launch:
            launch.process.wait(LIMIT_S)
            assert not launch.nodes()
        assert "unknown key 'package.wound_m'" in launch.log
        assert "Traceback" not in launch.log

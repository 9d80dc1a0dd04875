# SPDX-License-Identifier: Apache-2.0
"""A second run under a living name is refused; in a namespace of its own it runs beside the first."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.messages.topics import EVERY, LATCHED, STEP_LINKAGE
from mech_twin.nodes.exchange.peers import HostClaims
from mech_twin.nodes.run.domain import NameInUseError, replay_arguments, ros_arguments, run_namespace
from mech_twin.nodes.run.name_guard import CLAIMS, NameGuard
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.message_decoder import MessageDecoder

COMMAND = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
NODE = "from mech_twin.nodes.run.executables import {0}; {0}()"
DRUM = ["run", "winding_drum", "--view", "none"]
LIMIT_S = 60.0


def started(*words: str) -> subprocess.Popen[str]:
    nowhere = subprocess.DEVNULL
    return subprocess.Popen([*COMMAND, *words], stdout=nowhere, stderr=nowhere, text=True, env=os.environ.copy())


def finished(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, env=os.environ.copy(), check=False)


def recorded(bag: Path) -> bool:
    file = bag / f"{bag.name}_0.mcap"
    return file.exists() and file.stat().st_size > 20_000


def hear_a_step() -> None:
    """Wait until somebody publishes a step of the drum."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        listener, heard = rclpy.create_node("listener", namespace="/hall"), []
        listener.create_subscription(JointState, f"/winding_drum/{STEP_LINKAGE.name}", heard.append, EVERY, raw=True)
        end = time.monotonic() + LIMIT_S
        while not heard and time.monotonic() < end:
            rclpy.spin_once(listener, timeout_sec=0.1)
        listener.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert heard, "no step"


@pytest.fixture
def living_run(ros_domain: int, tmp_path: Path):
    """A run of the drum in real time that is under way."""
    run = started(*DRUM, "--record", str(tmp_path / "first"))
    end = time.monotonic() + LIMIT_S
    while not recorded(tmp_path / "first") and time.monotonic() < end and run.poll() is None:
        time.sleep(0.05)
    assert recorded(tmp_path / "first")
    yield tmp_path / "first"
    assert run.poll() is None, "the first run ended"
    run.terminate()
    assert run.wait(10.0) == 0
    with BagReader(tmp_path / "first") as reader:
        assert all(counters["missed"] == 0 for counters in reader.info.counters.values())


def assert_refused(run: subprocess.CompletedProcess[str]) -> None:
    assert run.returncode == 2, run.stderr
    told = [line for line in run.stderr.splitlines() if "ROS_DOMAIN_ID" in line]
    assert len(told) == 1
    assert "--namespace" in told[0]
    assert "winding_drum" in told[0]
    assert "Traceback" not in run.stderr


@pytest.mark.slow
def test_a_second_run_and_a_lone_node_are_refused_and_the_first_goes_on(living_run: Path, tmp_path: Path) -> None:
    second = tmp_path / "second"
    assert_refused(finished(*COMMAND, *DRUM, "--record", str(second), "--duration", "1"))
    assert not second.exists()
    assert_refused(finished(*COMMAND, *DRUM, "--no-record", "--duration", "1", "--processes"))
    for name in ("motor_node", "linkage_node"):
        ros = ["--ros-args", "-p", "machine:=winding_drum"]
        assert_refused(finished(sys.executable, "-c", NODE.format(name), *ros))


@pytest.mark.slow
def test_in_a_namespace_of_its_own_the_same_machine_runs_beside_the_first(living_run: Path, tmp_path: Path) -> None:
    second = tmp_path / "second"
    run = finished(*COMMAND, *DRUM, "--record", str(second), "--duration", "1", "--namespace", "hall/drum_2")
    assert run.returncode == 0, run.stderr
    with BagReader(second) as reader:
        names = set(reader.topics)
        steps = list(reader.messages(["/hall/drum_2/step/linkage"]))
        clock = list(reader.messages(["/hall/drum_2/clock"]))
        assert all(counters["missed"] == 0 for counters in reader.info.counters.values())
    assert len(steps) == 1001
    assert clock
    assert names - {"/diagnostics"} == {name for name in names if name.startswith("/hall/drum_2/")}


@pytest.mark.slow
def test_another_machine_beside_the_first_leaves_it_the_clock_and_has_its_own(living_run: Path, tmp_path: Path) -> None:
    words = ["run", "vibration_crank", "--view", "none", "--duration", "0.3"]
    beside = finished(*COMMAND, *words, "--record", str(tmp_path / "second"))
    assert beside.returncode == 0, beside.stderr
    (told,) = [
        line for line in beside.stderr.splitlines() if "the time of this run is on /vibration_crank/clock" in line
    ]
    # which of the two it says depends on whether the first run's publisher is discovered by then
    assert "/clock is published by /winding_drum/linkage;" in told or "/clock is claimed by an earlier start" in told
    with BagReader(tmp_path / "second") as reader:
        decoder = MessageDecoder(reader.topics)
        stamps = [decoder.decode(message).clock for message in reader.messages(["/clock"])]
    times = [stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps]
    assert times == sorted(times)
    assert 0.25 < times[-1] < 0.31
    apart = finished(*COMMAND, *words, "--no-record", "--namespace", "crank_1")
    assert apart.returncode == 0, apart.stderr
    assert "is published by" not in apart.stderr


@pytest.mark.slow
def test_a_clock_claimed_on_this_host_is_left_to_its_holder_before_its_publisher_is_discovered(ros_domain: int) -> None:
    code = (
        "import rclpy, time; from mech_twin.nodes.exchange.peers import HostClaims; rclpy.init(args=[]); "
        "claims = HostClaims(['/clock']); print('up', flush=True); time.sleep(60)"
    )
    run = [*COMMAND, "run", "vibration_crank", "--view", "none", "--no-record", "--duration", "0.1"]
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "up\n"
        beside = finished(*run)
        holder.kill()
    assert f"/clock is claimed by an earlier start, process {holder.pid};" in beside.stderr
    assert "the time of this run is on /vibration_crank/clock" in beside.stderr
    assert "the time of this run is on" not in finished(*run).stderr


@pytest.mark.slow
def test_a_replay_beside_a_run_is_refused_unless_in_a_namespace_of_its_own(living_run: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    made = finished(*COMMAND, "simulate", "winding_drum", "--duration", "0.2", "--bag", str(bag))
    assert made.returncode == 0, made.stderr
    assert_refused(finished(*COMMAND, "replay", str(bag)))
    beside = finished(*COMMAND, "replay", str(bag), "--namespace", "again", "--rate", "10")
    assert beside.returncode == 0, beside.stderr


@pytest.mark.slow
def test_a_run_beside_a_paused_replay_is_refused(ros_domain: int, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    assert finished(*COMMAND, "simulate", "winding_drum", "--duration", "0.2", "--bag", str(bag)).returncode == 0
    replay = started("replay", str(bag), "--rate", "0.001")  # 200 s for 0.2 s: a step each second
    try:
        hear_a_step()
        assert_refused(finished(*COMMAND, *DRUM, "--no-record", "--duration", "1"))
    finally:
        replay.terminate()
        replay.wait(10.0)


@pytest.mark.slow
@pytest.mark.parametrize("others", [("run",), ("replay", "processes")], ids="-".join)
def test_of_several_that_start_at_one_instant_one_goes_on_and_the_others_are_refused(
    others: tuple[str, ...], ros_domain: int, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    assert finished(*COMMAND, "simulate", "winding_drum", "--duration", "4", "--bag", str(bag)).returncode == 0
    run = [*DRUM, "--no-record", "--duration", "4"]
    verbs = {"run": run, "processes": [*run, "--processes"], "replay": ["replay", str(bag)]}
    at_once = [
        subprocess.Popen([*COMMAND, *verbs[verb]], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        for verb in ("run", *others)
    ]
    told = [process.communicate(timeout=4.0 * LIMIT_S)[1] for process in at_once]
    codes = [process.returncode for process in at_once]
    assert sorted(codes) == [0, *(2 for _ in others)], told
    for code, lines in zip(codes, told, strict=True):
        assert ("--namespace" in lines) == (code == 2)
        assert "Traceback" not in lines


@pytest.mark.slow
def test_of_several_names_claimed_at_one_instant_the_first_is_kept_as_long_as_its_owner_lives(ros: None) -> None:
    names = ["/drum/step/motor", "/drum/step/linkage"]
    with NameGuard(names) as first, NameGuard(["/crank/step/motor"]) as elsewhere:
        with NameGuard(names[1:]) as second, pytest.raises(NameInUseError, match="/drum/step/linkage"):
            second.check()
        first.check()
        elsewhere.check()
        with NameGuard(names) as third, pytest.raises(NameInUseError):  # nothing has been published yet
            third.check()
    with NameGuard(names) as after:
        after.check()


@pytest.mark.slow
def test_on_one_host_a_name_is_known_to_be_taken_at_once_and_is_free_when_its_owner_is_killed(ros: None) -> None:
    code = (
        "import rclpy, time; from mech_twin.nodes.run.name_guard import NameGuard; rclpy.init(args=[]); "
        "guard = NameGuard(['/drum/step/motor', '/drum/step/body']); print('up', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == "up\n"
        begun = time.monotonic()
        with NameGuard(["/drum/step/body"]) as guard, pytest.raises(NameInUseError) as refused:
            guard.check()
        assert time.monotonic() - begun < 0.5
        assert f"/drum/step/body is claimed by an earlier start, process {owner.pid}" in str(refused.value)
        owner.kill()
        owner.wait()
        after = HostClaims(["/drum/step/body"])
        assert after.holder == ""
        after.close()


@pytest.mark.slow
def test_a_claim_that_anybody_may_forge_is_told_as_a_claim_with_who_makes_it(ros: None) -> None:
    stranger = rclpy.create_node("stranger", namespace="/hall")
    claims = stranger.create_publisher(String, CLAIMS, LATCHED)
    claims.publish(String(data=f"{0:020d}-0 /drum/step/motor"))
    with NameGuard(["/drum/step/motor"]) as guard, pytest.raises(NameInUseError) as refused:
        guard.check()
    assert "/drum/step/motor is claimed by an earlier start, of node /hall/stranger" in str(refused.value)
    stranger.destroy_node()


@pytest.mark.slow
@pytest.mark.parametrize("after_s", [1.0, 1.5, 2.0, 2.5])
def test_separate_processes_that_are_stopped_as_they_begin_leave_no_directory(
    after_s: float, ros_domain: int, tmp_path: Path
) -> None:
    words = [*DRUM, "--no-record", "--processes"]
    run = subprocess.Popen([*COMMAND, *words], stderr=subprocess.DEVNULL, env={**os.environ, "TMPDIR": str(tmp_path)})
    time.sleep(after_s)
    run.send_signal(signal.SIGINT)
    run.wait(LIMIT_S)
    assert not [left for left in tmp_path.glob("mech_twin-*") if (left / "parameters.yaml").exists()]


@pytest.mark.slow
def test_a_run_after_one_that_was_killed_starts(ros_domain: int, tmp_path: Path) -> None:
    """What a killed run leaves on the graph, for as long as its lease lasts, is not alive."""
    run = started(*DRUM, "--record", str(tmp_path / "first"))
    end = time.monotonic() + LIMIT_S
    while not recorded(tmp_path / "first") and time.monotonic() < end:
        time.sleep(0.05)
    run.kill()
    run.wait()
    after = finished(*COMMAND, *DRUM, "--no-record", "--duration", "0.2", "--pace", "max")
    assert after.returncode == 0, after.stderr


@pytest.mark.parametrize("bad", ["", "/", "2nd", "a b", "a//b", "a/", "__hidden", "a__b", "ü", "a;b"])
def test_what_is_no_name_of_ros_is_refused_in_words(bad: str) -> None:
    with pytest.raises(ConfigurationError, match="--namespace"):
        run_namespace("winding_drum", bad)


def test_the_clock_moves_with_the_namespace() -> None:
    assert ros_arguments("winding_drum", None) == []
    assert ros_arguments("winding_drum", "b")[-1] == "/clock:=/b/clock"
    moved = replay_arguments({"/drum/step/motor": "step/motor", "/clock": "clock", "/diagnostics": "diagnostics"}, "b")
    assert moved[4::2] == [
        "/drum/step/motor:=/b/step/motor",
        "/clock:=/b/clock",
    ]

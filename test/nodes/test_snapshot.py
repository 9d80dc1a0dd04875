# SPDX-License-Identifier: Apache-2.0
"""A recorder that keeps the last seconds writes them when it is told to, or at an alarm, and else nothing."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from mech_twin.messages.topics import DESCRIPTION, DIAGNOSTICS
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.exchange.direct_exchange import ReceivedBytes
from mech_twin.nodes.roles.recorder_node import RecorderNode
from mech_twin.recording.bag_contents import NS_PER_S, RecentMessage, RecentMessages
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_samples import BagSamples

DRUM = "winding_drum"
RUN = [sys.executable, "-m", "mech_twin"]


@given(st.lists(st.integers(0, 4_000_000_000), max_size=40))
def test_what_is_kept_is_of_the_last_seconds_and_in_the_order_it_came(times: list[int]) -> None:
    recent, came = RecentMessages(1.0), []
    for number, at_ns in enumerate(sorted(times)):
        came.append(RecentMessage("/t", str(number).encode(), at_ns))
        recent.take(came[-1])
    expected = [message for message in came if came[-1].at_ns - message.at_ns <= 1_000_000_000]
    assert list(recent.released()) == expected
    assert recent.released() == ()
    assert recent.received["/t"] == len(times)


@pytest.fixture
def recorder(tmp_path: Path, ros: None, request: pytest.FixtureRequest) -> Iterator[RecorderNode]:
    seconds = getattr(request, "param", 2.0)
    node = RecorderNode(DRUM, tmp_path / "bag", options=RunOptions(snapshot_s=seconds))
    yield node
    node.close()
    node.destroy_node()


def status(name: str, level: bytes) -> bytes:
    return serialize_message(DiagnosticArray(status=[DiagnosticStatus(name=name, level=level)]))


def heard(recorder: RecorderNode, *statuses: tuple[str, bytes]) -> None:
    for name, level in statuses:
        recorder._on_message(DIAGNOSTICS, DIAGNOSTICS.name, False, ReceivedBytes(status(name, level), None))


def kept(bag: Path) -> int:
    with BagReader(bag) as reader:
        return len(list(reader.messages([DIAGNOSTICS.name])))


OK, ERROR = DiagnosticStatus.OK, DiagnosticStatus.ERROR


def test_an_alarm_of_the_machine_writes_what_came_before_it_once(recorder: RecorderNode, tmp_path: Path) -> None:
    node, other = f"/{DRUM}/linkage", "/somebody/else"
    heard(recorder, (node, OK), (other, ERROR), (node, OK))
    assert recorder.diagnostic_values()["written"] == "0"
    heard(recorder, (node, ERROR))
    assert recorder.diagnostic_values()["written"] == "4"
    heard(recorder, (node, ERROR), (node, ERROR))
    assert recorder.diagnostic_values()["snapshots"] == "1"
    heard(recorder, (node, OK), (node, ERROR))
    assert recorder.diagnostic_values()["snapshots"] == "2"
    recorder.close()
    assert kept(tmp_path / "bag") == 8


def test_without_a_trigger_nothing_is_left(recorder: RecorderNode, tmp_path: Path) -> None:
    heard(recorder, *[(f"/{DRUM}/linkage", OK)] * 5)
    recorder.close()
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("heard_s", [0, 5_000])
def test_a_recording_of_snapshots_is_as_long_as_they_are(recorder: RecorderNode, tmp_path: Path, heard_s: int) -> None:
    """The description comes at the start of a run, or before a restart; replay waited from there, perhaps for days."""
    recorder._time.lead(heard_s * NS_PER_S)
    name = recorder.resolve_topic_name(DESCRIPTION.name)
    recorder._on_message(DESCRIPTION, name, True, ReceivedBytes(serialize_message(String(data="a")), None))
    recorder._time.lead(1_000 * NS_PER_S)
    heard(recorder, (f"/{DRUM}/linkage", OK), (f"/{DRUM}/linkage", ERROR))
    recorder.close()
    with BagReader(tmp_path / "bag") as reader:
        times = {message.topic: message.log_time_ns for message in reader.messages()}
    assert set(times) == {name, DIAGNOSTICS.name}
    assert set(times.values()) == {1_000 * NS_PER_S}


@pytest.mark.parametrize("recorder", [0.0], indirect=True)
def test_a_recorder_of_everything_refuses_a_snapshot(recorder: RecorderNode) -> None:
    heard(recorder, (f"/{DRUM}/linkage", OK))
    assert recorder.diagnostic_values()["written"] == "1"
    is_done, message = recorder.snapshot()
    assert not is_done
    assert "run.snapshot_s is 0" in message


def told_snapshot() -> str:
    """Return what the recorder says of a snapshot, once it has been hearing for as long as it keeps."""
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        words = [*RUN, "tell", DRUM, "snapshot", "--wait", "20"]
        told = subprocess.run(words, capture_output=True, text=True, check=False)
        if "of the last 0.5 s" in told.stdout:
            return told.stdout
    return told.stdout + told.stderr


@pytest.mark.slow
def test_a_run_that_is_told_to_keeps_its_last_seconds_and_they_compute_the_same(
    ros_domain: int, tmp_path: Path
) -> None:
    words = [*RUN, "run", DRUM, "--view", "none", "--record", "bag", "--snapshot", "0.5", "--duration", "120"]
    with subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as run:
        subprocess.run([*RUN, "tell", DRUM, "start", "--wait", "20"], capture_output=True, check=False)
        time.sleep(3.0)  # the first snapshot already leaves the start out
        assert "written to" in told_snapshot()
        run.send_signal(signal.SIGINT)
        run.wait(30)
    with BagReader(tmp_path / "bag") as reader:
        steps = [step.step for step in BagSamples(reader).steps()]
    assert steps[-1] - 520 < steps[-400] < steps[-1] < 100_000
    assert steps[0] > 0
    words = [*RUN, "replay", "bag", "--resimulate"]
    again = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stdout + again.stderr

# SPDX-License-Identifier: Apache-2.0
"""A recorder killed at any moment loses at most `max_loss_s` of any topic, slow ones too."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import pytest
from bag_cases import counts, written

from mech_twin.recording.bag_metadata import kept_until_replaced
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.recovery import recover

MAX_LOSS_S = 0.2
PERIODS_S = {"/fast": 0.001, "/slow": 0.05, "/slower": 0.13}
RECORDER = f"""
import sys, time
from pathlib import Path
from bag_cases import string_cdr
from mech_twin.recording.bag_writer import BagWriter
periods = {PERIODS_S}
writer = BagWriter(Path(sys.argv[1]), configuration="a: 1", max_loss_s={MAX_LOSS_S})
for topic in periods:
    writer.add_topic(topic, "std_msgs/msg/String")
due = dict.fromkeys(periods, time.monotonic())
number = dict.fromkeys(periods, 0)
print("recording", flush=True)
while True:
    now = time.monotonic()
    for topic, period in periods.items():
        if now >= due[topic]:
            writer.write(topic, string_cdr(str(number[topic])), time.monotonic_ns(), 0)
            number[topic] += 1
            due[topic] += period
    writer.tick(now)
    time.sleep(0.0005)
"""


def killed_recording(directory: Path, after_s: float) -> float:
    """Record until killed; return when that was, on the clock of the messages."""
    command = [sys.executable, "-c", RECORDER, str(directory)]
    here = Path(__file__).parents[1]  # of `bag_cases`
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=here) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "recording\n"
        time.sleep(after_s)
        killed_at = time.monotonic()
        process.kill()
        assert process.wait() == -signal.SIGKILL
    return killed_at


def check(tmp_path: Path, after_s: float) -> None:
    killed_at = killed_recording(tmp_path / "bag", after_s)
    recover(tmp_path / "bag", tmp_path / "out")
    saved: dict[str, list[tuple[int, float]]] = defaultdict(list)
    with BagReader(tmp_path / "out") as reader:
        for message in reader.messages():
            saved[message.topic].append((int(message.raw[8:-1]), message.log_time_ns * 1e-9))
        assert reader.info.configuration == "a: 1"
    for topic, period_s in PERIODS_S.items():
        assert [number for number, _ in saved[topic]] == list(range(len(saved[topic])))
        following = saved[topic][-1][1] + period_s
        assert killed_at - following <= MAX_LOSS_S


def test_killed_once(tmp_path: Path) -> None:
    check(tmp_path, 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_killed_at_random_moments(tmp_path: Path, seed: int) -> None:
    check(tmp_path, random.Random(seed).uniform(0.3, 1.2))


REPLACING = """
import os, sys
from pathlib import Path
from mech_twin.recording.bag_metadata import kept_until_replaced
with kept_until_replaced(Path(sys.argv[1])) as kept:
    print(*kept, sep="\\n", flush=True)
    os.kill(os.getpid(), 9)
"""


def test_what_a_killed_run_was_to_replace_is_named_then_and_at_the_next_run(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 20)
    killed = subprocess.run([sys.executable, "-c", REPLACING, str(bag)], stdout=subprocess.PIPE, text=True, check=False)
    assert killed.returncode == -signal.SIGKILL
    place, _, words = killed.stdout.strip().partition(": ")
    assert words == "the earlier recording, until this run has ended"
    written(tmp_path / "bag", 10)
    with kept_until_replaced(tmp_path / "bag") as kept:
        written(tmp_path / "bag", 5)
    assert kept[0] == f"{place}: an earlier recording, which a killed run was to replace"
    with BagReader(place) as earlier, BagReader(bag) as present:
        assert earlier.info.message_count == sum(counts(20).values())
        assert present.info.message_count == sum(counts(5).values())
    with kept_until_replaced(tmp_path / "other") as none:
        assert none == []

# SPDX-License-Identifier: Apache-2.0
"""Nodes that are killed, stopped and restarted as real processes: the run goes on where it held, to the bit."""

from __future__ import annotations

import random
import re
import signal
from itertools import cycle
from pathlib import Path

import pytest
from catalogue import built
from diagnostic_msgs.msg import DiagnosticArray
from process_run import ProcessRun
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.step_message import linkage as linkage_messages
from mech_twin.messages.topics import DEPTH, STEP_LINKAGE, full_name
from mech_twin.recording.bag_reader import BagReader

pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.slow]
KILLS = {"winding_drum": 3, "mb10_breaker": 4}  # each node once; a hundred kills are a script in benchmarks


def missed_by(name: str, role: str) -> str:
    """Return who waits for a node when it is gone."""
    if role == "force_analysis" and built(name).body is not None:
        return "body"
    return "motor" if role == "linkage" else "linkage"


def waits_for(role: str) -> str:
    """Return what is said of a hold; a node that stands still may keep others from being heard."""
    return rf"waiting for [^;]*\b{role}\b"


def recorded_messages(bag: Path) -> list[str]:
    """Return ``node: message`` of every diagnostics status of a bag."""
    with BagReader(bag) as reader:
        rows = [deserialize_message(row.raw, DiagnosticArray) for row in reader.messages(topics=["/diagnostics"])]
    return [f"{status.name}: {status.message}" for row in rows for status in row.status]


def missing_from_bag(name: str, bag: Path) -> int:
    """Return how many steps of a bag are missing, all of them counted; each of the others is the engine's own."""
    topic = full_name(name, STEP_LINKAGE)
    with BagReader(bag) as reader:
        rows = reader.messages(topics=[topic])
        samples = [linkage_messages.from_message(deserialize_message(row.raw, JointState)) for row in rows]
        counters = reader.info.counters[topic]
        assert counters["publishers"] == 1  # a killed node that came back is one
        counted = counters["missed"]
    by_step = {sample.step: sample for sample in samples}
    for sample in samples:
        assert sample == by_step[sample.step]
    missing = 0
    for frame in frames(built(name), max(by_step) * built(name).coupling_step_s):
        if frame.linkage.step in by_step:
            assert by_step[frame.linkage.step] == frame.linkage
        else:
            missing += 1
    assert missing == counted
    return missing


@pytest.mark.parametrize("name", KILLS)
def test_every_node_killed_in_turn_and_the_run_goes_on_where_it_held(name: str, tmp_path: Path) -> None:
    chance = random.Random(name)
    with ProcessRun(name, tmp_path, recorder=True, pace="max", peer_timeout_s=0.3) as run:
        run.start_all()
        for _, role in zip(range(KILLS[name]), cycle(run.roles), strict=False):
            run.steps(chance.randrange(1, 200), "before the kill")
            run.kill(role)
            run.until(lambda at=role: run.said(missed_by(name, at), waits_for(at)), what=f"a hold for {role}")
            run.spin_for(0.1)
            held = run.step
            run.start(role)
            run.steps(50, f"after the kill of {role} at {held}")
            run.checked()
            run.diagnostics.clear()
        assert run.finish("recorder") == 0
        assert run.checked() > 0
    killed = sum(1 for _, role in zip(range(KILLS[name]), cycle(run.roles), strict=False) if role == "linkage")
    assert missing_from_bag(name, run.bag) <= killed * DEPTH  # what a killed linkage had not yet delivered is gone
    said = recorded_messages(run.bag)
    for role in run.roles:
        assert any(re.search(waits_for(role), line) for line in said), role


def test_every_node_stopped_for_five_seconds_in_turn(tmp_path: Path) -> None:
    with ProcessRun("winding_drum", tmp_path, recorder=True, pace="max") as run:
        run.start_all()
        for role in run.roles:
            run.steps(100)
            run.signal(role, signal.SIGSTOP)
            run.spin_for(5.0)
            assert run.said(missed_by("winding_drum", role), waits_for(role))
            run.signal(role, signal.SIGCONT)
            run.until(lambda at=role: run.said(at, "stopped or overloaded for"), what=f"{role} says so")
            run.steps(100)
            run.checked()
        assert run.alive()
        assert run.finish("recorder") == 0
    assert missing_from_bag("winding_drum", run.bag) == 0
    said = recorded_messages(run.bag)
    for role in run.roles:
        assert any(re.search(waits_for(role), line) for line in said), role
        assert any(line.startswith(f"/winding_drum/{role}:") and "stopped or overloaded" in line for line in said), role


def test_a_stopped_linkage_does_not_chase_the_wall_clock(tmp_path: Path) -> None:
    with ProcessRun("winding_drum", tmp_path, pace="realtime") as run:
        run.start_all()
        run.steps(200)
        run.signal("linkage", signal.SIGSTOP)
        run.spin_for(3.0)
        held = run.step
        run.signal("linkage", signal.SIGCONT)
        run.spin_for(1.0)
        assert run.step - held < 2000  # one second of steps and not the three it missed
        run.steps(100)
        run.checked()


def test_a_hold_is_told_when_nobody_else_is_left(tmp_path: Path) -> None:
    with ProcessRun("winding_drum", tmp_path, recorder=True, pace="max") as run:
        run.start_all()
        run.steps(100)
        for role in ("motor", "force_analysis"):
            run.kill(role)
        run.until(lambda: run.said("linkage", "waiting for"), what="the hold is told")
        run.diagnostics.clear()
        run.until(lambda: float(run.figure("linkage", "waited s") or 0.0) > 1.0, what="how long it holds is told")
        run.diagnostics.clear()
        run.until(lambda: run.said("linkage", "waiting for"), what="it is told again")
        run.finish("recorder")
    assert any("waiting for motor" in line for line in recorded_messages(run.bag))


def test_a_stopped_recorder_counts_what_it_missed_and_a_killed_one_stops_nobody(tmp_path: Path) -> None:
    with ProcessRun("winding_drum", tmp_path, recorder=True, pace="max") as run:
        run.start_all()
        # one that is stopped before its first step has missed nothing of what it recorded: it begins later
        run.until(lambda: run.figure("recorder", "first step") == "0", what="the recorder has heard the first step")
        run.signal("recorder", signal.SIGSTOP)
        run.steps(3 * DEPTH)  # the publishers keep the newest DEPTH for it, and the transport a few more
        run.signal("recorder", signal.SIGCONT)
        # the sum, which is told each second: who counts it as gone by now does not hear the first message
        run.until(lambda: int(run.figure("recorder", "missed") or 0) > 0, what="the recorder says what it missed")
        run.until(lambda: "missing" in run.log("recorder"), what="it stands in the log, too")
        run.kill("recorder")
        run.steps(500)
        run.checked()
        run.start("recorder", "--directory", str(run.bag))
        assert run.processes["recorder"].wait(20.0) == 2  # never written over
        run.start("recorder", "--directory", str(tmp_path / "second"))
        second = str(tmp_path / "second")
        run.until(
            lambda: (
                run.figure("recorder", "recording") == second and int(run.figure("recorder", "written") or 0) > 1000
            ),
            what="a second recording",
        )
        assert run.finish("recorder") == 0
    with BagReader(tmp_path / "second") as reader:
        assert sum(1 for _ in reader.messages(topics=[full_name("winding_drum", STEP_LINKAGE)])) > 200

# SPDX-License-Identifier: Apache-2.0
"""Frames published beside a run are those of its joint states, and every wrench and marker has one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from bench_run import BenchRun
from catalogue import NAMES, built
from geometry_msgs.msg import TransformStamped, WrenchStamped
from recordings import decoded_messages
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from mech_twin.capabilities.mechanism import FrameTree, moved, urdf
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.messages.scene import frame_id, pose
from mech_twin.messages.step_message import stamp_s
from mech_twin.messages.topics import (
    DATA,
    DESCRIPTION,
    EVERY,
    FRAMES,
    LATCHED,
    PRESSING_FORCE,
    ROBOT_DESCRIPTION,
    SCENE,
    pin_wrench,
)
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.roles.frames_node import FramesNode
from mech_twin.nodes.run.composition import run_in_process
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import machine_parameters
from mech_twin.recording.bag_reader import BagReader

pytestmark = pytest.mark.usefixtures("ros_domain")
ENOUGH = 5  # instants


class Heard:
    """What a client hears of frames, wrenches, markers and the description."""

    def __init__(self, run: BenchRun) -> None:
        self.transforms: list[TransformStamped] = []
        self.used: set[str] = set()
        self.described: list[str] = []
        client, pins = run.client, built(run.name).forces.pins
        client.create_subscription(TransformStamped, FRAMES.name, self.transforms.append, EVERY)
        client.create_subscription(String, ROBOT_DESCRIPTION.name, lambda m: self.described.append(m.data), LATCHED)
        client.create_subscription(MarkerArray, SCENE.name, self._on_markers, DATA)
        wrenches = [pin_wrench(pin).name for pin in pins]
        bodies = [PRESSING_FORCE.name] if built(run.name).body is not None else []
        self.expected = len(wrenches) + len(bodies) + 1
        for topic in (*wrenches, *bodies):
            client.create_subscription(WrenchStamped, topic, lambda m: self.used.add(m.header.frame_id), DATA)

    def _on_markers(self, message: MarkerArray) -> None:
        self.used |= {marker.header.frame_id for marker in message.markers}

    def instants(self) -> dict[float, dict[str, TransformStamped]]:
        found: dict[float, dict[str, TransformStamped]] = {}
        for message in self.transforms:
            found.setdefault(stamp_s(message.header), {})[message.child_frame_id] = message
        return found


@contextmanager
def running(name: str, **options: Any) -> Iterator[tuple[BenchRun, Heard]]:
    with BenchRun(name, **options) as run:
        heard = Heard(run)
        run.revive(FramesNode)
        yield run, heard


def mechanism_of(name: str) -> FrameTree:
    found = built(name).mechanism
    assert found is not None
    return found


@pytest.mark.parametrize("name", NAMES)
def test_frames_are_those_of_the_joint_states_of_their_time(name: str) -> None:
    mechanism = mechanism_of(name)
    with running(name) as (run, heard):
        run.until(lambda: len(heard.transforms) > ENOUGH * len(mechanism.joints))
        by_time = {round(sample.time_s, 9): sample for sample in run.samples}
        instants = heard.instants()
    compared = 0
    for time_s, frames in list(instants.items())[:ENOUGH]:
        sample = by_time[round(time_s, 9)]
        positions = dict(zip(sample.joints, sample.position, strict=True))
        for joint in mechanism.joints:
            message = frames[frame_id(name, joint.child)]
            assert message.header.frame_id == frame_id(name, joint.parent)
            expected, told = moved(joint, positions), pose(message)
            assert (told.x_m, told.y_m) == (expected.x_m, expected.y_m)
            assert abs(math.remainder(told.angle_rad - expected.angle_rad, 2.0 * math.pi)) < 1e-12
            compared += 1
    assert compared == ENOUGH * len(mechanism.joints)


def test_frames_are_made_only_while_somebody_listens() -> None:
    name, heard = "winding_drum", list[TransformStamped]()
    with BenchRun(name) as run:
        node = run.revive(FramesNode)
        run.until(lambda: node.diagnostics.state == "running" and node.time_s > 0.1)
        frames = next(output for output in node.outputs if output.name == FRAMES.name)
        assert frames.sent == 0
        run.client.create_subscription(TransformStamped, FRAMES.name, heard.append, EVERY)
        run.until(lambda: len(heard) > 0)
        assert frames.sent >= len(heard)


@pytest.mark.parametrize("name", NAMES)
def test_every_wrench_and_marker_names_a_frame_that_is_published(name: str) -> None:
    with running(name, duration_s=0.0) as (run, heard):
        run.until(lambda: len(heard.used) >= heard.expected and len(heard.transforms) > 0)
        published = {frame_id(name, frame) for frame in mechanism_of(name).frames}
        assert heard.used <= published
        assert {message.child_frame_id for message in heard.transforms} <= published


def test_the_description_is_latched_and_follows_the_machine_that_runs() -> None:
    name = "vibration_crank"
    with running(name) as (run, heard):
        run.until(lambda: bool(heard.described))
        assert heard.described == [urdf(name, mechanism_of(name))]
        other = machine_parameters(name, None, {"crank_m": 0.06})
        run.publisher(DESCRIPTION).publish(String(data=description_text(name, other, 2)))
        run.until(lambda: len(heard.described) > 1)
        mechanism = CATALOGUE[name].build(other).mechanism
        assert mechanism is not None
        assert heard.described[1] == urdf(name, mechanism) != heard.described[0]


def test_frames_come_at_the_streams_rate_and_not_at_every_step() -> None:
    name = "winding_drum"
    with running(name, stream_rate_hz=100.0) as (run, heard):
        run.until(lambda: len(heard.instants()) > ENOUGH)
        times = sorted(heard.instants())
        step_s = built(name).coupling_step_s
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert min(gaps) > 9.9 * step_s


def test_a_run_tells_frames_and_description_unasked_and_once_what_is_missing_for_tf(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    name = "winding_drum"
    options = RunOptions(pace="max", duration_s=3.0, recorder=True)
    run_in_process(name, built(name).parameters, options, tmp_path / "bag", None)
    with BagReader(tmp_path / "bag") as reader:
        described, moved_to = (
            reader.topics[f"/{name}/{topic.name}"].message_count for topic in (ROBOT_DESCRIPTION, FRAMES)
        )
    assert described == 1
    assert moved_to > 0
    missing = find_spec("tf2_msgs") is None
    assert capfd.readouterr().err.count("tf2_msgs is not installed") == int(missing)


def test_the_description_of_a_page_bears_its_name(tmp_path: Path) -> None:
    parameters = machine_parameters(str(Path(__file__).parents[2] / "config/pages/spring_hammer.yaml"))
    options = RunOptions(pace="max", duration_s=3.0, recorder=True)
    run_in_process("page", parameters, options, tmp_path / "bag", None)
    (described,) = decoded_messages(tmp_path / "bag", f"/spring_hammer/{ROBOT_DESCRIPTION.name}")
    assert described.data.startswith('<robot name="spring_hammer">')


def test_a_listener_of_tf_hears_the_frames() -> None:
    tf2_msgs = pytest.importorskip("tf2_msgs.msg", reason="no tf2_msgs; .ci/tf_tests.sh builds it")
    heard_tf: dict[float, Any] = {}
    with running("winding_drum") as (run, heard):
        run.client.create_subscription(
            tf2_msgs.TFMessage, "/tf", lambda m: heard_tf.update({stamp_s(m.transforms[0].header): m}), EVERY
        )
        run.until(lambda: len(heard_tf.keys() & heard.instants().keys()) > ENOUGH)
        instants = heard.instants()
    for time_s in sorted(heard_tf.keys() & instants.keys())[1:ENOUGH]:  # the first may have begun unheard
        assert {frame.child_frame_id: frame for frame in heard_tf[time_s].transforms} == instants[time_s]


def test_two_runs_have_a_tree_each() -> None:
    assert frame_id("/hall/left", "shaft") == "hall/left/shaft"
    assert frame_id("/hall/right", "shaft") != frame_id("/hall/left", "shaft")

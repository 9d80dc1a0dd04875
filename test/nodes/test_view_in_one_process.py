# SPDX-License-Identifier: Apache-2.0
"""A view in the run's own process is given frames without topics, and draws its pictures from them."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import MarkerArray

from mech_twin.engine.run import frames
from mech_twin.messages import scene
from mech_twin.messages.topics import SCENE
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.roles.viewer_node import ViewerNode
from mech_twin.parameters.load import machine
from mech_twin.samples import Drawing, Frame, Shape

DRUM = "winding_drum"


@pytest.fixture
def viewer(ros: None, tmp_path: Path) -> Iterator[ViewerNode]:
    node = ViewerNode(DRUM, str(tmp_path / "run.rrd"), on_topics=False, options=RunOptions(view_rate_hz=25.0))
    yield node
    node.close()
    node.destroy_node()


def drawn(time_s: float) -> MarkerArray:
    line = Shape("line", "line", ((0.0, 0.0), (0.1, 0.1)), (10, 20, 30), 0.01, "")
    message: MarkerArray = deserialize_message(scene.to_bytes(Drawing(0, time_s, (line,))), MarkerArray)
    return message


@pytest.mark.slow
def test_pictures_are_shown_for_as_long_as_the_run_goes_on(viewer: ViewerNode) -> None:
    for frame in frames(machine(DRUM, overrides={"coupling.step_s": 0.1}), 30.0):
        viewer.show(frame)
        viewer._on_scene(drawn(frame.linkage.time_s))
    assert viewer.statistics.total[SCENE.name, "unknown_source"] == 0
    viewer._on_scene(drawn(1e6))
    assert viewer.statistics.total[SCENE.name, "unknown_source"] == 1


def test_frames_are_drawn_thirty_times_a_simulated_second(viewer: ViewerNode, monkeypatch: pytest.MonkeyPatch) -> None:
    drum, shown = machine(DRUM), list[Drawing]()
    show = viewer.scene.drawing

    def drawing(one: Drawing) -> None:
        shown.append(one)
        show(one)

    monkeypatch.setattr(viewer.scene, "drawing", drawing)
    viewer.draw = lambda frame: drum.draw(frame.linkage, frame.body)
    for frame in frames(drum, 0.2):
        viewer.show(frame)
    assert [drawing.step for drawing in shown] == [0, *(-(-1000 * k // 30) for k in range(1, 7))]
    assert shown[-1].shapes == drum.draw(frame_of(shown[-1].step).linkage, None)


def frame_of(step: int) -> Frame:
    """Return the frame of a step of the drum."""
    return next(frame for frame in frames(machine(DRUM), 0.2) if frame.linkage.step == step)


def test_it_hears_no_pictures_of_its_own_process(viewer: ViewerNode) -> None:
    assert viewer.count_subscribers(SCENE.name) == 0

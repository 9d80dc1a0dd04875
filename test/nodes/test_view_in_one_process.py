# SPDX-License-Identifier: Apache-2.0
"""A view in the run's own process is given frames without topics, and pictures over them."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy

from mech_twin.engine.run import frames
from mech_twin.messages import scene
from mech_twin.messages.topics import SCENE
from mech_twin.nodes.viewer_node import ViewerNode
from mech_twin.parameters.load import machine
from mech_twin.samples import Drawing, Shape

DRUM = "winding_drum"


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[ViewerNode]:
    rclpy.init(args=[])
    node = ViewerNode(DRUM, str(tmp_path / "run.rrd"), on_topics=False)
    yield node
    node.close()
    node.destroy_node()
    rclpy.shutdown()


def test_pictures_are_shown_for_as_long_as_the_run_goes_on(viewer: ViewerNode) -> None:
    line = Shape("line", "line", ((0.0, 0.0), (0.1, 0.1)), (10, 20, 30), 0.01, "")
    for frame in frames(machine(DRUM, overrides={"coupling.step_s": 0.1}), 30.0):
        viewer.show(frame)
        viewer._on_scene(scene.to_message(Drawing(frame.linkage.step, frame.linkage.time_s, (line,))))
    assert viewer.statistics.total[SCENE.name, "unknown_source"] == 0
    viewer._on_scene(scene.to_message(Drawing(0, 1e6, (line,))))
    assert viewer.statistics.total[SCENE.name, "unknown_source"] == 1

# SPDX-License-Identifier: Apache-2.0
"""The viewer node: what the topics say, handed to a rerun scene; metrics of the run about once a second."""

from __future__ import annotations

import time

from visualization_msgs.msg import MarkerArray

from mech_twin.messages import scene
from mech_twin.messages.step_message import MessageError
from mech_twin.messages.topics import EVERY, SCENE
from mech_twin.nodes.observer_node import ObserverNode
from mech_twin.nodes.options import RunOptions
from mech_twin.quantity import Parameters
from mech_twin.samples import Frame
from mech_twin.view.destination import destination
from mech_twin.view.rerun_scene import RerunScene

METRICS_EVERY_S = 1.0
APART_S = (
    10.0  # as far as a drawing may be from the newest step: topics overtake each other, and simulated time is fast
)


def opened_scene(machine_name: str, place: str) -> RerunScene:
    """Return a scene in a file or in a running viewer; see `destination`."""
    to = destination(place)
    return RerunScene(
        machine_name, grpc_url=to.grpc_url, rrd_path=to.rrd_path, sending=to.sending, light=to.light, flow=to.flow
    )


class ViewerNode(ObserverNode):
    """Shows a run in a rerun scene.

    Parameters
    ----------
    place : str
        Address of a running viewer, or the file to write: see `destination`, and `TwinNode` for the other arguments.
    """

    def __init__(
        self,
        machine_name: str,
        place: str,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
        on_topics: bool = True,
    ) -> None:
        super().__init__(machine_name, parameters, options, name="viewer", on_topics=on_topics)
        self.rerun_scene = opened_scene(machine_name, place)
        self._shown = time.monotonic()
        self.create_subscription(MarkerArray, SCENE.name, self._on_scene, EVERY)

    def close(self) -> None:
        """Show the last metrics and let the scene go."""
        self.rerun_scene.metrics(self.run_metrics.running_numbers())
        self.rerun_scene.close()

    def show(self, frame: Frame) -> None:
        """Show one whole frame."""
        self.diagnostics.state = "running"
        self.time_s = frame.linkage.time_s
        self.newest_s = max(self.newest_s, self.time_s)  # frames that come without topics tell where the run is
        if self.run_metrics.frames == 0 and (tree := self.run_metrics.machine.mechanism) is not None:
            self.rerun_scene.know(tree, self.run_metrics.machine.blow_energy)
        self.rerun_scene.frame(motor=frame.motor, linkage=frame.linkage, forces=frame.forces, body=frame.body)
        for event in self.run_metrics.observe(frame):
            self.rerun_scene.event(event)
        now = time.monotonic()
        if now - self._shown > METRICS_EVERY_S:
            self._shown = now
            self.rerun_scene.metrics(self.run_metrics.running_numbers())

    def _on_scene(self, message: MarkerArray) -> None:
        try:
            drawing = scene.from_message(message)
        except MessageError as error:
            self.statistics.count(SCENE.name, "malformed", str(error))
            return
        if abs(drawing.time_s - self.newest_s) > APART_S:
            reason = f"stamp {drawing.time_s:g} s is no time of this run, which is at {self.newest_s:g} s"
            self.statistics.count(SCENE.name, "unknown_source", reason)
            return
        self.rerun_scene.drawing(drawing)

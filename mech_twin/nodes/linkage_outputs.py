# SPDX-License-Identifier: Apache-2.0
"""What the linkage node publishes: step messages, clock, impacts, drawing, configuration."""

from __future__ import annotations

from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from mech_twin.messages import impact, scene
from mech_twin.messages import linkage as linkage_messages
from mech_twin.messages.frames import frame_id
from mech_twin.messages.joint_states import has_impact, joints_message
from mech_twin.messages.stamped_cdr import clock_bytes
from mech_twin.messages.topics import CLOCK, DESCRIPTION, IMPACTS, JOINT_STATES, SCENE, STEP_LINKAGE
from mech_twin.nodes.role_node import RoleNode
from mech_twin.samples import BodySample, Drawing, LinkageSample

PEERS_THAT_STEP = 2  # motor and force analysis listen to every step


class LinkageOutputs:
    """Publishers of the linkage.

    Parameters
    ----------
    node : RoleNode
        The linkage's node.
    """

    def __init__(self, node: RoleNode) -> None:
        self._node = node
        self._frame = frame_id(node.get_namespace(), scene.FRAME)
        self._steps = node.step_output(STEP_LINKAGE, PEERS_THAT_STEP)
        self._states = node.joint_state_output(JOINT_STATES, node.stream_window, joints_message)
        self._clock = node.output(CLOCK)
        self._impacts = node.output(IMPACTS)
        self._scene = node.output(SCENE, int(node.options.viewer))
        self._description = node.output(DESCRIPTION)
        self._steps_per_drawing = max(1, round(1.0 / (node.options.view_rate_hz * node.machine.coupling_step_s)))

    def describe(self, text: str) -> None:
        """Publish the configuration in force."""
        self._description.send(String(data=text))

    def send_step(self, sample: LinkageSample) -> None:
        """Publish the step message; a step may be published again."""
        self._steps.send(linkage_messages.to_bytes(sample, self._node.marks))

    def send_views(self, sample: LinkageSample, body: BodySample | None) -> None:
        """Publish what a step means to people and other tools, each at its own rate; once a step."""
        for event in sample.events:
            self._impacts.send(impact.to_bytes(event))
        self._states.offer(sample, has_impact(sample.events))
        if sample.step % self._node.stream_window == 0:
            self._clock.send(clock_bytes(sample.time_s))
        if sample.step % self._steps_per_drawing == 0:
            self._scene.send_made(lambda: self._drawn(sample, body))

    def _drawn(self, sample: LinkageSample, body: BodySample | None) -> MarkerArray:
        shapes = self._node.machine.draw(sample, body)
        return scene.to_message(Drawing(sample.step, sample.time_s, shapes), self._frame)

"""What the linkage node publishes: step messages, clock, impacts, drawing, configuration."""

from __future__ import annotations

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.messages import impact, scene
from mech_twin.messages import linkage as linkage_messages
from mech_twin.messages.frames import frame_id
from mech_twin.messages.step_message import mark_revision, set_stamp
from mech_twin.messages.topics import CLOCK, DESCRIPTION, IMPACTS, JOINT_STATES, SCENE
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
        self._message = JointState()
        self._frame = frame_id(node.get_namespace(), scene.FRAME)
        self._steps = node.step_output(JOINT_STATES, PEERS_THAT_STEP)
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
        message = linkage_messages.to_message(sample, self._message)
        self._steps.send(self._node.signed(mark_revision(message, self._node.revision, self._node.described_by)))

    def send_views(self, sample: LinkageSample, body: BodySample | None) -> None:
        """Publish what a step means to people and other tools, each at its own rate; once a step."""
        for event in sample.events:
            self._impacts.send(impact.to_message(event))
        if sample.step % self._node.options.stream_decimation == 0:
            stamp = JointState()
            set_stamp(stamp.header, sample.time_s)
            self._clock.send(Clock(clock=stamp.header.stamp))
        if sample.step % self._steps_per_drawing == 0:
            shapes = self._node.machine.draw(sample, body)
            self._scene.send(scene.to_message(Drawing(sample.step, sample.time_s, shapes), self._frame))

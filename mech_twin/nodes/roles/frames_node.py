# SPDX-License-Identifier: Apache-2.0
"""The frames node: poses of all links and pins for TF, and the robot description of the machine.

It subscribes to the joint states of a run, or of a replay, and takes no part in the exchange of steps.
"""

from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from mech_twin.capabilities.mechanism import FrameTree, urdf
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.messages.cdr import CdrError, received_message
from mech_twin.messages.scene import transforms
from mech_twin.messages.step_message import stamp_s
from mech_twin.messages.topics import (
    DESCRIPTION,
    EVERY_LATCHED,
    FRAMES,
    JOINT_STATES,
    ROBOT_DESCRIPTION,
    Topic,
    steps_per_window,
    type_name,
)
from mech_twin.nodes.exchange.base_node import RunOptions, TwinNode
from mech_twin.nodes.exchange.direct_exchange import Handed, ReceivedBytes
from mech_twin.parameters.description import description
from mech_twin.parameters.load import catalogue_entry
from mech_twin.recording.bag_contents import stamp_ns
from mech_twin.roles import Machine, own_name

# late joint states are useless, and no publisher should wait for this node
NEWEST = QoSProfile(depth=10, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT)
EARLY = 0.999  # of a period: stamps are rounded to nanoseconds


def mechanism_of(machine: Machine) -> FrameTree:
    """Return the frame tree of a machine.

    Raises
    ------
    ConfigurationError
        If the machine declares none.
    """
    if machine.mechanism is None:
        raise ConfigurationError(f"machine {machine.name} says nothing of its frames; see docs/adding-a-machine.md")
    return machine.mechanism


class FramesNode(TwinNode):
    """Publishes frames and robot description; see `TwinNode` for the arguments.

    ``/tf`` is published only if the package tf2_msgs is installed; the wheels do not include it.
    """

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("frames", machine_name, parameters, options)
        self._frames = self.output(FRAMES)
        self._urdf = self.output(ROBOT_DESCRIPTION)
        self._tf = _tf_output(self)
        self._described = self.initial_parameters
        machine = catalogue_entry(machine_name).build(self._described)
        self._mechanism = mechanism_of(machine)
        window = steps_per_window(self.options.stream_rate_hz, machine.coupling_step_s)
        self._period_ns = round(window * machine.coupling_step_s * 1e9)
        self._last_ns: int | None = None
        self._describe()
        self.subscribe(DESCRIPTION, self._on_description, qos=EVERY_LATCHED)
        self.listen(JOINT_STATES, self._on_joints, self._on_joints, qos=NEWEST)

    def _on_joints(self, received: Handed | ReceivedBytes) -> None:
        """Publish the frames at the stream's rate; time going back means another run, or a jump of a replay."""
        raw = received.raw
        now_ns = stamp_ns(type_name(JOINT_STATES), raw)
        if now_ns is None:
            return
        last_ns = self._last_ns
        if last_ns is not None and last_ns <= now_ns < last_ns + EARLY * self._period_ns:
            return
        self.diagnostics.state = "running"
        if not (self._frames.has_receivers or (self._tf is not None and self._tf[0].has_receivers)):
            self.time_s, self._last_ns = now_ns * 1e-9, now_ns
            return
        try:
            message = received_message(raw)
            positions = dict(zip(message.name, message.position, strict=True))
            self.time_s = stamp_s(message.header)
            found = transforms(self._mechanism, positions, self.time_s, self.get_namespace())
        except (CdrError, ValueError) as error:
            self.statistics.count(JOINT_STATES.name, "malformed", str(error))
        except KeyError as error:
            self.statistics.count(JOINT_STATES.name, "malformed", f"joint {error.args[0]} is missing")
        else:
            self._last_ns = now_ns
            self._send(found)

    def _send(self, found: list[bytes]) -> None:
        for transform in found:
            self._frames.send(transform)
        if self._tf is not None:
            publisher, message_type = self._tf
            publisher.send_made(
                lambda: message_type(transforms=[deserialize_message(raw, TransformStamped) for raw in found])
            )

    def _on_description(self, message: String) -> None:
        """Adopt the dimensions of the running machine."""
        try:
            described = description(message.data)
        except ValueError as error:
            self.statistics.count(DESCRIPTION.name, "malformed", str(error))
            return
        if described.machine != self.machine_name or described.parameters == self._described:
            return
        self._described = described.parameters
        self._mechanism = mechanism_of(catalogue_entry(self.machine_name).build(described.parameters))
        self._describe()

    def _describe(self) -> None:
        self._urdf.send(String(data=urdf(own_name(self.machine_name, self._described), self._mechanism)))


def _tf_output(node: TwinNode) -> tuple[Any, Any] | None:
    """Return the publisher of ``/tf`` and its message type; None if tf2_msgs is not installed."""
    try:
        from tf2_msgs.msg import TFMessage
    except ModuleNotFoundError:
        node.get_logger().info("tf2_msgs is not installed: frames are published on 'frames', not on /tf")
        return None
    return node.output(Topic("/tf", TFMessage), recorded=False), TFMessage

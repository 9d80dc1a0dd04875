"""The motor node: torque of the drive at each step, the speed command, start and stop."""

from __future__ import annotations

import math

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from mech_twin.messages import linkage as linkage_messages
from mech_twin.messages import motor as motor_messages
from mech_twin.messages.rows import arranged
from mech_twin.messages.topics import (
    JOINT_STATES,
    MOTOR_JOINT_STATES,
    RECALL,
    RECALLED_DESCRIPTION,
    RECALLED_LINKAGE,
    SPEED_COMMAND,
)
from mech_twin.nodes.follower_node import FollowerNode
from mech_twin.nodes.options import RunOptions
from mech_twin.quantity import Parameters
from mech_twin.samples import LinkageSample, MotorSample

RATED = 1.0
HIGHEST_COMMAND = 1.2


class MotorNode(FollowerNode):
    """Shell around the motor role; see `RoleNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("motor", machine_name, parameters, options)
        self.target: float | None = None
        self._asked_target = RATED
        self._sample: MotorSample | None = None
        self._message = JointState()
        self._last_linkage: JointState | None = None
        self._out = self.step_outlet(MOTOR_JOINT_STATES, 1)
        self._recalled = self.outlet(RECALLED_LINKAGE)
        self._recalled_description = self.outlet(RECALLED_DESCRIPTION)
        self._recalled.listeners = self._recalled_description.listeners = 0
        self.create_subscription(Float64, SPEED_COMMAND.name, self._on_command, SPEED_COMMAND.qos)
        self.create_subscription(String, RECALL.name, self._on_recall, RECALL.qos)
        self.create_service(Trigger, "start", self._on_start)
        self.create_service(Trigger, "stop", self._on_stop)
        self.listen(JOINT_STATES)

    def decoded(self, message: JointState) -> LinkageSample:
        """Return the linkage sample of a message."""
        sample = linkage_messages.from_message(message, self.machine.coupling_step_s)
        arranged_sample: LinkageSample = arranged(sample, self.machine.linkage.joints)
        self._last_linkage = message
        return arranged_sample

    def answer(self, question: LinkageSample) -> bool:
        """Publish the drive at the linkage's step."""
        if self.target is None:  # a motor that comes back goes on where the supply was
            self.target = RATED if question.step == 0 else question.command
        self._sample = self.machine.motor.respond(question, self.target)
        self.on_sample(self._sample)
        self.repeat()
        return True

    def repeat(self) -> None:
        """Publish the last motor sample."""
        if self._sample is not None:
            self._out.send(motor_messages.to_message(self._sample, self._message))

    def _on_command(self, message: Float64) -> None:
        fraction = message.data
        if not math.isfinite(fraction) or not 0.0 <= fraction <= HIGHEST_COMMAND:
            reason = f"{fraction} is outside 0 to {HIGHEST_COMMAND}"
            self.ledger.count(SPEED_COMMAND.name, "malformed", reason)
            return
        self.target = fraction
        if fraction > 0.0:
            self._asked_target = fraction

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.target = self._asked_target
        response.success, response.message = True, f"supply on at {self.target:g} of rated frequency"
        return response

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.target = 0.0
        response.success, response.message = True, "supply off"
        return response

    def _on_recall(self, message: String) -> None:
        if message.data == "linkage":
            self._recalled_description.send(String(data=self.description))
            self._recalled.send(self._last_linkage or JointState())

# SPDX-License-Identifier: Apache-2.0
"""The body node: angle, contact and pressing force of the body at each step."""

from __future__ import annotations

from functools import partial

from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.coupling import GIVEN_STATE, RESET, next_body
from mech_twin.messages import impact
from mech_twin.messages.frames import TOOL_FRAME, frame_id
from mech_twin.messages.joint_state_cdr import StepMessage
from mech_twin.messages.stamped_cdr import wrench_bytes
from mech_twin.messages.step_codec import body as body_messages
from mech_twin.messages.step_codec import force as force_messages
from mech_twin.messages.step_message import MessageError
from mech_twin.messages.stream_window import has_impact
from mech_twin.messages.topics import (
    BODY_JOINT_STATES,
    IMPACTS,
    PRESSING_FORCE,
    REJOIN,
    REJOIN_BODY,
    STEP_BODY,
    STEP_FORCES,
)
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.exchange.hand_over import HandedStep
from mech_twin.nodes.roles.follower_node import FollowerNode
from mech_twin.roles import BodyRole
from mech_twin.samples import BodySample, ForceSample


def _pressing_force(frame: str, sample: BodySample) -> bytes:
    return wrench_bytes(sample.time_s, frame, sample.pressing_force_n)


class BodyNode(FollowerNode):
    """Shell around the body role; see `RoleNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("body", machine_name, parameters, options, STEP_FORCES, "force_analysis")
        self._out = self.step_output(STEP_BODY, 1)
        self._states = self.joint_state_output(BODY_JOINT_STATES, self.stream_window, body_messages.shown)
        self._impacts = self.output(IMPACTS)
        tool = frame_id(self.get_namespace(), TOOL_FRAME)
        self._pressing = self.peak_hold_output(PRESSING_FORCE, self.stream_window, partial(_pressing_force, tool))
        self._rejoining = False
        self._rejoin = self.output(REJOIN, recorded=False)
        self.subscribe(REJOIN_BODY, self._on_last_sample)

    @property
    def role(self) -> BodyRole:
        """The body role; a machine without one has no body node."""
        if self.machine.body is None:
            raise ValueError(f"machine {self.machine.name} has no moving body")
        return self.machine.body

    def residual_limits(self) -> dict[str, float]:
        """Return the limits of what linkage and body may differ by."""
        return dict(self.role.residual_limits)

    def decoded(self, message: StepMessage) -> ForceSample:
        """Return the force sample of a message."""
        return force_messages.from_message(message, self.machine.coupling_step_s)

    def answer(self, question: ForceSample, previous: BodySample | None) -> BodySample | None:
        """Return the body at the step of these forces; a body that comes back asks first where it was."""
        given = any(load.kind == RESET and load.contact == GIVEN_STATE for load in question.loads)
        self._rejoining = given or (previous is None and question.step > 0)
        if self._rejoining:
            self._rejoin.send(String(data="body"))
            return None
        sample = next_body(self.role, previous, question)
        self.diagnostics.observe(sample.residuals)
        return sample

    def send(self, answer: BodySample) -> None:
        """Publish a body sample."""
        self._out.send(HandedStep(answer, (self.signature,), body_messages.to_bytes))

    def show(self, question: ForceSample, answer: BodySample) -> None:
        """Publish events, and offer joint states and pressing force to their decimated topics."""
        for event in answer.events:
            self._impacts.send(impact.to_bytes(event))
        self._states.offer(answer, has_impact(answer.events) or has_impact(question.loads))
        self._pressing.offer(abs(answer.pressing_force_n), answer)

    def _on_last_sample(self, message: JointState) -> None:
        if not message.name or not self._rejoining:
            return
        try:
            sample = body_messages.from_message(message, self.machine.coupling_step_s)
        except MessageError as error:
            self.statistics.count(REJOIN_BODY.name, "malformed", str(error))
            return
        last = self.exchanges.last_step
        if last is None or sample.step > last:
            self.exchanges.remember(sample.step, None, sample)

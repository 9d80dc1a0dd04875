# SPDX-License-Identifier: Apache-2.0
"""The force analysis node: every pin reaction, and the loads on the body, at each step."""

from __future__ import annotations

from functools import partial

from mech_twin.declarations.quantity import Parameters
from mech_twin.messages.frames import frame_id
from mech_twin.messages.joint_state_cdr import StepMessage
from mech_twin.messages.stamped_cdr import wrench_bytes
from mech_twin.messages.step_codec import force as force_messages
from mech_twin.messages.step_codec import linkage as linkage_messages
from mech_twin.messages.stream_window import has_impact, wrench_size
from mech_twin.messages.topics import FORCE_JOINT_STATES, STEP_FORCES, STEP_LINKAGE, pin_wrench
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.exchange.hand_over import HandedStep
from mech_twin.nodes.roles.follower_node import FollowerNode
from mech_twin.samples import ForceSample, LinkageSample


def _wrench(frame: str, place: int, sample: ForceSample) -> bytes:
    return wrench_bytes(sample.time_s, frame, *sample.wrenches[place])


class ForceNode(FollowerNode):
    """Shell around the force role; see `RoleNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("force_analysis", machine_name, parameters, options, STEP_LINKAGE, "linkage")
        self._out = self.step_output(STEP_FORCES, 1)
        self._states = self.joint_state_output(FORCE_JOINT_STATES, self.stream_window, force_messages.shown)
        topics = {pin: pin_wrench(pin) for pin in self.machine.forces.pins}
        space = self.get_namespace()
        self._wrenches = [
            self.peak_hold_output(topic, self.stream_window, partial(_wrench, frame_id(space, pin), place))
            for place, (pin, topic) in enumerate(topics.items())
        ]

    def residual_limits(self) -> dict[str, float]:
        """Return the limits of the power balance and its like."""
        return dict(self.machine.forces.residual_limits)

    def decoded(self, message: StepMessage) -> LinkageSample:
        """Return the linkage sample of a message."""
        return linkage_messages.received(message.raw, self.machine.coupling_step_s, self.machine.linkage.joints)

    def answer(self, question: LinkageSample, previous: ForceSample | None) -> ForceSample:
        """Return the forces of the linkage's step."""
        sample = self.machine.forces.analyse(question)
        self.diagnostics.observe(sample.residuals)
        return sample

    def send(self, answer: ForceSample) -> None:
        """Publish a force sample."""
        self._out.send(HandedStep(answer, self.marks, force_messages.to_bytes))

    def show(self, question: LinkageSample, answer: ForceSample) -> None:
        """Offer the forces to the decimated topics, all of them and pin by pin."""
        sizes = [wrench_size(wrench) for wrench in answer.wrenches]
        self._states.offer(answer, has_impact(question.events), max(sizes, default=0.0))
        for output, size in zip(self._wrenches, sizes, strict=True):
            output.offer(size, answer)

# SPDX-License-Identifier: Apache-2.0
"""The motor node: torque of the drive at each step, commands of speed, effort and position, start and stop."""

from __future__ import annotations

import math
from collections.abc import Callable

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from std_srvs.srv import Trigger

from mech_twin.capabilities.errors import StudyError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.coupling import Target, driven, effort_limit
from mech_twin.engine.start_forecast import LOOK_AHEAD_S, start_forecast
from mech_twin.messages.joint_state_cdr import StepMessage
from mech_twin.messages.step_codec import linkage as linkage_messages
from mech_twin.messages.step_codec import motor as motor_messages
from mech_twin.messages.step_message import TARGET, MessageError, Row, marked
from mech_twin.messages.stream_window import has_impact
from mech_twin.messages.topics import (
    EFFORT_COMMAND,
    MOTOR_JOINT_STATES,
    POSITION_COMMAND,
    REJOIN,
    REJOIN_DESCRIPTION,
    REJOIN_LINKAGE,
    REJOIN_MOTOR,
    SPEED_COMMAND,
    STEP_LINKAGE,
    STEP_MOTOR,
    Topic,
)
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.exchange.hand_over import HandedStep
from mech_twin.nodes.roles.follower_node import FollowerNode
from mech_twin.nodes.roles.ration import Ration
from mech_twin.samples import EffortCommand, LinkageSample, MotorSample

RATED = 1.0
HIGHEST_COMMAND = 1.0
HOLD = ("position", "stiffness", "damping")  # numbers of a position command
FORECAST_SHARE = 0.1  # of a run's time that forecasts may take, however often a start is asked for
FORECAST_BURST_S = 0.5  # owed: who was refused, changes a parameter and asks again, is not kept waiting


class MotorNode(FollowerNode):
    """Shell around the motor role; see `RoleNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("motor", machine_name, parameters, options, STEP_LINKAGE, "linkage")
        self.target: Target | None = None
        self._asked_target = RATED
        self._forecasts = Ration(FORECAST_SHARE, FORECAST_BURST_S)
        self._out = self.step_output(STEP_MOTOR, 1)
        self._states = self.joint_state_output(MOTOR_JOINT_STATES, self.stream_window, motor_messages.shown)
        self._rejoin = self.output(REJOIN, recorded=False)
        self._linkage_rejoins = self.output(REJOIN_LINKAGE, recorded=False)
        self._description_rejoins = self.output(REJOIN_DESCRIPTION, recorded=False)
        self.subscribe(SPEED_COMMAND, self._on_speed)
        self.subscribe(EFFORT_COMMAND, self._on_effort)
        self.subscribe(POSITION_COMMAND, self._on_position)
        self.subscribe(REJOIN_MOTOR, self._on_last_sample)
        self.create_service(Trigger, "start", self._on_start)
        self.create_service(Trigger, "stop", self._on_stop)

    def decoded(self, message: StepMessage) -> LinkageSample:
        """Return the linkage sample of a message."""
        return linkage_messages.received(message.raw, self.machine.coupling_step_s, self.machine.linkage.joints)

    def answer(self, question: LinkageSample, previous: MotorSample | None) -> MotorSample | None:
        """Return the drive at the linkage's step; a motor that comes back asks first what it was told to do."""
        if self.target is None and question.step > 0:
            self._rejoin.send(String(data="motor"))
            return None
        self.target = RATED if self.target is None else self.target
        return driven(self.machine, question, self.target)

    def send(self, answer: MotorSample) -> None:
        """Publish a motor sample, with the command it is on its way to."""
        target = Row(TARGET, self.target if isinstance(self.target, float) else self._asked_target)
        self._out.send(HandedStep(answer, (target, self.signature), motor_messages.to_bytes))

    def show(self, question: LinkageSample, answer: MotorSample) -> None:
        """Offer the drive to its decimated topic."""
        self._states.offer(answer, has_impact(question.events))

    def _on_last_sample(self, message: JointState) -> None:
        if self.target is not None:
            return
        try:
            sample = motor_messages.from_message(message, self.machine.coupling_step_s) if message.name else None
            self._take_speed(marked(message, TARGET, RATED))
            if sample is not None and sample.asked is not None:
                self._take_effort(sample.asked)
        except MessageError as error:
            self.statistics.count(REJOIN_MOTOR.name, "malformed", str(error))

    def tell_peer(self, peer: str) -> None:
        """Tell a linkage that came back its last sample and its configuration."""
        if peer == "linkage":
            self._description_rejoins.send(String(data=self.description))
            self._linkage_rejoins.send(JointState() if self.last_message is None else self.last_message.raw)

    def _on_speed(self, message: Float64) -> None:
        self._obey(SPEED_COMMAND, lambda: self._take_speed(message.data))

    def _on_effort(self, message: Float64) -> None:
        self._obey(EFFORT_COMMAND, lambda: self._take_effort(EffortCommand(message.data)))

    def _on_position(self, message: Float64MultiArray) -> None:
        def hold() -> None:
            if len(message.data) != len(HOLD):
                raise MessageError(f"{len(message.data)} numbers; expected {len(HOLD)}: {', '.join(HOLD)}")
            position, stiffness, damping = message.data
            if stiffness < 0.0 or damping < 0.0:
                raise MessageError(f"stiffness {stiffness:g}, damping {damping:g}; expected 0 or more of both")
            self._take_effort(EffortCommand(0.0, position, stiffness, damping))

        self._obey(POSITION_COMMAND, hold)

    def _obey(self, topic: Topic, take: Callable[[], None]) -> None:
        """Take a command; count one that is refused, with the reason."""
        try:
            take()
        except (MessageError, StudyError) as error:
            self.statistics.count(topic.name, "malformed", str(error))

    def _take_effort(self, asked: EffortCommand) -> None:
        limit = effort_limit(self.machine)
        if not all(map(math.isfinite, asked)) or abs(asked.effort) > limit:
            raise MessageError(f"{', '.join(map(str, asked))}: expected finite numbers, an effort within {limit:g}")
        self.target = asked

    def _take_speed(self, fraction: float) -> None:
        if not math.isfinite(fraction) or not 0.0 <= fraction <= HIGHEST_COMMAND:
            raise MessageError(f"{fraction} is outside 0 to {HIGHEST_COMMAND}")
        self.target = fraction
        if fraction > 0.0:
            self._asked_target = fraction

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Switch the supply on, if the machine turns then; the run waits while that is computed."""
        linkage, asked = self.last_question, self._asked_target
        refused = self._forecasts.refusal()
        if refused:
            response.success, response.message = False, refused
            return response
        with self._forecasts.taking():
            forecast = None if linkage is None else start_forecast(self.machine, linkage, asked)
        response.success = forecast is None or forecast.turns
        if forecast is None or forecast.turns:
            self.target = asked
            response.message = f"supply on at {asked:g} of rated frequency"
            return response
        why = f"drive at {forecast.position:.6g} would stand still {LOOK_AHEAD_S:g} s after switching on"
        self.get_logger().warning(f"start: {why}")
        self.diagnostics.warn(f"start: {why}")
        response.message = f"supply left as it is: {why}"
        return response

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.target = 0.0
        response.success, response.message = True, "supply off"
        return response

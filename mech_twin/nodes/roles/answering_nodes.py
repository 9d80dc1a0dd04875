# SPDX-License-Identifier: Apache-2.0
"""The nodes that answer the linkage once per step: motor, force analysis and body."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.coupling import (
    GIVEN_STATE,
    LOOK_AHEAD_S,
    RESET,
    Target,
    check_effort,
    driven,
    next_body,
    start_forecast,
)
from mech_twin.errors import StudyError
from mech_twin.messages import impacts
from mech_twin.messages.cdr import StepMessage, wrench_bytes
from mech_twin.messages.scene import TOOL_FRAME, frame_id
from mech_twin.messages.step_message import TARGET, MessageError, Row, marked
from mech_twin.messages.step_message import body as body_messages
from mech_twin.messages.step_message import force as force_messages
from mech_twin.messages.step_message import motor as motor_messages
from mech_twin.messages.topics import (
    EFFORT_COMMAND,
    IMPACTS,
    POSITION_COMMAND,
    PRESSING_FORCE,
    REJOIN,
    REJOIN_BODY,
    REJOIN_DESCRIPTION,
    REJOIN_LINKAGE,
    REJOIN_MOTOR,
    SPEED_COMMAND,
    STEP_FORCES,
    STEP_LINKAGE,
    Topic,
    has_impact,
    pin_wrench,
    wrench_size,
)
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.exchange.parameter_bridge import offer
from mech_twin.nodes.roles.follower_node import FollowerNode
from mech_twin.nodes.roles.run_control import Ration
from mech_twin.roles import BodyRole
from mech_twin.samples import BodySample, EffortCommand, ForceSample, LinkageSample, MotorSample

RATED = 1.0
HIGHEST_COMMAND = 1.0
HOLD = ("position", "stiffness", "damping")  # numbers of a position command
FORECAST_SHARE = 0.1  # largest share of a run's wall time for forecasts, however often a start is requested
FORECAST_BURST_S = 0.5  # computing time in advance, so that a repeated request is not refused at once


class MotorNode(FollowerNode):
    """Node of the motor role; see `RoleNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("motor", machine_name, parameters, options, motor_messages, STEP_LINKAGE, "linkage")
        self.target: Target | None = None
        self._asked_target = RATED
        self._forecasts = Ration(FORECAST_SHARE, FORECAST_BURST_S)
        self._rejoin = self.output(REJOIN, recorded=False)
        self._linkage_rejoins = self.output(REJOIN_LINKAGE, recorded=False)
        self._description_rejoins = self.output(REJOIN_DESCRIPTION, recorded=False)
        self._obey(SPEED_COMMAND, lambda message: self._take_speed(message.data))
        self._obey(EFFORT_COMMAND, lambda message: self._take_effort(EffortCommand(message.data)))
        self._obey(POSITION_COMMAND, self._hold)
        self.subscribe(REJOIN_MOTOR, self._on_last_sample)
        offer(self, Trigger, "start", lambda _: self.start())
        offer(self, Trigger, "stop", lambda _: self.stop())

    def answer(self, question: LinkageSample, previous: MotorSample | None) -> MotorSample | None:
        """Return the drive at the linkage's step; a restarted motor first asks for its last command."""
        if self.target is None and question.step > 0:
            self._rejoin.send(String(data="motor"))
            return None
        self.target = RATED if self.target is None else self.target
        return driven(self.machine, question, self.target)

    @property
    def marks(self) -> tuple[Row, ...]:
        """The command that the motor is ramping to, that of the next start, and the source number."""
        target = self.target if isinstance(self.target, float) else self._asked_target
        return Row(TARGET, target, self._asked_target), self.signature

    def show(self, question: LinkageSample, answer: MotorSample) -> None:
        """Offer the motor sample to its decimated topic."""
        self._states.offer(answer.step, answer, 0.0, has_impact(question.events))

    def _on_last_sample(self, message: JointState) -> None:
        if self.target is not None:
            return
        try:
            sample = motor_messages.from_message(message, self.machine.coupling_step_s) if message.name else None
            self._take_speed(marked(message, TARGET, RATED, "velocity"))
            self._take_speed(marked(message, TARGET, RATED))
            if sample is not None and sample.asked is not None:
                self._take_effort(sample.asked)
        except MessageError as error:
            self.statistics.count(REJOIN_MOTOR.name, "malformed", str(error))

    def tell_peer(self, peer: str) -> None:
        """Send a restarted linkage its last sample and its configuration."""
        if peer == "linkage":
            self._description_rejoins.send(String(data=self.description))
            self._linkage_rejoins.send(JointState() if self.last_message is None else self.last_message.raw)

    def _obey(self, topic: Topic, take: Callable[[Any], None]) -> None:
        """Subscribe to a command; a refused one is counted with the reason."""

        def receive(message: Any) -> None:
            try:
                take(message)
            except (MessageError, StudyError) as error:
                self.statistics.count(topic.name, "malformed", str(error))

        self.subscribe(topic, receive)

    def _hold(self, message: Float64MultiArray) -> None:
        if len(message.data) != len(HOLD):
            raise MessageError(f"{len(message.data)} numbers; expected {len(HOLD)}: {', '.join(HOLD)}")
        self._take_effort(EffortCommand(0.0, *message.data))

    def _take_effort(self, asked: EffortCommand) -> None:
        check_effort(self.machine, asked)
        self.target = asked

    def _take_speed(self, fraction: float) -> None:
        if not math.isfinite(fraction) or not 0.0 <= fraction <= HIGHEST_COMMAND:
            raise MessageError(f"{fraction} is outside 0 to {HIGHEST_COMMAND}")
        self.target = fraction
        if fraction > 0.0:
            self._asked_target = fraction

    def start(self) -> tuple[bool, str]:
        """Switch the supply on if a forecast shows that the machine starts; the run waits for the forecast."""
        linkage, asked = self.last_question, self._asked_target
        refused = self._forecasts.refusal()
        if refused:
            return False, refused
        with self._forecasts.taking():
            forecast = None if linkage is None else start_forecast(self.machine, linkage, asked)
        if forecast is None or forecast.turns:
            self.target = asked
            return True, f"supply on at {asked:g} of rated frequency"
        why = f"drive at {forecast.position:.6g} would stand still {LOOK_AHEAD_S:g} s after switching on"
        self.get_logger().warning(f"start: {why}")
        self.diagnostics.warn(f"start: {why}")
        return False, f"supply left as it is: {why}"

    def stop(self) -> tuple[bool, str]:
        """Switch the supply off."""
        self.target = 0.0
        return True, "supply off, until a start or the next command"


def _wrench(frame: str, place: int, sample: ForceSample) -> bytes:
    return wrench_bytes(sample.time_s, frame, *sample.wrenches[place])


class ForceNode(FollowerNode):
    """Node of the force role; see `RoleNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("force_analysis", machine_name, parameters, options, force_messages, STEP_LINKAGE, "linkage")
        topics = {pin: pin_wrench(pin) for pin in self.machine.forces.pins}
        space = self.get_namespace()
        self._wrenches = [
            self.peak_hold_output(topic, partial(_wrench, frame_id(space, pin), place))
            for place, (pin, topic) in enumerate(topics.items())
        ]

    def residual_limits(self) -> dict[str, float]:
        """Return the limits of the power balance and similar residuals."""
        return dict(self.machine.forces.residual_limits)

    def answer(self, question: LinkageSample, previous: ForceSample | None) -> ForceSample:
        """Return the forces of the linkage's step."""
        sample = self.machine.forces.analyse(question)
        self.diagnostics.observe(sample.residuals)
        return sample

    def show(self, question: LinkageSample, answer: ForceSample) -> None:
        """Offer the forces to the decimated topics: joint states, and a wrench for each pin."""
        sizes = [wrench_size(wrench) for wrench in answer.wrenches]
        self._states.offer(answer.step, answer, max(sizes, default=0.0), has_impact(question.events))
        for output, size in zip(self._wrenches, sizes, strict=True):
            output.offer(size, answer)


def _pressing_force(frame: str, sample: BodySample) -> bytes:
    return wrench_bytes(sample.time_s, frame, sample.pressing_force_n)


class BodyNode(FollowerNode):
    """Node of the body role; see `RoleNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("body", machine_name, parameters, options, body_messages, STEP_FORCES, "force_analysis")
        self._impacts = self.output(IMPACTS)
        tool = frame_id(self.get_namespace(), TOOL_FRAME)
        self._pressing = self.peak_hold_output(PRESSING_FORCE, partial(_pressing_force, tool))
        self._rejoining = False
        self._rejoin = self.output(REJOIN, recorded=False)
        self.subscribe(REJOIN_BODY, self._on_last_sample)

    @property
    def role(self) -> BodyRole:
        """The body role; raises `ConfigurationError` for a machine without a moving body."""
        if self.machine.body is None:
            name = self.machine.name
            raise ConfigurationError(f"node body: machine {name} has no moving body, its run needs no such node")
        return self.machine.body

    def residual_limits(self) -> dict[str, float]:
        """Return the limits of the differences between linkage and body."""
        return dict(self.role.residual_limits)

    def decoded(self, message: StepMessage) -> ForceSample:
        """Return the force sample of a message."""
        return force_messages.from_message(message, self.machine.coupling_step_s)

    def answer(self, question: ForceSample, previous: BodySample | None) -> BodySample | None:
        """Return the body at the step of these forces; a restarted body first asks for its last sample."""
        given = any(load.kind == RESET and load.contact == GIVEN_STATE for load in question.loads)
        self._rejoining = given or (previous is None and question.step > 0)
        if self._rejoining:
            self._rejoin.send(String(data="body"))
            return None
        sample = next_body(self.role, previous, question)
        self.diagnostics.observe(sample.residuals)
        return sample

    @property
    def marks(self) -> tuple[Row, ...]:
        """The source number; the mark of the configuration is that of the forces answered."""
        return (self.signature,)

    def show(self, question: ForceSample, answer: BodySample) -> None:
        """Publish events, and offer joint states and pressing force to their decimated topics."""
        for event in answer.events:
            self._impacts.send(impacts.to_bytes(event))
        self._states.offer(answer.step, answer, 0.0, has_impact(answer.events) or has_impact(question.loads))
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

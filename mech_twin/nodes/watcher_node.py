"""A node that hears every step message and puts the frames together again: base of the viewer, figures of a run."""

from __future__ import annotations

from typing import Any

from mech_twin.engine.assembly import FrameAssembler
from mech_twin.messages import body as body_messages
from mech_twin.messages import force as force_messages
from mech_twin.messages import linkage as linkage_messages
from mech_twin.messages import motor as motor_messages
from mech_twin.messages.rows import MessageError
from mech_twin.messages.topics import (
    BODY_JOINT_STATES,
    EVERY,
    FORCE_JOINT_STATES,
    JOINT_STATES,
    MOTOR_JOINT_STATES,
    step_topics,
)
from mech_twin.messages.wire import StepMessage
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.role_node import RoleNode
from mech_twin.nodes.run_figures import RunFigures
from mech_twin.quantity import Parameters
from mech_twin.samples import Frame

DECODERS: dict[str, Any] = {
    JOINT_STATES.name: linkage_messages.from_message,
    MOTOR_JOINT_STATES.name: motor_messages.from_message,
    FORCE_JOINT_STATES.name: force_messages.from_message,
    BODY_JOINT_STATES.name: body_messages.from_message,
}


class WatcherNode(RoleNode):
    """Observes a run from its topics; see `RoleNode` for the arguments.

    Parameters
    ----------
    on_topics : bool
        Whether to listen; if not, whoever has the frames calls `show`.
    """

    def __init__(
        self,
        machine_name: str,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
        role: str = "watcher",
        on_topics: bool = True,
    ) -> None:
        super().__init__(role, machine_name, parameters, options)
        has_body = self.machine.body is not None
        self.run_figures = RunFigures(self.machine)
        self._assembler = FrameAssembler(has_body)
        for topic in step_topics(has_body) if on_topics else ():
            self.hear_steps(topic, self._taker(topic.name), qos=EVERY)

    def show(self, frame: Frame) -> None:
        """Take one whole frame into account."""
        self.health.state = "running"
        self.time_s = frame.linkage.time_s
        self.run_figures.observe(frame)

    def _taker(self, name: str) -> Any:
        decoder = DECODERS[name]

        def take(message: StepMessage) -> None:
            try:
                sample = decoder(message, self.machine.coupling_step_s)
            except MessageError as error:
                self.ledger.count(name, "malformed", str(error))
                return
            frame = self._assembler.add(sample)
            if frame is not None:
                self.show(frame)

        return take

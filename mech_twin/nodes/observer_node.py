# SPDX-License-Identifier: Apache-2.0
"""A node that hears every step message and puts the frames together again: base of the viewer, metrics of a run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mech_twin.engine.assembly import OPEN_STEPS, FrameAssembler
from mech_twin.messages import body as body_messages
from mech_twin.messages import force as force_messages
from mech_twin.messages import linkage as linkage_messages
from mech_twin.messages import motor as motor_messages
from mech_twin.messages.joint_state_cdr import StepMessage
from mech_twin.messages.step_marks import source
from mech_twin.messages.step_message import MessageError
from mech_twin.messages.topics import (
    EVERY,
    STEP_BODY,
    STEP_FORCES,
    STEP_LINKAGE,
    STEP_MOTOR,
    step_topics,
)
from mech_twin.nodes.base_node import TwinNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.run_metrics import RunMetrics
from mech_twin.nodes.source_lock import Admission, HeardSource
from mech_twin.parameters.load import catalogue_entry
from mech_twin.quantity import Parameters
from mech_twin.samples import Frame, Sample

FIRST_STEP_S = 1.0  # for what does not say its step, until the linkage has taken one: at time 0 any length does
DECODERS: dict[str, Callable[..., Sample]] = {
    STEP_LINKAGE.name: linkage_messages.from_message,
    STEP_MOTOR.name: motor_messages.from_message,
    STEP_FORCES.name: force_messages.from_message,
    STEP_BODY.name: body_messages.from_message,
}


class ObserverNode(TwinNode):
    """Observes a run from its topics, each from the one publisher that is followed; see `TwinNode` for the arguments.

    A linkage that takes the place of one that is gone, and counts its steps anew, is another run.

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
        name: str = "observer",
        on_topics: bool = True,
    ) -> None:
        super().__init__(name, machine_name, parameters, options)
        self._entry = catalogue_entry(machine_name)
        self.run_metrics = RunMetrics(lambda: self._entry.build(self.initial_parameters))
        self._begin_anew()
        topics = step_topics(self._entry.has_body) if on_topics else ()
        self._sources = {topic.name: HeardSource(self.options.peer_timeout_s) for topic in topics}
        for topic in topics:
            self.subscribe_steps(topic, partial(self._on_step, topic.name), qos=EVERY)

    def show(self, frame: Frame) -> None:
        """Take one whole frame into account."""
        self.diagnostics.state = "running"
        self.time_s = frame.linkage.time_s
        self.run_metrics.observe(frame)

    def _begin_anew(self) -> None:
        self.run_metrics.begin_anew()  # the same one: a status line looks at it
        self.newest_step, self.newest_s = -1, 0.0
        self._step_s = FIRST_STEP_S
        self._assembler = FrameAssembler(self._entry.has_body)

    def _decoded(self, name: str, message: StepMessage) -> Sample:
        return DECODERS[name](message, self._step_s)

    def _on_step(self, name: str, message: StepMessage) -> None:
        try:
            sample = self._decoded(name, message)
        except MessageError as error:
            self.statistics.count(name, "malformed", str(error))
            return
        admission = self._sources[name].admit(source(message), lambda: self.count_publishers(name) <= 1)
        if admission is Admission.REFUSED:
            reason = f"step {sample.step} from another publisher than the one that is followed"
            self.statistics.count(name, "unknown_source", reason)
            return
        if name == STEP_LINKAGE.name:
            self._follow(sample, admission)
        frame = self._assembler.add(sample)
        if frame is not None:
            self.show(frame)

    def _follow(self, linkage: Sample, admission: Admission) -> None:
        """Take note of where the run is; one that goes on from further back than can be waited for is another."""
        if admission is Admission.NEWLY_FOLLOWED and linkage.step < self.newest_step - OPEN_STEPS:
            self._begin_anew()
        self.newest_step, self.newest_s = linkage.step, linkage.time_s
        if linkage.step > 0:
            self._step_s = linkage.time_s / linkage.step

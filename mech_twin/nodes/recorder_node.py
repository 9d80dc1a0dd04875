# SPDX-License-Identifier: Apache-2.0
"""The recorder node: every topic of a machine, raw, to an MCAP recording."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from mech_twin.messages.joint_state_cdr import CdrError
from mech_twin.messages.step_head import StepHeadReader
from mech_twin.messages.step_message import MessageError
from mech_twin.messages.topics import (
    EVERY,
    EVERY_LATCHED,
    FRAMES,
    LATCHED,
    ROBOT_DESCRIPTION,
    STEP_LINKAGE,
    WRENCHES,
    Topic,
    pin_wrench,
    recorded_topics,
    step_topics,
    type_name,
)
from mech_twin.nodes.base_node import TwinNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.recording_clock import RecordingClock
from mech_twin.nodes.source_lock import Admission, HeardSource
from mech_twin.nodes.step_sequence import StepSequence
from mech_twin.parameters.load import catalogue_entry, description_text
from mech_twin.quantity import Parameters
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.schemas import offered_qos
from mech_twin.recording.stamps import stamp_ns

TICK_S = 0.1
TICKS_PER_LOSS = 0.2
MIB = 1024.0 * 1024.0


class StepInput:
    """One topic of step messages: how they are read, who is followed, which step was the last."""

    def __init__(self, silence_s: float) -> None:
        self.read = StepHeadReader()
        self.source = HeardSource(silence_s)
        self.sequence = StepSequence()


class RecorderNode(TwinNode):
    """Writes what it hears; the log time of a message is the simulated time at which it came.

    Time and gaps are those of the publishers that are followed, one per topic of step messages, and the linkage's lead.
    The topics of the pins are found on the graph, so that nothing of the machine need be built.

    Parameters
    ----------
    directory : Path
        The recording to make.  See `TwinNode` for the other arguments.
    """

    def __init__(
        self,
        machine_name: str,
        directory: Path,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
    ) -> None:
        super().__init__("recorder", machine_name, parameters, options)
        self.writer = BagWriter(
            directory,
            configuration=description_text(machine_name, self.initial_parameters),
            max_loss_s=self.options.max_loss_s,
            fsync=self.options.fsync,
            split_bytes=round(self.options.split_mib * MIB),
            split_duration_s=self.options.split_s or None,
        )
        self._last_heard_s = time.monotonic()
        self._time = RecordingClock()
        has_body = catalogue_entry(machine_name).has_body
        self._steps = {topic.name: StepInput(self.options.peer_timeout_s) for topic in step_topics(has_body)}
        self._recorded: set[str] = set()
        self._optional = {self.resolve_topic_name(topic.name): topic for topic in (FRAMES, ROBOT_DESCRIPTION)}
        self._wrench_prefix = self.resolve_topic_name(WRENCHES) + "/"
        try:
            for topic in recorded_topics((), has_body):
                self._record(topic)
            self.every(min(TICK_S, TICKS_PER_LOSS * self.options.max_loss_s), self._tick)
        except BaseException:  # a signal, too: what is on the disk is closed
            self.writer.close()
            raise

    @property
    def received(self) -> dict[str, int]:
        """Messages heard, by full topic name."""
        return {name: row.received for name, row in self.writer.counters.items()}

    def quiet_s(self) -> float:
        """Return for how long nothing has come to be recorded."""
        return time.monotonic() - self._last_heard_s

    def diagnostic_values(self) -> dict[str, str]:
        """Return the state of the writer, with which step it begins, and what it dropped."""
        counters = self.writer.counters.values()
        first = self._steps[STEP_LINKAGE.name].sequence.first
        return {
            "recording": str(self.writer.directory),
            "first step": "-" if first is None else str(first),
            "written": str(sum(row.written for row in counters)),
            "dropped": str(sum(row.dropped for row in counters)),
            "missed": str(sum(row.missed for row in counters)),
        }

    def close(self) -> None:
        """Finish the recording; one in which nothing was recorded is deleted."""
        self.writer.close(discard_empty=True)

    # -- topics -----------------------------------------------------------------------------------------------------

    def _record(self, topic: Topic) -> None:
        name = self.resolve_topic_name(topic.name)
        self._recorded.add(name)
        latched = topic.qos is LATCHED
        durability = "transient_local" if latched else "volatile"
        self.writer.add_topic(name, type_name(topic), offered_qos(durability=durability, depth=topic.qos.depth))
        call = (
            partial(self._on_step, topic, name, self._steps[topic.name])
            if topic.name in self._steps
            else partial(self._on_message, topic, name, latched)
        )
        self.create_subscription(topic.type, topic.name, call, EVERY_LATCHED if latched else EVERY, raw=True)

    def _record_found(self) -> None:
        """Record the pins' topics that have appeared, and those of a node of frames."""
        kind = type_name(pin_wrench("any"))
        for name, types in self.get_topic_names_and_types():
            if name.startswith(self._wrench_prefix) and name not in self._recorded and kind in types:
                self._record(pin_wrench(name.removeprefix(self._wrench_prefix)))
            elif name in self._optional and name not in self._recorded and type_name(self._optional[name]) in types:
                self._record(self._optional[name])

    # -- messages ---------------------------------------------------------------------------------------------------

    def _on_message(self, topic: Topic, name: str, latched: bool, raw: bytes) -> None:
        self._last_heard_s = time.monotonic()
        stamp = stamp_ns(type_name(topic), raw)
        if stamp is not None and not self._time.belongs(stamp):
            self._count_stamp(topic, stamp)
        self._write(name, raw, self._time.now_ns, latched)

    def _on_step(self, topic: Topic, name: str, of_topic: StepInput, raw: bytes) -> None:
        self._last_heard_s = time.monotonic()
        try:
            head = of_topic.read(raw)
        except (CdrError, MessageError) as error:
            self.statistics.count(topic.name, "malformed", str(error))
            self._write(name, raw, self._time.now_ns)
            return
        if not self._is_followed(topic, of_topic, head.source):
            self.statistics.count(topic.name, "unknown_source", "another publisher than the one that is followed")
            self._write(name, raw, self._time.now_ns)
            return
        self._write(name, raw, self._time_of(topic, head.stamp_ns))
        if head.step is not None:
            self._check_sequence(topic, name, of_topic.sequence, head.step)

    def _is_followed(self, topic: Topic, of_topic: StepInput, who: float) -> bool:
        """Return whether the run is this publisher's."""
        return of_topic.source.admit(who, lambda: self.count_publishers(topic.name) <= 1) is not Admission.REFUSED

    def _time_of(self, topic: Topic, stamp: int) -> int:
        """Return the log time of a step that is followed: its stamp, where it is a time of this run."""
        if self._time.lead(stamp) if topic == STEP_LINKAGE else self._time.belongs(stamp):
            return stamp
        self._count_stamp(topic, stamp)
        return self._time.now_ns

    def _count_stamp(self, topic: Topic, stamp: int) -> None:
        reason = f"stamp {stamp * 1e-9:g} s is no time of this run; recorded at {self._time.now_ns * 1e-9:g} s"
        self.statistics.count(topic.name, "unknown_source", reason)

    def _check_sequence(self, topic: Topic, name: str, sequence: StepSequence, step: int) -> None:
        fault = sequence.take(step)
        if fault is None:
            return
        if fault.kind == "missing":
            self.writer.count_missed(name, fault.number)
        else:
            self.writer.count_late(name)
        self.statistics.count(topic.name, fault.kind, fault.reason, fault.number)

    def _write(self, name: str, raw: bytes, at_ns: int, latched: bool = False) -> None:
        self.writer.write(name, raw, at_ns, at_ns, latched=latched)

    def _tick(self) -> None:
        self._record_found()
        self.time_s = self._time.now_ns * 1e-9
        self.writer.tick()
        self.diagnostics.state = self.writer.state.value
        if self.writer.state is WriterState.ERROR:
            self.diagnostics.error(self.writer.error)

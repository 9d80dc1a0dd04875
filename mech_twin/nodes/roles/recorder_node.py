# SPDX-License-Identifier: Apache-2.0
"""The recorder node: every topic of a machine, raw, to an MCAP recording.

The time of a recording is that of the newest step of the followed run; missing, repeated and late messages are counted
for each topic.
"""

import math
import time
from collections import Counter
from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_srvs.srv import Trigger

from mech_twin.declarations.quantity import Parameters
from mech_twin.messages.cdr import CdrError, Stamp, received_message, stamp_of
from mech_twin.messages.step_message import SOURCE, MessageError, marked, step_index
from mech_twin.messages.topics import (
    BLOW_GAUGE,
    BLOW_WAVE,
    CLOCK,
    DIAGNOSTICS,
    EVERY,
    EVERY_LATCHED,
    FRAMES,
    LATCHED,
    OWN_CLOCK,
    ROBOT_DESCRIPTION,
    STEP_LINKAGE,
    WRENCHES,
    Topic,
    pin_wrench,
    recorded_topics,
    step_topics,
    type_name,
)
from mech_twin.nodes.exchange.base_node import RunOptions, TwinNode
from mech_twin.nodes.exchange.counting import StepSequence
from mech_twin.nodes.exchange.direct_exchange import Handed, HandedStep, Listener, ReceivedBytes
from mech_twin.nodes.exchange.parameter_bridge import offer
from mech_twin.nodes.exchange.peers import Admission, HeardSource, LivingPublishers
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import catalogue_entry
from mech_twin.process.interruption import closed_first
from mech_twin.recording.bag_contents import RecentMessage, RecentMessages, stamp_ns
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.errors import DecodeError
from mech_twin.recording.schemas import decoded, offered_qos

NS_PER_S = 1_000_000_000
LARGEST_NS = 10**9 * NS_PER_S  # more than 30 years of simulated time must be a wall clock
SAME_RUN_NS = 10 * NS_PER_S
TICK_S = 0.1
QUIET_S, QUIET_LIMIT_S = 0.15, 4.0  # silence that ends a recording; longest wait for it if others keep publishing
REPAIR_S, REPAIR_LIMIT_S = 3.2, 8.0  # the middleware sends lost messages again within 3 s, and may lose them again
LOOK_S = 1.0  # period of graph queries once the run has begun; querying all topics and publishers is slow
TICKS_PER_LOSS = 0.2
MIB = 1024.0 * 1024.0
UNDER_WAY = 2  # steps that not every role has answered yet
COPIED = "copied_source"  # subtopic of a step topic: messages with the source number of a node that did not send them
OPTIONAL = (FRAMES, ROBOT_DESCRIPTION, BLOW_GAUGE, BLOW_WAVE)  # recorded if published


class RecordingClock:
    """Log time of the recording: the time of the run; a run after another goes on from the end of that one."""

    def __init__(self) -> None:
        self._now_ns: int | None = None
        self._begun_ns = 0

    @property
    def run_ns(self) -> int:
        """Time of the newest step (ns); 0 before the first."""
        return 0 if self._now_ns is None else self._now_ns

    @property
    def now_ns(self) -> int:
        """Log time of the newest step (ns); 0 before the first."""
        return self.log_ns(self.run_ns)

    def log_ns(self, stamp_ns: int) -> int:
        """Return the log time of a stamp of this run (ns)."""
        return self._begun_ns + stamp_ns

    def begin_run(self, stamp_ns: int) -> None:
        """Let the log time go on, whatever the first stamp of a new run is."""
        self._begun_ns = self.now_ns - stamp_ns

    def lead(self, stamp_ns: int) -> bool:
        """Set the time to that of the linkage's step (ns); return whether it is plausible."""
        plausible = 0 <= stamp_ns < LARGEST_NS
        if plausible:
            self._now_ns = stamp_ns
        return plausible

    def belongs(self, stamp_ns: int) -> bool:
        """Return whether a stamp (ns) is near the time of the run; before the first step any plausible one is."""
        if self._now_ns is None:
            return 0 <= stamp_ns < LARGEST_NS
        return stamp_ns >= 0 and abs(stamp_ns - self._now_ns) <= SAME_RUN_NS


class StepInput:
    """One topic of step messages: its full name, the followed publisher and the last step."""

    def __init__(self, topic: Topic, name: str, silence_s: float) -> None:
        self.topic, self.name = topic, name
        self.source = HeardSource(silence_s)
        self.sequence = StepSequence()
        self.before = 0  # messages received in earlier runs
        self.publishers = LivingPublishers()
        self.living = 0
        self.matched = 0
        self.listener: Listener | None = None


class RecorderNode(TwinNode):
    """Records the messages received; the log time of a message is the simulated time of its arrival.

    Time and gaps are those of the followed publishers, one per topic of step messages; the linkage sets the time.
    The topics of the pins are found on the ROS graph, so that the machine need not be built.

    Parameters
    ----------
    directory : path
        The recording to make.  See `TwinNode` for the other arguments.
    """

    def __init__(
        self,
        machine_name: str,
        directory: Path | str,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
    ) -> None:
        super().__init__("recorder", machine_name, parameters, options)
        self._closed = False
        self._last_received_s = self._flushed_s = time.monotonic()
        self._looked_s = -math.inf
        self._time = RecordingClock()
        self._recent = RecentMessages(self.options.snapshot_s) if self.options.snapshot_s > 0.0 else None
        self._latched: list[RecentMessage] = []  # heard since the last snapshot
        self._alarms: set[str] = set()
        self._snapshots = 0
        offer(self, Trigger, "~/snapshot", lambda _: self.snapshot())
        has_body = catalogue_entry(machine_name).has_body
        self._steps = {
            topic.name: StepInput(topic, self.resolve_topic_name(topic.name), self.options.peer_timeout_s)
            for topic in step_topics(has_body)
        }
        self._recorded: set[str] = set()
        self._optional = {self.resolve_topic_name(topic.name): topic for topic in OPTIONAL}
        self._wrench_prefix = self.resolve_topic_name(WRENCHES) + "/"
        with closed_first():
            self.writer = BagWriter(
                Path(directory),
                configuration=description_text(machine_name, self.initial_parameters),
                max_loss_s=self.options.max_loss_s,
                fsync=self.options.fsync,
                split_bytes=round(self.options.split_mib * MIB),
                split_duration_s=self.options.split_s or None,
            )
            try:
                for topic in recorded_topics((), has_body):
                    self._record(topic)
                self.every(min(TICK_S, TICKS_PER_LOSS * self.options.max_loss_s), self._tick)
            except BaseException:  # a signal, too
                self.close()
                raise

    @property
    def received(self) -> dict[str, int]:
        """Number of messages received, by full topic name."""
        kept = Counter() if self._recent is None else self._recent.received
        return {name: max(row.received, kept[name]) for name, row in self.writer.counters.items()}

    def settled(self) -> bool:
        """Return whether every message sent before `flush` has arrived, or waiting longer is useless.

        While a publisher of steps lives, lost messages may be sent again.  A topic lags until its first message: a
        recorder may be matched before it receives.
        """
        now_s = time.monotonic()
        connected = [each for each in self._steps.values() if each.listener is not None and each.listener.publishers()]
        newest = max((each.sequence.last or 0 for each in self._steps.values()), default=0)
        if any(each.sequence.last is None or newest - each.sequence.last > UNDER_WAY for each in connected):
            return now_s - self._flushed_s > REPAIR_LIMIT_S
        silent = now_s - self._last_received_s > (REPAIR_S if connected else QUIET_S)
        return silent or now_s - self._flushed_s > QUIET_LIMIT_S

    def flush(self) -> None:
        """Publish held messages, and restart the measurement of silence to receive those sent before the end."""
        super().flush()
        self._last_received_s = self._flushed_s = time.monotonic()

    def diagnostic_values(self) -> dict[str, str]:
        """Return the state of the writer, its first step, and the dropped messages."""
        counters = self.writer.counters.values()
        first = self._steps[STEP_LINKAGE.name].sequence.first
        return {
            "recording": str(self.writer.directory),
            "first step": "-" if first is None else str(first),
            "written": str(sum(row.written for row in counters)),
            "dropped": str(sum(row.dropped for row in counters)),
            "missed": str(sum(row.missed for row in counters)),
            **({} if self._recent is None else {"snapshots": str(self._snapshots)}),
        }

    def report(self) -> None:
        """Publish the diagnostics of the window that ends now, and name step topics with several publishers.

        Messages that copy the source number of the followed publisher are recorded separately, if the middleware
        numbers messages.
        """
        for topic, of_topic in self._steps.items():
            if of_topic.living > 1:
                names = ", ".join(sorted(name for name, _ in self._known_publishers(of_topic)))
                self.diagnostics.warn(f"{topic} is published by {names}: the first to sign is followed")
        super().report()

    def close(self) -> None:
        """Finish the recording; one in which nothing was recorded is deleted."""
        if not self._closed:
            self._count_behind()
        self._closed = True
        self.writer.close(discard_empty=True)

    def _count_behind(self) -> None:
        """Count as missed what a topic with a publisher lacks at the end: roles are at most `UNDER_WAY` steps apart."""
        published = {name for name, row in self.writer.counters.items() if row.publishers}
        inputs = [each for each in self._steps.values() if each.name in published]
        begun = min((each.sequence.first for each in inputs if each.sequence.first is not None), default=0)
        newest = max((each.sequence.last for each in inputs if each.sequence.last is not None), default=0)
        for each in inputs:
            last = each.sequence.last
            numbered = 0 if last is None else last - begun + 1  # a user's node may number none
            missed = newest - begun + 1 - max(numbered, self.received[each.name] - each.before) - UNDER_WAY
            self.writer.count_missed(each.name, max(0, missed))

    # -- topics -----------------------------------------------------------------------------------------------------

    def _record(self, topic: Topic) -> None:
        name = self.resolve_topic_name(topic.name)
        self._recorded.add(name)
        latched = topic.qos is LATCHED
        durability = "transient_local" if latched else "volatile"
        self.writer.add_topic(name, type_name(topic), offered_qos(durability=durability, depth=topic.qos.depth))
        source = OWN_CLOCK if topic is CLOCK else topic  # ``/clock`` may be of another machine
        if topic.name in self._steps:
            of_topic = self._steps[topic.name]
            handed, received = (partial(call, of_topic) for call in (self._on_handed, self._on_step))
            of_topic.listener = self.listen(topic, handed, received, patient=True, qos=EVERY)
        else:
            received = partial(self._on_message, topic, name, latched)
            self.listen(source, received, received, patient=True, qos=EVERY_LATCHED if latched else EVERY)

    def _record_found(self) -> None:
        """Record new topics of pins, and those of a frames node."""
        kind = type_name(pin_wrench("any"))
        for name, types in self.get_topic_names_and_types():
            if name.startswith(self._wrench_prefix) and name not in self._recorded and kind in types:
                self._record(pin_wrench(name.removeprefix(self._wrench_prefix)))
            elif name in self._optional and name not in self._recorded and type_name(self._optional[name]) in types:
                self._record(self._optional[name])

    # -- messages ---------------------------------------------------------------------------------------------------

    def _on_message(self, topic: Topic, name: str, latched: bool, received: Handed | ReceivedBytes) -> None:
        raw = received.raw
        if topic is not DIAGNOSTICS:  # a node sends them even if it does nothing
            self._last_received_s = time.monotonic()
        stamp = stamp_ns(type_name(topic), raw)
        if stamp is not None and not self._time.belongs(stamp) and not (topic is DIAGNOSTICS and self._of_another(raw)):
            self._count_stamp(topic, stamp)
        self._write(name, raw, self._time.now_ns, latched)
        if topic is DIAGNOSTICS and self._recent is not None:
            self._heed_alarms(raw)

    def _on_handed(self, of_topic: StepInput, step: HandedStep) -> None:
        self._last_received_s = time.monotonic()
        stamp, number = stamp_of(step.sample.time_s), step.sample.step
        self._record_step(of_topic, stamp, number, step.source, step.raw)

    def _on_step(self, of_topic: StepInput, received: ReceivedBytes) -> None:
        self._last_received_s = time.monotonic()
        raw = received.raw
        try:
            message = received_message(raw)
            number, who = step_index(message), marked(message, SOURCE)
        except (CdrError, MessageError) as error:
            self.statistics.count(of_topic.topic.name, "malformed", str(error))
            self._write(of_topic.name, raw, self._time.now_ns)
            return
        if of_topic.listener is None or of_topic.listener.believed(who, received) == who:
            self._record_step(of_topic, message.header.stamp, number, who, raw)
        else:
            self._record_copy(of_topic.topic, f"{of_topic.name}/{COPIED}", raw)

    def _record_copy(self, topic: Topic, name: str, raw: bytes) -> None:
        """Record a message with a copied source number on a separate topic, so that it is not taken for the node's."""
        self.statistics.count(topic.name, "unknown_source", "another publisher copied the number of a node")
        self.writer.add_topic(name, type_name(topic), offered_qos(durability="volatile", depth=topic.qos.depth))
        self._write(name, raw, self._time.now_ns)

    def _record_step(self, of_topic: StepInput, stamp: Stamp, step: int | None, who: float, raw: bytes) -> None:
        topic, name = of_topic.topic, of_topic.name
        admission = of_topic.source.admit(who, lambda: self.count_publishers(topic.name) <= 1)
        if admission is Admission.REFUSED:
            self.statistics.count(topic.name, "unknown_source", "another publisher than the one that is followed")
            self._write(name, raw, self._time.now_ns)
            return
        at_ns, last = stamp.sec * NS_PER_S + stamp.nanosec, of_topic.sequence.last or 0
        back = step is not None and 0 <= step < last - UNDER_WAY  # a linkage that rejoins repeats its last steps
        if topic == STEP_LINKAGE and admission is Admission.NEWLY_FOLLOWED and back:
            self._time.begin_run(at_ns)
            for each in self._steps.values():
                each.sequence, each.before = StepSequence(), self.received[each.name]
        self._write(name, raw, self._time_of(topic, at_ns))
        fault = None if step is None else of_topic.sequence.take(step)
        if fault is not None:
            if fault.kind == "missing":
                self.writer.count_missed(name, fault.number)
            elif fault.kind == "late":  # a waiting run repeats its step, which loses nothing
                self.writer.count_late(name)
            self.statistics.count(topic.name, fault.kind, fault.reason, fault.number)

    def _time_of(self, topic: Topic, stamp: int) -> int:
        """Return the log time (ns) of a step of the followed run: that of its stamp, if that is a time of this run."""
        if self._time.lead(stamp) if topic == STEP_LINKAGE else self._time.belongs(stamp):
            return self._time.log_ns(stamp)
        self._count_stamp(topic, stamp)
        return self._time.now_ns

    def _count_stamp(self, topic: Topic, stamp: int) -> None:
        reason = f"stamp {stamp * 1e-9:g} s is no time of this run; recorded at {self._time.now_ns * 1e-9:g} s"
        self.statistics.count(topic.name, "unknown_source", reason)

    def _write(self, name: str, raw: bytes, at_ns: int, latched: bool = False) -> None:
        if self._closed:  # messages after the end belong to no recording
            return
        if self._recent is None:
            self.writer.write(name, raw, at_ns, at_ns, latched=latched)
        elif latched:
            self._latched.append(RecentMessage(name, raw, at_ns))
        else:
            self._recent.take(RecentMessage(name, raw, at_ns))

    # -- snapshots of the last seconds ------------------------------------------------------------------------------

    def snapshot(self) -> tuple[bool, str]:
        """Write the messages of the last seconds; return whether there are any, and a line on them.

        Latched ones from before them are written at their start, so that the recording begins there.
        """
        if self._recent is None:
            return False, "run.snapshot_s is 0: everything is recorded"
        messages = self._recent.released()
        if not messages:
            return False, "nothing was heard since the start or the last snapshot"
        begin_ns, end_ns = messages[0].at_ns, messages[-1].at_ns
        for message in self._latched:  # one that came later than all is of a run before, whose time was another
            at_ns = message.at_ns if begin_ns <= message.at_ns <= end_ns else begin_ns
            self.writer.write(message.topic, message.raw, at_ns, message.at_ns, latched=True)
        self._latched.clear()
        for message in messages:
            self.writer.write(message.topic, message.raw, message.at_ns, message.at_ns)
        self._snapshots += 1
        span = (messages[-1].at_ns - messages[0].at_ns) * 1e-9
        return True, f"{len(messages)} messages of the last {span:.3g} s written to {self.writer.directory}"

    def _is_own(self, status: DiagnosticStatus) -> bool:
        return bool(status.name.startswith(f"{self.get_namespace().rstrip('/')}/"))

    def _of_another(self, raw: bytes) -> bool:
        """Return whether diagnostics are of another machine of the domain, which has times of its own."""
        statuses = _statuses(raw)
        return bool(statuses) and not any(map(self._is_own, statuses))

    def _heed_alarms(self, raw: bytes) -> None:
        """Write the messages of the last seconds when a status of this machine becomes an error."""
        own = [status for status in _statuses(raw) if self._is_own(status)]
        alarms = {status.name for status in own if status.level == DiagnosticStatus.ERROR}
        new = alarms - self._alarms
        self._alarms = (self._alarms | alarms) - {status.name for status in own if status.name not in alarms}
        if new:
            self.get_logger().warning(f"{', '.join(sorted(new))}: alarm; {self.snapshot()[1]}")

    def _tick(self) -> None:
        now_s = time.monotonic()
        begun = self._steps[STEP_LINKAGE.name].sequence.first is not None  # its nodes wait until all is recorded
        due = not begun or now_s - self._looked_s >= LOOK_S
        if due:
            self._looked_s = now_s
            self._record_found()
        for of_topic in self._steps.values():
            matched = 0 if of_topic.listener is None else of_topic.listener.publishers()
            if due or matched != of_topic.matched:
                of_topic.matched = matched
                of_topic.living = of_topic.publishers.living(self._known_publishers(of_topic), now_s)
                self.writer.count_publishers(of_topic.name, of_topic.living)
        self.time_s = self._time.run_ns * 1e-9
        self.writer.tick()
        self.diagnostics.state = self.writer.state.value
        if self.writer.state is WriterState.ERROR:
            self.diagnostics.error(self.writer.error)

    def _known_publishers(self, of_topic: StepInput) -> list[tuple[str, bytes]]:
        """Return full node name and endpoint of each publisher of a step topic."""
        known = self.get_publishers_info_by_topic(of_topic.name)
        return [(f"{each.node_namespace}/{each.node_name}", bytes(each.endpoint_gid)) for each in known]


def _statuses(raw: bytes) -> list[DiagnosticStatus]:
    """Return the statuses of diagnostics; none of bytes that are no such message."""
    try:
        return list(decoded(raw, DiagnosticArray).status)
    except DecodeError:
        return []

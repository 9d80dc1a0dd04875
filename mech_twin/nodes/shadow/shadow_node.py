# SPDX-License-Identifier: Apache-2.0
"""The shadow node: follows a machine's topics with the state observer, and publishes the estimates.

It subscribes to the machine's topics and publishes below ``twin``, never on the machine's topics.  It takes no part in
the exchange of steps.  It publishes states, residuals and virtual sensors with their standard deviations.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from math import nan
from typing import Any, NamedTuple

import numpy as np
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64

from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.sample_vectors import Array
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.units import is_event, joint_column, leading_in, sliding_in
from mech_twin.messages import impacts
from mech_twin.messages.cdr import CdrError, Header, Stamp, StepMessage, encoded, wrench_bytes
from mech_twin.messages.topics import (
    DETECTED_IMPACTS,
    ESTIMATED,
    RESIDUALS,
    SPEED_COMMAND,
    VIRTUAL_DRIVE,
    VIRTUAL_PRESSING_FORCE,
    Topic,
    sigma_of,
    virtual_pin,
)
from mech_twin.nodes.exchange.base_node import RunOptions, TwinNode, with_info
from mech_twin.nodes.exchange.counting import CountingPublisher
from mech_twin.nodes.exchange.direct_exchange import ReceivedBytes
from mech_twin.nodes.shadow.inputs import (
    COMMAND,
    FollowedTopic,
    ReceivedValues,
    StampGate,
    StampOrigin,
    events_last,
    followed_topics,
    own_map,
    sensed_channels,
)
from mech_twin.parameters.load import catalogue_entry
from mech_twin.recording.measured_topics import SECOND_NS
from mech_twin.roles import Machine
from mech_twin.samples import Event
from mech_twin.studies.observer.estimate import FrameEstimate, ObserverState, SeenSample, SensedChannel
from mech_twin.studies.observer.model_run import held_sigma
from mech_twin.studies.observer.observer import PhaseLockedObserver

PRESSING_FORCE_COLUMN = "body.pressing_force_n"
FIELDS = ("position", "velocity", "effort")
Output = Callable[[Topic], CountingPublisher]


class VirtualSensor(NamedTuple):
    """One virtual sensor: its publisher and that of its sigma, and the indices of force x, force y and moment."""

    value: CountingPublisher
    sigma: CountingPublisher
    frame: str
    places: tuple[int | None, ...]


def joint_places(columns: Mapping[str, int]) -> tuple[tuple[str, ...], list[list[int]]]:
    """Return the joints of a machine, each once, and the indices of their positions, velocities and efforts in a row.

    For joints of a body its own values are used, not the linkage's copy.
    """
    found: dict[str, str] = {}
    for role in ("body", "linkage", "motor"):
        for column in columns:
            parts = joint_column(column)
            if parts is not None and parts.role == role and parts.field == "position":
                found.setdefault(parts.joint, role)
    return tuple(found), [[columns[f"{role}.{joint}.{field}"] for joint, role in found.items()] for field in FIELDS]


class ShadowOutputs:
    """Publishers of a shadow.

    Parameters
    ----------
    output : callable
        Returns a counted publisher.
    machine : Machine
        The model.
    columns : mapping
        Indices in a row by column.
    namespace : str
        Prefix of the frames of the wrenches.
    stamp : callable
        Returns the stamp of a time.
    """

    def __init__(
        self,
        output: Output,
        machine: Machine,
        columns: Mapping[str, int],
        namespace: str,
        stamp: Callable[[float], Stamp],
    ) -> None:
        self._stamp = stamp
        self._joints, self._places = joint_places(columns)
        self._columns = columns
        self._estimated, self._sigma = output(ESTIMATED), output(sigma_of(ESTIMATED))
        self._residuals, self._impacts = output(RESIDUALS), output(DETECTED_IMPACTS)
        frames = f"{namespace.removeprefix('/')}/"
        self._virtual: list[VirtualSensor] = []
        for pin in machine.forces.pins:
            places = [columns.get(f"forces.{pin}.{name}") for name in ("force_x_n", "force_y_n", "moment_nm")]
            self._add(output, virtual_pin(pin), frames + pin, *places)
        first = leading_in(machine)
        drive = columns[f"linkage.{first}.effort"]
        by_force = first in sliding_in(machine)
        self._add(output, VIRTUAL_DRIVE, frames + first, drive if by_force else None, None, None if by_force else drive)
        if machine.body is not None:
            self._add(output, VIRTUAL_PRESSING_FORCE, f"{frames}tool", columns[PRESSING_FORCE_COLUMN], None, None)

    def _add(self, output: Output, topic: Topic, frame: str, *places: int | None) -> None:
        self._virtual.append(VirtualSensor(output(topic), output(sigma_of(topic)), frame, places))

    def send_joints(self, time_s: float, row: Array, sigma: Array) -> None:
        """Publish the joints, unmeasured ones too; unknown values are NaN."""
        self._estimated.send(encoded(self._joint_message(time_s, row)))
        self._sigma.send(encoded(self._joint_message(time_s, sigma)))

    def send_residuals(self, estimate: FrameEstimate, channels: tuple[SensedChannel, ...]) -> None:
        """Publish measured minus predicted values of a sample's channels; unmeasured fields are NaN."""
        rows: dict[str, dict[str, float]] = {}
        for place, value in zip(estimate.channels, estimate.innovations, strict=True):
            parts = joint_column(channels[place].column)
            name, field = (parts.joint, parts.field) if parts else (channels[place].column, "effort")
            rows.setdefault(name, {})[field] = value
        position, velocity, effort = (tuple(row.get(field, nan) for row in rows.values()) for field in FIELDS)
        header = Header(self._stamp(estimate.time_s))
        self._residuals.send(encoded(StepMessage(header, tuple(rows), position, velocity, effort)))

    def send_virtual(self, time_s: float, row: Array, sigma: Array) -> None:
        """Publish the wrenches of the virtual sensors, and their sigma."""
        for sensor in self._virtual:
            sensor.value.send(_wrench(self._stamp(time_s), sensor, row))
            sensor.sigma.send(_wrench(self._stamp(time_s), sensor, sigma))

    def send_impacts(self, events: tuple[Event, ...]) -> None:
        """Publish the events with an impulse."""
        for event in events:
            if event.impulse_ns != 0.0:
                self._impacts.send(impacts.to_bytes(event, self._stamp(event.time_s)))

    def _joint_message(self, time_s: float, row: Array) -> StepMessage:
        position, velocity, effort = (tuple(row[of_field].tolist()) for of_field in self._places)
        return StepMessage(Header(self._stamp(time_s)), self._joints, position, velocity, effort)


def _wrench(stamp: Stamp, sensor: VirtualSensor, row: Array) -> bytes:
    return wrench_bytes(stamp, sensor.frame, *(0.0 if place is None else float(row[place]) for place in sensor.places))


# best effort matches both kinds of publishers; messages that are lost on the way or not taken in time are counted
FOLLOWED = QoSProfile(
    depth=2000,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
COUNTED_AS = {"late": "late", "repeated": "repeated", "jump": "early", "unbelievable": "conflicting"}
LATENCIES = 1000  # newest samples of which the median is taken


class ShadowSetup(NamedTuple):
    """Setup of a shadow: namespace, map (None: the twin's own topics), standard deviations of uncertain keys."""

    namespace: str
    given: MeasurementMap | None = None
    deviations: Mapping[str, float] | None = None


class Wait(NamedTuple):
    """When a message was taken (s of the steady clock) and received (s of the middleware's clock), and its wait (s)."""

    taken_s: float
    received_s: float
    waited_s: float


class ReceivedMessage(NamedTuple):
    """Contents of a message of the machine, its topic, when it was taken (s of the steady clock), its wait (s)."""

    followed: FollowedTopic
    contents: ReceivedValues
    arrived_s: float
    waited_s: float


class ShadowNode(TwinNode):
    """Follows one machine; see `TwinNode` for the other arguments.

    Parameters
    ----------
    setup : ShadowSetup
        The machine to follow.
    """

    def __init__(
        self,
        machine_name: str,
        setup: ShadowSetup,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
    ) -> None:
        super().__init__("shadow", machine_name, parameters, options)
        entry = catalogue_entry(machine_name)
        self.model = self.initial_parameters
        machine = entry.build(self.model)
        given = events_last(setup.given) if setup.given else own_map(machine)
        sensed = sensed_channels(given)
        self.columns = tuple(channel.column for channel in sensed)
        self._sensed = [channel for channel in sensed if not is_event(channel.column)]
        self.channels = given.channels
        self.level = "model"
        self.setup = setup
        self.is_obeyed: Callable[[], bool] = lambda: False
        self.at_message: list[Callable[[str, ReceivedBytes], None]] = []
        self.at_sample: list[Callable[[SeenSample], None]] = []
        self.on_estimate: Callable[[SeenSample, FrameEstimate], None] = lambda sample, estimate: None
        self.at_other_time: list[Callable[[], None]] = []
        self.at_command: list[Callable[[float], None]] = []
        self.observer = PhaseLockedObserver(machine, entry.build, self._sensed, setup.deviations)
        self.estimate: FrameEstimate | None = None
        self._counted: dict[str, int] = {}
        self._latencies_s: deque[float] = deque(maxlen=LATENCIES)
        self._waits: dict[str, Wait] = {}
        self._sequence: dict[str, int] = {}  # newest sequence number by topic
        self._publisher_counts: dict[str, Callable[[], int]] = {}
        self._received_s: float | None = None
        self._listens_from_s = time.monotonic()
        self._stale = False
        self._next_virtual_s = -np.inf
        columns = self.observer.columns
        self.origin = StampOrigin()
        self.admission = StampGate[ReceivedMessage]()
        self._jumps = 0
        output = partial(self.output, recorded=False)
        self._outputs = ShadowOutputs(output, machine, columns, self.get_namespace(), self.origin.stamp)
        self._command = next((i for i, channel in enumerate(given.channels) if channel.quantity == COMMAND), None)
        self.followed = followed_topics(given, setup.namespace)
        self._has_stamps = any(followed.has_stamps for followed in self.followed)
        for followed in self.followed:
            call = partial(self._on_message, followed, self.resolve_topic_name(followed.topic.name))
            subscription = self.subscribe(followed.topic, with_info(call), qos=FOLLOWED, raw=True)
            self._publisher_counts[followed.topic.name] = subscription.handle.get_publisher_count
        command = SPEED_COMMAND._replace(name=f"{setup.namespace}/{SPEED_COMMAND.name}")
        self.subscribe(command, self._on_command)

    def adopt(self, parameters: Parameters) -> None:
        """Switch to a model with other parameters; the search for the machine's state restarts."""
        entry, before = catalogue_entry(self.machine_name), self.observer
        self.model = parameters
        self.observer = PhaseLockedObserver(entry.build(parameters), entry.build, self._sensed, self.setup.deviations)
        self.observer.counts.update(before.counts)
        self.observer.command(before.target)

    # -- following --------------------------------------------------------------------------------------------------

    def _on_message(self, followed: FollowedTopic, full: str, raw: bytes, info: Mapping[str, Any]) -> None:
        arrived_s = time.monotonic()
        for hear in self.at_message:
            hear(full, ReceivedBytes(raw, None))
        waited_s = self._waited_s(followed.topic.name, arrived_s, info["received_timestamp"] / SECOND_NS)
        self._count_lost(followed.topic.name, info["publication_sequence_number"])
        try:
            contents = followed.values(raw)
        except (CdrError, ValueError) as error:
            self.statistics.count(followed.topic.name, "malformed", str(error))
            return
        if contents is None:
            return
        stamp_ns = contents.led_ns
        if stamp_ns is None and not self._has_stamps:  # a machine without stamps runs on the steady clock
            stamp_ns = round(arrived_s * SECOND_NS)
        for found in self.admission.take(ReceivedMessage(followed, contents, arrived_s, waited_s), stamp_ns, arrived_s):
            if found.believed or (found.item.contents.stamp is None and self.admission.clock.now_ns is not None):
                self._take(found.item)
            else:
                self._count_stamp(found.item)

    def _waited_s(self, topic: str, taken_s: float, received_s: float) -> float:
        """Return how long a message waited to be taken, longer than the one of its topic that waited least (s).

        The clock of the middleware, which may be set, is compared with itself alone.
        """
        before = self._waits.get(topic, Wait(taken_s, received_s, 0.0))
        passed_s = taken_s - before.taken_s
        apart_s = received_s - before.received_s
        waited_s = max(0.0, before.waited_s + passed_s - (apart_s if apart_s > 0.0 else passed_s))
        self._waits[topic] = Wait(taken_s, received_s, waited_s)
        return waited_s

    def _count_lost(self, topic: str, number: int | None) -> None:
        """Count the messages lost since the newest one by its sequence number; only one publisher's go on by 1."""
        if number is None:
            return
        lost, self._sequence[topic] = number - self._sequence.get(topic, number) - 1, number
        if lost > 0 and self._publisher_counts[topic]() <= 1:
            self.statistics.count(topic, "missing", f"{lost} messages lost on the way or not taken in time", lost)

    def _count_stamp(self, message: ReceivedMessage) -> None:
        shown_s = (message.contents.led_ns or 0) / SECOND_NS
        reason = f"stamp {shown_s:.3f} s does not go on from {(self.admission.clock.now_ns or 0) / SECOND_NS:.3f} s"
        self.statistics.count(message.followed.topic.name, "unknown_source", reason)

    def _take(self, message: ReceivedMessage) -> None:
        """Process an accepted message."""
        followed, arrived_s = message.followed, message.arrived_s
        at_ns = self.admission.clock.at(arrived_s)
        if self._jumps != self.admission.clock.jumps:
            self._jumps = self.admission.clock.jumps
            for call in self.at_other_time:
                call()
        sample = message.contents.sample(self.origin, at_ns or 0)
        self._received_s, self._stale = arrived_s, False
        if self._command in sample.channels:
            self.observer.command(sample.values[sample.channels.index(self._command)])
        for observe in self.at_sample:
            observe(sample)
        if followed.of_events:
            return
        estimate = self.observer.take(sample)
        self._count(followed.topic.name)
        if estimate is not None:
            self._publish(estimate)
            self._latencies_s.append(latency_s := time.monotonic() - arrived_s + message.waited_s)
            if latency_s > self.options.peer_timeout_s:
                reason = f"stopped or overloaded: an estimate {latency_s:.1f} s behind its sample"
                self.statistics.count(followed.topic.name, "suspended", reason)
            self.on_estimate(sample, estimate)

    def _on_command(self, message: Float64) -> None:
        if 0.0 <= message.data <= 1.0:
            self.observer.command(message.data)
            for call in self.at_command:
                call(message.data)
        else:
            self.statistics.count(SPEED_COMMAND.name, "malformed", f"{message.data} is not between 0 and 1")

    def _publish(self, estimate: FrameEstimate) -> None:
        self.estimate, self.time_s = estimate, self.origin.clock_s(estimate.time_s)
        self._outputs.send_joints(estimate.time_s, estimate.row, estimate.sigma)
        self._outputs.send_residuals(estimate, self.observer.channels)
        self._outputs.send_impacts(estimate.events)
        if not self._next_virtual_s - 1.0 < estimate.time_s < self._next_virtual_s:
            self._next_virtual_s = estimate.time_s + 0.999 / self.options.stream_rate_hz
            self._outputs.send_virtual(estimate.time_s, estimate.row, estimate.sigma)

    def _count(self, topic: str) -> None:
        for reason, kind in COUNTED_AS.items():
            more = self.observer.counts[reason] - self._counted.get(reason, 0)
            if more > 0:
                self._counted[reason] = self.observer.counts[reason]
                self.statistics.count(topic, kind, f"{reason} sample", more)

    # -- silence and diagnostics ------------------------------------------------------------------------------------

    def check_peers(self, now_s: float) -> None:
        """Publish the last estimate with growing sigma while no messages arrive."""
        silent_s = now_s - (self._listens_from_s if self._received_s is None else self._received_s)
        if silent_s <= self.options.peer_timeout_s:
            self.diagnostics.state = self.observer.state.value
            locked = self.observer.state is ObserverState.LOCKED
            self.level = "model" if not locked else "twin" if self.is_obeyed() else "shadow"
            return
        if not self._stale:
            self.statistics.count(self.followed[0].topic.name, "timeout", "nothing from the machine")
        self._stale, self.level = True, "model"
        self.diagnostics.state = f"waiting: STALE, nothing from the machine for {silent_s:.1f} s"
        if self.estimate is not None:
            sigma = held_sigma(self.observer.run, self.estimate.sigma, silent_s)
            self._outputs.send_joints(self.estimate.time_s, self.estimate.row, sigma)
            self._outputs.send_virtual(self.estimate.time_s, self.estimate.row, sigma)

    @property
    def silent_topics(self) -> tuple[str, ...]:
        """Topics of the machine, if none has brought a sample yet."""
        return tuple(each.topic.name for each in self.followed) if self._received_s is None else ()

    def diagnostic_values(self) -> dict[str, str]:
        """Return level, state, lost messages, and the latency from the arrival of a sample to its estimate."""
        values = {"level": self.level, "observer": self.observer.state.value}
        values |= {f"samples {reason}": str(number) for reason, number in self.observer.counts.items()}
        if self._latencies_s:
            values["latency median ms"] = f"{1e3 * float(np.median(self._latencies_s)):.3g}"
        return values

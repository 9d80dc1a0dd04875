# SPDX-License-Identifier: Apache-2.0
"""What the linkage node publishes: step messages, clock, impacts, drawing, configuration.

All tools of a domain follow one clock, which one machine tells; each has another in its namespace.
"""

from __future__ import annotations

import sys
from functools import partial

from std_msgs.msg import String

from mech_twin.messages import blow, impact, scene
from mech_twin.messages.frames import frame_id
from mech_twin.messages.stamped_cdr import clock_bytes
from mech_twin.messages.step_codec import linkage as linkage_messages
from mech_twin.messages.stream_window import has_impact
from mech_twin.messages.topics import (
    BLOW_GAUGE,
    BLOW_WAVE,
    CLOCK,
    DESCRIPTION,
    IMPACTS,
    JOINT_STATES,
    OWN_CLOCK,
    SCENE,
    STEP_LINKAGE,
)
from mech_twin.nodes.exchange.base_node import TwinNode
from mech_twin.nodes.exchange.counting import CountingPublisher
from mech_twin.nodes.exchange.hand_over import HandedStep
from mech_twin.nodes.exchange.peers import UNKNOWN, HostClaims, clock_publishers
from mech_twin.nodes.roles.role_node import RoleNode
from mech_twin.samples import BodySample, Drawing, Event, LinkageSample

LINKAGE = "/linkage"  # how the full name of a node of the twin that tells time ends


class SharedClock:
    """``/clock``, published where nobody else does when the run begins, and given up if somebody does later.

    On one host whoever claims it first has it.  Of two hosts whose runs begin at one instant both find nobody; then the
    one whose node has the lesser name goes on.

    Parameters
    ----------
    node : TwinNode
        The node that tells time.
    """

    def __init__(self, node: TwinNode) -> None:
        self._node = node
        self._output: CountingPublisher | None = None
        self._claim: HostClaims | None = None

    @property
    def topics(self) -> str:
        """The clocks on which this run tells its time."""
        own, shared = self._node.resolve_topic_name(OWN_CLOCK.name), self._node.resolve_topic_name(CLOCK.name)
        return own if self._output is None else f"{own}, {shared}"

    def begin(self) -> None:
        """Publish from now on where nobody else does; in a namespace that was asked for there is one clock only."""
        shared = self._node.resolve_topic_name(CLOCK.name)
        if shared == self._node.resolve_topic_name(OWN_CLOCK.name):
            return
        self._claim = HostClaims([shared]) if sys.platform == "linux" else None
        others = clock_publishers(self._node)
        if others or (self._claim and self._claim.holder):
            self._leave(others)
        else:
            self._output = self._node.output(CLOCK, recorded=False)

    def check(self) -> None:
        """Give the clock up where somebody else publishes it and will not."""
        others = set() if self._output is None else clock_publishers(self._node)
        own = self._node.get_fully_qualified_name()
        if self._output is not None and any(not other.endswith(LINKAGE) or other < own for other in others):
            self._output.withdraw(self._node)
            self._node.outputs.remove(self._output)
            self._output = None
            self._leave(others)

    def send(self, raw: bytes) -> None:
        """Publish a message of the clock, where this run does."""
        if self._output is not None:
            self._output.send(raw)

    def close(self) -> None:
        """Let go of the claim."""
        if self._claim is not None:
            self._claim.close()

    def _leave(self, others: set[str]) -> None:
        """Leave the clock to others, who may not be discovered yet where they hold it on this host."""
        holder = self._claim.holder if self._claim else ""
        named = sorted(name for name in others if not name.endswith(UNKNOWN))
        found = f"{self._node.resolve_topic_name(CLOCK.name)} is published by {', '.join(named) or 'another node'}"
        self.close()
        said = found if named or not holder else holder
        self._node.get_logger().info(f"{said}; the time of this run is on {self.topics}")


PEERS_THAT_STEP = 2  # motor and force analysis listen to every step


class LinkageOutputs:
    """Publishers of the linkage.

    Parameters
    ----------
    node : RoleNode
        The linkage's node.
    """

    def __init__(self, node: RoleNode) -> None:
        self._node = node
        self._frame = frame_id(node.get_namespace(), scene.FRAME)
        self._steps = node.step_output(STEP_LINKAGE, PEERS_THAT_STEP)
        self._states = node.joint_state_output(JOINT_STATES, node.stream_window, linkage_messages.shown)
        self._clock = node.output(OWN_CLOCK)
        self.shared_clock = SharedClock(node)
        self._impacts = node.output(IMPACTS)
        self._scene = node.output(SCENE, int(node.options.viewer))
        self._description = node.output(DESCRIPTION)
        gauge = node.machine.gauge
        self._gauge = None if gauge is None else node.output(BLOW_GAUGE)
        self._curve = node.output(BLOW_WAVE) if gauge is not None and gauge.sent else None
        self._steps_per_drawing = max(1, round(1.0 / (node.options.view_rate_hz * node.machine.coupling_step_s)))

    def describe(self, text: str) -> None:
        """Publish the configuration in force."""
        self._description.send(String(data=text))

    def send_step(self, sample: LinkageSample) -> None:
        """Publish the step message; a step may be published again."""
        self._steps.send(HandedStep(sample, self._node.marks, linkage_messages.to_bytes))

    def send_views(self, sample: LinkageSample, body: BodySample | None) -> None:
        """Publish what a step means to people and other tools, each at its own rate; once a step."""
        for event in sample.events:
            self._impacts.send(impact.to_bytes(event))
        self._send_blows(sample.events)
        self._states.offer(sample, has_impact(sample.events))
        if sample.step % self._node.stream_window == 0:
            now = clock_bytes(sample.time_s)
            self._clock.send(now)
            self.shared_clock.send(now)
        if sample.step % self._steps_per_drawing == 0:
            self._scene.send_made(lambda: self._drawn(sample, body))

    def _send_blows(self, events: tuple[Event, ...]) -> None:
        for gauge, event in blow.told_blows(self._node.machine.gauge, events):
            if self._gauge is not None:
                self._gauge.send_made(partial(blow.numbers_bytes, gauge, event))
            if self._curve is not None and event.contact in gauge.sent:
                self._curve.send_made(partial(blow.curve_message, gauge, event))

    def _drawn(self, sample: LinkageSample, body: BodySample | None) -> bytes:
        shapes = self._node.machine.draw(sample, body)
        return scene.to_bytes(Drawing(sample.step, sample.time_s, shapes), self._frame)

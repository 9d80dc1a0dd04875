# SPDX-License-Identifier: Apache-2.0
"""Topics of the linkage node besides the answers of its peers: what it asks them at a start, and its publishers.

A linkage that starts asks its peers on ``rejoin`` and ``rejoin/*`` for the state of the run; see
``docs/decisions/0008-a-restarted-node-asks-its-peers.md``.  All tools of a domain follow one ``/clock``, published by
one machine; each machine has another clock in its namespace.
"""

import math
from functools import partial
from typing import Any

from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.messages import impacts, scene
from mech_twin.messages.cdr import stamped_bytes
from mech_twin.messages.scene import frame_id
from mech_twin.messages.step_message import MessageError
from mech_twin.messages.step_message import body as body_messages
from mech_twin.messages.step_message import linkage as linkage_messages
from mech_twin.messages.topics import (
    BLOW_GAUGE,
    BLOW_WAVE,
    CLOCK,
    DESCRIPTION,
    IMPACTS,
    JOINT_STATES,
    OWN_CLOCK,
    REJOIN,
    REJOIN_BODY,
    REJOIN_DESCRIPTION,
    REJOIN_LINKAGE,
    REJOIN_MOTOR,
    SCENE,
    STEP_LINKAGE,
    has_impact,
)
from mech_twin.nodes.exchange.base_node import TwinNode
from mech_twin.nodes.exchange.counting import CountingPublisher
from mech_twin.nodes.exchange.direct_exchange import HandedStep, Step
from mech_twin.nodes.exchange.peers import ASK_AGAIN_S, UNKNOWN, HostClaims, other_publishers
from mech_twin.nodes.roles.role_node import RoleNode
from mech_twin.parameters.description import Description, description
from mech_twin.samples import BodySample, Drawing, Event, LinkageSample

NOBODY_LIMIT_S = 1.0
ANSWERS = 2  # last sample and configuration


class RejoinRequest:
    """The question of a starting linkage, and the answers.

    Parameters
    ----------
    peer_limit_s : float
        Longest wait (s) for the answers if there is a peer that can give them.

    Attributes
    ----------
    open : bool
        Whether answers are still waited for.
    answers : dict
        ``linkage``: the sample to continue from, ``description``: the configuration in force; None if a peer has none.
    """

    def __init__(self, peer_limit_s: float) -> None:
        self.open = True
        self.answers: dict[str, Any] = {}
        self._peer_limit_s = peer_limit_s
        self._begun_s: float | None = None
        self._asked_s = -math.inf

    def due(self, now_s: float) -> bool:
        """Return whether to ask now, first or again."""
        if now_s - self._asked_s <= ASK_AGAIN_S:
            return False
        self._asked_s = now_s
        return True

    def settled(self, now_s: float, somebody_answers: bool) -> bool:
        """Return whether everything is answered, or no answer is to be expected."""
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        limit_s = self._peer_limit_s if somebody_answers else NOBODY_LIMIT_S
        return len(self.answers) == ANSWERS or now_s - self._begun_s > limit_s

    def answer(self, what: str, found: LinkageSample | Description | None) -> None:
        """Store what a peer has; see ``answers``."""
        if self.open:
            self.answers[what] = found


class LinkageRejoin:
    """Asks the peers for the state of the run, and answers a restarted motor or body.

    Parameters
    ----------
    node : RoleNode
        The linkage's node.
    """

    def __init__(self, node: RoleNode) -> None:
        self.request = RejoinRequest(node.options.discovery_limit_s)
        self.last_motor: Step | None = None
        self.last_body: BodySample | None = None
        self._node = node
        self._ask = node.output(REJOIN, recorded=False)
        self._body = node.output(REJOIN_BODY, recorded=False)
        self._motor = node.output(REJOIN_MOTOR, recorded=False)
        node.subscribe(REJOIN, self._on_request)
        node.subscribe(REJOIN_LINKAGE, self._on_linkage)
        node.subscribe(REJOIN_DESCRIPTION, self._on_description)

    def settled(self, now_s: float) -> bool:
        """Ask for the state of the run; return whether that is answered, or no answer is to be expected."""
        if self.request.due(now_s):
            self._ask.send(String(data="linkage"))
        return self.request.settled(now_s, self._node.count_publishers(REJOIN_LINKAGE.name) > 0)

    def _on_linkage(self, message: JointState) -> None:
        if not self.request.open:
            return
        try:
            self.request.answer("linkage", linkage_messages.from_message(message) if message.name else None)
        except MessageError as error:
            self._node.statistics.count(REJOIN_LINKAGE.name, "malformed", str(error))

    def _on_description(self, message: String) -> None:
        if not self.request.open:
            return
        try:
            described = description(message.data) if message.data else None
        except ConfigurationError as error:
            self._node.statistics.count(REJOIN_DESCRIPTION.name, "malformed", str(error))
            return
        if described is None or described.machine == self._node.machine.name:
            self.request.answer("description", described)

    def _on_request(self, message: String) -> None:
        if message.data == "body" and self.last_body is not None:
            self._body.send(body_messages.to_bytes(self.last_body))
        elif message.data == "motor" and not self.request.open:
            self._motor.send(JointState() if self.last_motor is None else self.last_motor.raw)


LINKAGE = "/linkage"  # end of the full name of a twin's node that publishes ``/clock``


class SharedClock:
    """``/clock``, published if there is no other publisher at the start, and given up if one appears later.

    On one host the first claim counts.  Two hosts whose runs start at one instant both see no publisher; then the node
    with the lesser name continues.

    Parameters
    ----------
    node : TwinNode
        The node that publishes the time.
    """

    def __init__(self, node: TwinNode) -> None:
        self._node = node
        self._output: CountingPublisher | None = None
        self._claim: HostClaims | None = None

    @property
    def topics(self) -> str:
        """The clocks published by this run."""
        own, shared = self._node.resolve_topic_name(OWN_CLOCK.name), self._node.resolve_topic_name(CLOCK.name)
        return own if self._output is None else f"{own}, {shared}"

    def begin(self) -> None:
        """Start publishing unless another publisher exists; in a requested namespace there is one clock only."""
        shared = self._node.resolve_topic_name(CLOCK.name)
        if shared == self._node.resolve_topic_name(OWN_CLOCK.name):
            return
        self._claim = HostClaims([shared])
        others = other_publishers(self._node, CLOCK.name)
        if others or self._claim.holder:
            self._leave(others)
        else:
            self._output = self._node.output(CLOCK, recorded=False)

    def check(self) -> None:
        """Give the clock up if another publisher has precedence."""
        others = set() if self._output is None else other_publishers(self._node, CLOCK.name)
        own = self._node.get_fully_qualified_name()
        if self._output is not None and any(not other.endswith(LINKAGE) or other < own for other in others):
            self._output.withdraw(self._node)
            self._node.outputs.remove(self._output)
            self._output = None
            self._leave(others)

    def send(self, raw: bytes) -> None:
        """Publish a message of the clock, if this run publishes it."""
        if self._output is not None:
            self._output.send(raw)

    def close(self) -> None:
        """Release the claim."""
        if self._claim is not None:
            self._claim.close()

    def _leave(self, others: set[str]) -> None:
        """Leave the clock to other publishers, which may hold it on this host without being discovered yet."""
        holder = self._claim.holder if self._claim else ""
        named = sorted(name for name in others if not name.endswith(UNKNOWN))
        found = f"{self._node.resolve_topic_name(CLOCK.name)} is published by {', '.join(named) or 'another node'}"
        self.close()
        reason = found if named or not holder else holder
        self._node.get_logger().info(f"{reason}; the time of this run is on {self.topics}")


PEERS_THAT_STEP = 2  # motor and force analysis subscribe to every step


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
        self._states = node.joint_state_output(JOINT_STATES, linkage_messages.shown)
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
        """Publish the topics derived from a step, for people and other tools, each at its own rate."""
        for event in sample.events:
            self._impacts.send(impacts.to_bytes(event))
        self._send_blows(sample.events)
        self._states.offer(sample.step, sample, 0.0, has_impact(sample.events))
        if sample.step % self._node.stream_window == 0:
            now = stamped_bytes(sample.time_s)
            self._clock.send(now)
            self.shared_clock.send(now)
        if sample.step % self._steps_per_drawing == 0:
            self._scene.send_made(lambda: self._drawn(sample, body))

    def _send_blows(self, events: tuple[Event, ...]) -> None:
        for gauge, event in impacts.gauged_blows(self._node.machine.gauge, events):
            if self._gauge is not None:
                self._gauge.send_made(partial(impacts.numbers_bytes, gauge, event))
            if self._curve is not None and event.contact in gauge.sent:
                self._curve.send_made(partial(impacts.curve_message, gauge, event))

    def _drawn(self, sample: LinkageSample, body: BodySample | None) -> bytes:
        shapes = self._node.machine.draw(sample, body)
        return scene.to_bytes(Drawing(sample.step, sample.time_s, shapes), self._frame)

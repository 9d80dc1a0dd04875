# SPDX-License-Identifier: Apache-2.0
"""What the linkage node hears from its peers: one answer a step from each, of the publisher that is followed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import ModuleType

from mech_twin.messages import body as body_messages
from mech_twin.messages import force as force_messages
from mech_twin.messages import motor as motor_messages
from mech_twin.messages.joint_state_cdr import StepMessage
from mech_twin.messages.step_marks import source
from mech_twin.messages.step_message import MessageError
from mech_twin.messages.step_table import arranged
from mech_twin.messages.topics import STEP_BODY, STEP_FORCES, STEP_MOTOR, Topic
from mech_twin.nodes.linkage_rejoin import LinkageRejoin
from mech_twin.nodes.peer_wait import PeerWait
from mech_twin.nodes.role_node import RoleNode
from mech_twin.nodes.source_lock import ANONYMOUS, Admission, SourceLock
from mech_twin.nodes.stepping_barrier import Answer, SteppingBarrier

TOPICS = {"motor": STEP_MOTOR, "body": STEP_BODY, "force_analysis": STEP_FORCES}
CONVERTERS: dict[str, ModuleType] = {
    "motor": motor_messages,
    "body": body_messages,
    "force_analysis": force_messages,
}


class LinkageInputs:
    """Subscriptions of the linkage.

    Parameters
    ----------
    node : RoleNode
        The linkage's node.
    rejoin : LinkageRejoin
        Is handed the last sample of motor and body, to tell them when they come back.
    wait : PeerWait
        Says whether the run waits for a peer, whose place another publisher may then take.
    step : callable
        Step that is to be answered; None before the first.
    on_answer : callable
        Called after each answer that counts.
    """

    def __init__(
        self,
        node: RoleNode,
        rejoin: LinkageRejoin,
        wait: PeerWait,
        step: Callable[[], int | None],
        on_answer: Callable[[], object],
    ) -> None:
        peers = ("motor", "body") if node.machine.body is not None else ("motor", "force_analysis")
        self.barrier = SteppingBarrier(peers)
        self.topics: dict[str, Topic] = {peer: TOPICS[peer] for peer in peers}
        self._node, self._rejoin, self._wait = node, rejoin, wait
        self._step, self._on_answer = step, on_answer
        self._locks = {peer: SourceLock() for peer in peers}
        for peer in peers:
            node.subscribe_steps(self.topics[peer], partial(self._on_message, peer))

    def _on_message(self, peer: str, message: StepMessage) -> None:
        topic, step = self.topics[peer].name, self._step()
        try:
            sample = self._decoded(peer, message)
        except MessageError as error:
            self._node.statistics.count(topic, "malformed", str(error))
            return
        if step is None:
            return
        if sample.step == step and not self._is_followed(peer, source(message)):
            reason = f"step {sample.step} from another publisher than the one that is followed"
            self._node.statistics.count(topic, "unknown_source", reason)
            return
        fault = self.barrier.take(peer, sample, step)
        if fault is not None:
            self._node.statistics.count(topic, fault.kind, fault.reason)
            return
        self._remember(peer, message, sample)
        self._on_answer()

    def _decoded(self, peer: str, message: StepMessage) -> Answer:
        sample: Answer = CONVERTERS[peer].from_message(message, self._node.machine.coupling_step_s)
        joints = self._joints(peer)
        if joints is None:
            return sample
        in_order: Answer = arranged(sample, joints)
        return in_order

    def _joints(self, peer: str) -> tuple[str, ...] | None:
        machine = self._node.machine
        if peer == "motor":
            return machine.motor.joints
        return machine.body.joints if peer == "body" and machine.body is not None else None

    def _remember(self, peer: str, message: StepMessage, sample: Answer) -> None:
        if peer == "motor":
            self._rejoin.last_motor = message.raw
        elif peer == "body":
            self._rejoin.last_body = self.barrier.body

    def _is_followed(self, peer: str, who: float) -> bool:
        """Return whether this publisher is the peer: the first one heard, until the run waits for it."""
        lock = self._locks[peer]
        if lock.locked:
            vacant = self._wait.waiting and peer in self.barrier.missing()
        else:  # what does not say where it comes from is heard only where nobody else could be meant
            vacant = who != ANONYMOUS or self._node.count_publishers(self.topics[peer].name) <= 1
        return lock.admit(who, vacant) is not Admission.REFUSED

"""The linkage node: time authority of a run.  It steps when its peers have answered, and holds while one is missing."""

from __future__ import annotations

import math
import time
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from mech_twin.configuration_tree import ConfigurationError, configuration_tree, merged_tree, tree_from_flat
from mech_twin.engine.coupling import restarted
from mech_twin.messages import body as body_messages
from mech_twin.messages import force as force_messages
from mech_twin.messages import impact, scene
from mech_twin.messages import linkage as linkage_messages
from mech_twin.messages import motor as motor_messages
from mech_twin.messages.rows import MessageError, arranged, mark_revision, set_stamp, source
from mech_twin.messages.topics import (
    BODY_JOINT_STATES,
    CLOCK,
    DESCRIPTION,
    FORCE_JOINT_STATES,
    IMPACTS,
    JOINT_STATES,
    MOTOR_JOINT_STATES,
    SCENE,
    Topic,
)
from mech_twin.messages.wire import StepMessage
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.pace import Pace
from mech_twin.nodes.peers import Peers
from mech_twin.nodes.role_node import ASK_AGAIN_S, RETRY_S, RoleNode
from mech_twin.nodes.voice import ANONYMOUS, Voice
from mech_twin.nodes.whereabouts import Whereabouts
from mech_twin.parameters.load import catalogue_entry, description_text, validated
from mech_twin.quantity import Parameters
from mech_twin.samples import Drawing, LinkageSample

HELD_ASK_S = 0.1


class LinkageNode(RoleNode):
    """Shell around the linkage role; see `RoleNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("linkage", machine_name, parameters, options)
        self.done = False
        self.sample: LinkageSample | None = None
        self.pace = Pace(self.machine.coupling_step_s, self.options.pace == "realtime")
        self._pending: Parameters | None = None
        self._reset_asked = False
        self._born = time.monotonic()
        self._progress = self._born
        self._asked = self._born
        self._held_since: float | None = None
        self._voices: dict[str, Voice] = {}
        self._steps_per_drawing = max(1, round(1.0 / (self.options.view_rate_hz * self.machine.coupling_step_s)))
        self.whereabouts = Whereabouts(self)
        self._open_outlets()
        self._open_inlets()
        self.peers = Peers(self._peer_names(), self.ledger)
        self.every(RETRY_S, self._attend)

    # -- wiring -----------------------------------------------------------------------------------------------------

    def _peer_names(self) -> tuple[str, ...]:
        return ("motor", "body") if self.machine.body is not None else ("motor", "force_analysis")

    def _open_outlets(self) -> None:
        self._message = JointState()
        self._out = self.step_outlet(JOINT_STATES, 2)
        self._clock_out = self.outlet(CLOCK)
        self._impacts = self.outlet(IMPACTS)
        self._scene = self.outlet(SCENE, int(self.options.viewer))
        self._description = self.outlet(DESCRIPTION)

    def _open_inlets(self) -> None:
        decoders = {"motor": motor_messages, "body": body_messages, "force_analysis": force_messages}
        every = {"motor": MOTOR_JOINT_STATES, "body": BODY_JOINT_STATES, "force_analysis": FORCE_JOINT_STATES}
        self._topics = {peer: every[peer] for peer in self._peer_names()}
        for peer in self._peer_names():
            self._listen(self._topics[peer], peer, decoders[peer].from_message)
        self.create_service(Trigger, "reset", self._on_reset)
        self.add_post_set_parameters_callback(self._on_parameters)

    def _listen(self, topic: Topic, peer: str, decoder: Any) -> None:
        joints = {"motor": self.machine.motor.joints}
        if self.machine.body is not None:
            joints["body"] = self.machine.body.joints

        def receive(message: StepMessage) -> None:
            try:
                sample = decoder(message, self.machine.coupling_step_s)
                if peer in joints:
                    sample = arranged(sample, joints[peer])
            except MessageError as error:
                self.ledger.count(topic.name, "malformed", str(error))
                return
            if self.sample is None:
                return
            if sample.step == self.sample.step and not self._speaks(peer, topic, source(message)):
                self.ledger.count(topic.name, "foreign", f"step {sample.step} from another publisher than before")
            elif self.peers.take(peer, topic.name, sample, self.sample.step):
                self._remember(peer, message, sample)
                self.tick()

        self.hear_steps(topic, receive)

    def _remember(self, peer: str, message: StepMessage, sample: Any) -> None:
        if peer == "motor":
            self.whereabouts.last_motor = message.raw
        elif peer == "body":
            self.whereabouts.last_body = sample

    def _speaks(self, peer: str, topic: Topic, who: float) -> bool:
        """Return whether this publisher is the peer: the first one heard, until the run holds for it."""
        voice = self._voices.setdefault(peer, Voice())
        if voice.speaks(who):
            return True
        if voice.known:
            free = self._held_since is not None and peer in self.peers.missing()
        else:  # what does not say where it comes from is heard only where nobody else could be meant
            free = who != ANONYMOUS or self.count_publishers(topic.name) <= 1
        if free:
            voice.follow(who)
        return free

    def residual_limits(self) -> dict[str, float]:
        """Return the limits of loop closure, energy books and their like."""
        return dict(self.machine.linkage.residual_limits)

    def figures(self) -> dict[str, str]:
        """Return step, pace and lag."""
        step = "-" if self.sample is None else str(self.sample.step)
        held_s = self.peers.held_s + (time.monotonic() - self._held_since if self._held_since is not None else 0.0)
        return {
            "step": step,
            "revision": str(self.revision),
            "worst lag s": f"{self.pace.worst_lag_s:.6f}",
            "holds": str(self.peers.holds),
            "held s": f"{held_s:.1f}",
        }

    # -- the first step ---------------------------------------------------------------------------------------------

    def _attend(self) -> None:
        """Begin when everybody listens; ask again while a peer is missing."""
        now = time.monotonic()
        if self.sample is None:
            self._begin_if_ready(now)
        elif not self.done and not self.peers.complete and now - max(self._progress, self._asked) > self._patience_s:
            self._wait(now)

    @property
    def _patience_s(self) -> float:
        """How long an answer is waited for before it is asked for again."""
        return ASK_AGAIN_S if self._held_since is None else HELD_ASK_S

    def _begin_if_ready(self, now: float) -> None:
        if not self.matched and now - self._born < self.options.discovery_limit_s:
            self.health.state = "waiting for peers"
        elif self.whereabouts.known(now):
            self._begin()

    def _begin(self) -> None:
        described, recalled = self.whereabouts.described, self.whereabouts.linkage
        if described is not None:
            self.use(described.parameters)
            self.revision = described.revision
        self.sample = recalled or self.machine.linkage.start()
        self._describe(self.sample.step)
        self.whereabouts.begin()
        self._publish(self.sample, repeated=recalled is not None)
        self._progress = time.monotonic()

    # -- stepping ---------------------------------------------------------------------------------------------------

    def tick(self) -> float:
        """Take the next step if it is due; return how long nothing more will be."""
        if self.sample is None or self.done or not self.peers.complete:
            return RETRY_S
        if self.sample.step >= self._last_step():
            self._finish()
            return RETRY_S
        wait_s = self.pace.wait_s(self.sample.step + 1)
        if wait_s > 0.0:
            return wait_s
        self._step(self.sample)
        return RETRY_S

    def _last_step(self) -> float:
        duration = self.options.duration_s
        return round(duration / self.machine.coupling_step_s) if duration > 0.0 else math.inf

    def _step(self, sample: LinkageSample) -> None:
        if self._pending is not None:
            self._adopt(self._pending, sample.step + 1)
        if self._reset_asked:
            self._reset_asked = False
            self.sample = restarted(self.machine, sample.step + 1)
        else:
            self.sample = self.machine.linkage.advance(sample, self.peers.motor, self.peers.body)
        self.pace.passed(self.sample.step)
        self.peers.expect_next()
        self._progress = time.monotonic()
        self._end_hold()
        self._publish(self.sample)

    def _publish(self, sample: LinkageSample, repeated: bool = False) -> None:
        self.time_s = sample.time_s
        self.health.state = "running" if not self.machine.linkage.regimes else self._regime(sample)
        self._send_sample(sample)
        if repeated:
            return
        self.on_sample(sample)
        self.health.observe(sample.residuals)
        for event in sample.events:
            self._impacts.send(impact.to_message(event))
        if sample.step % self.options.stream_decimation == 0:
            self._tell_time(sample)
        if sample.step % self._steps_per_drawing == 0:
            self._draw(sample)

    def _send_sample(self, sample: LinkageSample) -> None:
        message = linkage_messages.to_message(sample, self._message)
        self._out.send(self.signed(mark_revision(message, self.revision)))

    def _regime(self, sample: LinkageSample) -> str:
        return f"running, {self.machine.linkage.regimes[sample.regime]}"

    def _tell_time(self, sample: LinkageSample) -> None:
        stamp = JointState()
        set_stamp(stamp.header, sample.time_s)
        self._clock_out.send(Clock(clock=stamp.header.stamp))

    def _draw(self, sample: LinkageSample) -> None:
        shapes = self.machine.draw(sample, self.whereabouts.last_body)
        self._scene.send(scene.to_message(Drawing(sample.step, sample.time_s, shapes)))

    def _finish(self) -> None:
        self.done = True
        self.health.state = "finished"

    def _wait(self, now: float) -> None:
        """Hold: ask the missing peer again, and say so once it counts as gone."""
        self._asked = now
        if now - self._progress > self.options.peer_timeout_s and self._held_since is None:
            self._begin_hold(now, self.peers.missing())
        if self._held_since is not None:  # one of several may have answered since
            self.health.state = f"waiting for {self.peers.missing()}"
        self.pace.resume()
        if self.sample is not None:
            self._send_sample(self.sample)

    def _begin_hold(self, now: float, missing: str) -> None:
        self.peers.holds += 1
        self._held_since = now
        self.health.state = f"waiting for {missing}"
        step = 0 if self.sample is None else self.sample.step
        for topic in (self._topics[peer] for peer in missing.split(", ")):
            self.ledger.count(topic.name, "silent", f"no answer to step {step} for {now - self._progress:.1f} s")
        self.report()

    def _end_hold(self) -> None:
        if self._held_since is not None:
            self.peers.held_s += time.monotonic() - self._held_since
            self._held_since = None

    def woken(self) -> None:
        """Go on from the wall clock as it is: the time this process stood still is not caught up."""
        self.pace.resume()
        self._progress = time.monotonic()

    # -- configuration ----------------------------------------------------------------------------------------------

    def judge_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Say whether a change of live parameters validates; it takes effect at the next step."""
        if self._adopting:
            return SetParametersResult(successful=True)
        try:
            self._changed(changes)
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters(self, changes: list[Parameter]) -> None:
        if not self._adopting:
            self._pending = self._changed(changes)

    def _changed(self, changes: list[Parameter]) -> Parameters:
        base = configuration_tree(self._pending or self.machine.parameters)
        flat = {change.name: change.value for change in changes if not change.name.startswith("run.")}
        entry = catalogue_entry(self.machine.name)
        return validated(entry, merged_tree(base, tree_from_flat(flat)), "parameter change")

    def _adopt(self, parameters: Parameters, step: int) -> None:
        self._pending = None
        self.machine = catalogue_entry(self.machine.name).build(parameters)
        self.revision += 1
        self._describe(step)

    def _describe(self, from_step: int) -> None:
        if self.revision == 0:
            self.revision = 1
        self.description = description_text(self.machine.name, self.machine.parameters, self.revision, from_step)
        self._description.send(String(data=self.description))

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._reset_asked = True
        response.success, response.message = True, "initial state at the next step"
        return response

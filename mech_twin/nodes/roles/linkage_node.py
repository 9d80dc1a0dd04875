# SPDX-License-Identifier: Apache-2.0
"""The linkage node: time authority of a run.  It steps when its peers have answered, and waits while one is missing.

A step is due at once, or at its time by the wall clock.  Live parameters change between two steps.
"""

import math
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.coupling import restarted
from mech_twin.engine.stored_state import StoredState, check_storable, state_text, stored_state
from mech_twin.errors import StateError
from mech_twin.messages.cdr import StepMessage
from mech_twin.messages.step_message import ANONYMOUS, StepCodec, arranged, body, force, motor
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.exchange.direct_exchange import Step
from mech_twin.nodes.exchange.parameter_bridge import offer
from mech_twin.nodes.exchange.peers import Admission, Answer, PeerWait, SourceLock, SteppingBarrier
from mech_twin.nodes.roles.linkage_topics import LinkageOutputs, LinkageRejoin
from mech_twin.nodes.roles.role_node import PLACES, RETRY_S, RoleNode
from mech_twin.nodes.roles.run_control import (
    LagNotice,
    Ration,
    RequestOutcome,
    StepPacer,
    SteppingServices,
    answer_later,
)
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import RUN_GROUP, changed_configuration, is_of_ros
from mech_twin.samples import BodySample, LinkageSample, MotorSample

PEERS: Mapping[str, StepCodec[Any]] = {"motor": motor, "body": body, "force_analysis": force}
CHANGE_SHARE = 0.1  # largest share of a run's wall time for parameter changes
CHANGE_LEAST_S = 0.004  # counted per change, with the work of other roles and recorder: 25 changes/s sustained
CHANGE_BURST_S = 0.2  # 50 changes at once


class LiveParameters:
    """The requested configuration, until the next step adopts it.

    Parameters
    ----------
    machine_name : str
        Machine of the catalogue.
    """

    def __init__(self, machine_name: str) -> None:
        self._machine_name = machine_name
        self._pending: Parameters | None = None

    def validated(self, in_force: Parameters, changes: Mapping[str, Any]) -> Parameters:
        """Return the present or already requested configuration with changes (dotted keys).

        Raises
        ------
        ConfigurationError
            If it does not validate as a whole.
        """
        flat = {name: value for name, value in changes.items() if not name.startswith(f"{RUN_GROUP}.")}
        return changed_configuration(self._machine_name, self._pending or in_force, flat, "parameter change")

    def request(self, in_force: Parameters, changes: Mapping[str, Any]) -> None:
        """Request a change; see `validated`."""
        self._pending = self.validated(in_force, changes)

    def take(self) -> Parameters | None:
        """Return the requested configuration, if any, and clear the request."""
        pending, self._pending = self._pending, None
        return pending


class LinkageNode(RoleNode):
    """Node of the linkage role; see `TwinNode` for the arguments."""

    def __init__(
        self, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__("linkage", machine_name, parameters, options)
        self.sample: LinkageSample | None = None
        self.interrupt: Callable[[], None] = lambda: None  # no executor slice yet
        self._born_s = time.monotonic()
        self.paused = False
        self._reset_asked: str | None = None
        self._live = LiveParameters(machine_name)
        self._changes = Ration(CHANGE_SHARE, CHANGE_BURST_S)
        self._pacer = StepPacer(self.machine.coupling_step_s, self.options.pace == "realtime")
        self._lag = LagNotice()
        self._wait = PeerWait(self.options.peer_timeout_s, self._born_s)
        self._rejoin = LinkageRejoin(self)
        self._out = LinkageOutputs(self)
        peers = ("motor", "body") if self.machine.body is not None else ("motor", "force_analysis")
        self._barrier = SteppingBarrier(peers)
        self._locks = {peer: SourceLock() for peer in peers}
        for peer in peers:
            self.subscribe_steps(PEERS[peer].steps, partial(self._decoded, peer), partial(self._on_answered, peer))
        offer(self, Trigger, "reset", lambda _: self.reset().answer)
        offer(self, SetBool, "pause", lambda request: (True, self.pause(request.data)))
        self._stepping = SteppingServices(self, self._on_answer)
        answer_later(self.create_service(Trigger, "step", self._stepping.on_step))
        offer(self, Trigger, "get_state", lambda _: self.stored().answer)
        offer(self, Trigger, "get_features", lambda _: (True, self._stepping.features()))
        self.add_post_set_parameters_callback(self._on_parameters)
        self.every(RETRY_S, self._attend)

    def residual_limits(self) -> dict[str, float]:
        """Return the limits of loop closure, energy balance and similar residuals."""
        return dict(self.machine.linkage.residual_limits)

    def diagnostic_values(self) -> dict[str, str]:
        """Return step, revision, lag, and the total time of waiting for peers."""
        return {
            "step": "-" if self.sample is None else str(self.sample.step),
            "revision": str(self.revision),
            "clock": self._out.shared_clock.topics,
            "lag s": f"{self._pacer.lag_s:.6f}",
            "worst lag s": f"{self._pacer.worst_lag_s:.6f}",
            "given up s": f"{self._pacer.given_up_s:.1f}",
            "waits": str(self._wait.count),
            "waited s": f"{self._wait.total_s(time.monotonic()):.1f}",
        }

    def report(self) -> None:
        """Publish the diagnostics of the window that ends now, and report a lag behind the wall clock."""
        state, line = self._lag.lines(self._pacer)
        if state:
            self.diagnostics.warn(state)
        if line:
            self.get_logger().warning(line)
        self._out.shared_clock.check()
        super().report()

    def close(self) -> None:
        """Release the claim on the shared clock."""
        self._out.shared_clock.close()
        super().close()

    # -- the first step ---------------------------------------------------------------------------------------------

    def _attend(self) -> None:
        """Start when all subscribers are matched; repeat the question while a peer is missing."""
        now = time.monotonic()
        if self.sample is None:
            if not self.matched and now - self._born_s < self.options.discovery_limit_s:
                self.diagnostics.state = "waiting for peers"
            elif self._rejoin.settled(now):
                self._begin()
        elif not self.done and self._stepping.held and self._wait.due(now):
            self._wait.stepped(now)
            self._out.send_step(self.sample)  # so that no peer takes a pause for a lost linkage
        elif not self.done and not self._barrier.complete and self._wait.due(now):
            self._ask_again(self.sample, now)

    def _begin(self) -> None:
        self._rejoin.request.open = False
        described, last = map(self._rejoin.request.answers.get, ("description", "linkage"))
        if described is not None:
            self.use(described.parameters)
            self.revision = described.revision
        self.sample = last or self.machine.linkage.start()
        if last is not None:
            self.get_logger().info(f"resuming at step {last.step}")
        self._out.shared_clock.begin()
        self._describe(self.sample.step)
        self._publish(self.sample, repeated=last is not None)
        self._wait.stepped(time.monotonic())

    # -- stepping ---------------------------------------------------------------------------------------------------

    def tick(self) -> float:
        """Take the next step if it is due; return the time to the next task (s)."""
        self._stepping.settle(self._barrier.complete, self.done)
        if self.sample is None or self.done or self._stepping.held or not self._barrier.complete:
            return RETRY_S
        if self.sample.step >= self._last_step():
            self.done = True
            self._stepping.settle(answered=True, ended=True)
            self.diagnostics.state = "finished"
            return 0.0
        wait_s = self._pacer.wait_s(self.sample.step + 1)
        if wait_s > 0.0:
            return wait_s
        self._step(self.sample)
        return RETRY_S

    def _on_answer(self) -> None:
        if self.tick() < RETRY_S:
            self.interrupt()

    def _last_step(self) -> float:
        duration = self.options.duration_s
        return round(duration / self.machine.coupling_step_s) if duration > 0.0 else math.inf

    def _step(self, sample: LinkageSample) -> None:
        asked = self._live.take()
        if asked is not None:
            self._adopt(asked, sample.step + 1)
        if self._reset_asked is None:
            answers = self._barrier.answers
            self.sample = self.machine.linkage.advance(sample, answers["motor"], answers.get("body"))
        else:
            self.sample = self._reset(sample)
        self._stepping.stepped()
        self._pacer.passed(self.sample.step)
        self._barrier.expect_next()
        self._wait.stepped(time.monotonic())
        self._publish(self.sample)

    def _reset(self, sample: LinkageSample) -> LinkageSample:
        text, self._reset_asked = self._reset_asked, None
        if not text:
            return restarted(self.machine, sample.step + 1)
        present = StoredState(sample, self._barrier.answers.get("body"))
        state = stored_state(self.machine, text, present, sample.step + 1)
        self._rejoin.last_body = state.body  # the body requests it
        return state.linkage

    def _publish(self, sample: LinkageSample, repeated: bool = False) -> None:
        self.time_s = sample.time_s
        regimes = self.machine.linkage.regimes
        going = "paused" if self.paused else "running"
        self.diagnostics.state = f"{going}, {regimes[sample.regime]}" if regimes else going
        self._out.send_step(sample)
        if not repeated:
            self.on_sample(sample)
            self.diagnostics.observe(sample.residuals)
            self._out.send_views(sample, self._rejoin.last_body)

    # -- answers ----------------------------------------------------------------------------------------------------

    def _on_answered(self, peer: str, sample: Answer, message: Step) -> None:
        """Take a peer's answer to the present step; anything else is counted."""
        topic = PEERS[peer].steps.name
        if self.sample is None:
            return
        if sample.step == self.sample.step and not self._is_followed(peer, topic, message.source):
            reason = f"step {sample.step} from another publisher than the one that is followed"
            self.statistics.count(topic, "unknown_source", reason)
            return
        fault = self._barrier.take(peer, sample, self.sample.step)
        if fault is not None:
            self.statistics.count(topic, fault.kind, fault.reason)
            return
        if isinstance(sample, MotorSample):
            self._rejoin.last_motor = message
        elif isinstance(sample, BodySample):
            self._rejoin.last_body = sample
        self._on_answer()

    def _decoded(self, peer: str, message: StepMessage) -> Any:
        role = {"motor": self.machine.motor, "body": self.machine.body}.get(peer)
        sample = PEERS[peer].from_message(message, self.machine.coupling_step_s)
        return sample if role is None else arranged(sample, role.joints)

    def _is_followed(self, peer: str, topic: str, who: float) -> bool:
        """Return whether this publisher is the followed peer: the first one, until the run waits for it."""
        lock = self._locks[peer]
        if lock.locked:
            vacant = self._wait.waiting and peer in self._barrier.missing()
        else:  # an unsigned message counts only if the topic has no other publisher
            vacant = who != ANONYMOUS or self.count_publishers(topic) <= 1
        return lock.admit(who, vacant) is not Admission.REFUSED

    # -- waiting ----------------------------------------------------------------------------------------------------

    def _ask_again(self, sample: LinkageSample, now: float) -> None:
        """Publish the step again for peers that have not answered, and warn once a peer counts as gone."""
        missing = self._barrier.missing()
        begins = self._wait.ask(now)
        if self._wait.waiting:
            self.diagnostics.state = f"waiting for {', '.join(missing)}"
            self._pacer.resume()  # time lost in a wait is not caught up; that of a late answer is
        if begins:
            reason = f"no answer to step {sample.step} for {self._wait.silence_s(now):.1f} s"
            for peer in missing:
                self.statistics.count(PEERS[peer].steps.name, "timeout", reason)
            self.report()
        self._out.send_step(sample)

    def resumed(self) -> None:
        """Continue from the present wall clock: the time of a suspension is not caught up."""
        self._pacer.resume()
        self._wait.resumed(time.monotonic())

    # -- configuration ----------------------------------------------------------------------------------------------

    def judge_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Return whether a change of live parameters is valid; it takes effect at the next step."""
        refused = "" if self._adopting else self._changes.refusal()
        if refused:
            return SetParametersResult(successful=False, reason=refused)
        with self._changes.taking(CHANGE_LEAST_S):
            return self._tried(changes, self._live.validated)

    def _on_parameters(self, changes: list[Parameter]) -> None:
        with self._changes.taking():
            self._tried(changes, self._live.request)

    def _tried(
        self, changes: list[Parameter], call: Callable[[Parameters, dict[str, object]], object]
    ) -> SetParametersResult:
        values = {change.name: change.value for change in changes if not is_of_ros(change.name)}
        own = {name: value for name, value in values.items() if not name.startswith(f"{RUN_GROUP}.")}
        if values and not self._adopting:
            try:
                self._check_state(values.get(f"{RUN_GROUP}.reset_state"))
                if own:
                    call(self.machine.parameters, own)
            except (ConfigurationError, StateError) as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _adopt(self, parameters: Parameters, step: int) -> None:
        with self._changes.taking():
            self.machine = self.built(parameters)
            self.diagnostics.limits(self.residual_limits(), self.machine.coupling_step_s)
            self.revision += 1
            self._describe(step)

    def _describe(self, from_step: int) -> None:
        self.revision = max(1, self.revision)
        self.described_by = self.source
        own_roles = {role: made for role in PLACES if (made := getattr(self.options, role))}
        self.description = description_text(
            self.machine.name, self.machine.parameters, self.revision, from_step, self.source, own_roles
        )
        self._out.describe(self.description)

    # -- stepped from outside -----------------------------------------------------------------------------------

    def step_text(self) -> str:
        """Return step and time."""
        return "not begun" if self.sample is None else f"step {self.sample.step}, {self.sample.time_s:.9g} s"

    def pause(self, held: bool) -> str:
        """Pause or continue the run, which ends a request for steps; return a line that says which.

        The time of a pause is not caught up.
        """
        self.paused = held
        self.diagnostics.state = "paused" if held else "running"
        self._stepping.settle(answered=True, ended=True)
        self._pacer.resume()
        return "paused" if held else "goes on"

    def reset(self) -> RequestOutcome:
        """Request the initial state, or that of ``run.reset_state``, at the next step."""
        text = self.get_parameter(f"{RUN_GROUP}.reset_state").value
        try:
            self._check_state(text)
        except StateError as error:
            return RequestOutcome("RESULT_OPERATION_FAILED", str(error))
        self._reset_asked = text
        return RequestOutcome("RESULT_OK", f"{'stored' if text else 'initial'} state at the next step")

    def stored(self) -> RequestOutcome:
        """Return the state of the machine as text, or why it cannot be stored."""
        try:
            check_storable(self.machine)
        except StateError as error:
            return RequestOutcome("RESULT_FEATURE_UNSUPPORTED", str(error))
        if self.sample is None or not self._barrier.complete:
            return RequestOutcome(
                "RESULT_INCORRECT_STATE", f"{self.step_text()} is not answered yet: pause the run first"
            )
        present = StoredState(self.sample, self._barrier.answers.get("body"))
        try:
            return RequestOutcome("RESULT_OK", state_text(self.machine, present))
        except StateError as error:
            return RequestOutcome("RESULT_INCORRECT_STATE", str(error))

    def _check_state(self, text: str | None) -> None:
        """Raise for a text that is no state of this machine."""
        if text and self.sample is not None:
            stored_state(self.machine, text, StoredState(self.sample, self._rejoin.last_body), self.sample.step)

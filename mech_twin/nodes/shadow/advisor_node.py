# SPDX-License-Identifier: Apache-2.0
"""The advisor node: offers a change that brings a metric of the cycle nearer to its target, and waits for acceptance.

It can act on a machine only by the speed command, or by a live parameter of the linkage.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from mech_twin.declarations.quantity import Parameters
from mech_twin.messages.topics import DECISIONS, RECOMMENDATION, SPEED_COMMAND
from mech_twin.nodes.exchange.base_node import TwinNode
from mech_twin.nodes.exchange.counting import status_message
from mech_twin.nodes.exchange.parameter_bridge import offer, watch_parameters
from mech_twin.nodes.shadow.inputs import StampOrigin
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.advice import (
    AdviceState,
    AdviceStep,
    AdviceWish,
    Decision,
    Recommendation,
    accepted,
    after_machine_cycle,
    ended,
    not_taken,
    offered,
    overruled,
    rejected,
    watched,
)
from mech_twin.studies.advice_search import COMMAND, advice_model, recommendation
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, FeatureVector
from mech_twin.studies.observer.estimate import SeenSample
from mech_twin.studies.spreading import BesideProcess

PENDING = "pending"
STANDS_S, STANDS_CYCLES = 1.0, 3.0  # without a cycle for both, a machine stands, and a speed would start it


class AdvisorNode(TwinNode):
    """Advises on one output of the machine; see `TwinNode` for the other arguments.

    Parameters
    ----------
    wish : AdviceWish
        The target, and the settings that may be changed.
    namespace : str
        The machine's.
    columns : sequence of str
        Column of each channel of the samples.
    origin : StampOrigin
        Origin of the times.

    Raises
    ------
    ConfigurationError
        The figure is none that these channels give, or the output is none of the machine.
    """

    def __init__(
        self,
        machine_name: str,
        wish: AdviceWish,
        namespace: str,
        columns: Sequence[str],
        origin: StampOrigin,
        parameters: Parameters | None = None,
    ) -> None:
        super().__init__("advisor", machine_name, parameters)
        self.model = advice_model(catalogue_entry(machine_name), self.initial_parameters, wish, columns)
        self.wish, self.state, self.number = wish, AdviceState(), 0
        self.answer: Decision | None = None  # the newest one to an offer, or at the end of a trial
        self._origin, self._now_s = origin, 0.0  # end of the newest cycle, on the time base of the samples
        self.has_fault: Callable[[], bool] = lambda: False
        self.known_changes: Callable[[], Mapping[str, Any]] = dict
        self._columns = tuple(columns)
        self._feed = FeatureFeed(self.model.declared, list(dict.fromkeys(columns)))
        self._value = wish.output.value
        self._figures: deque[float] = deque(maxlen=wish.cycles)
        self._received_s, self._period_s = time.monotonic(), 0.0  # of the newest cycle, by the steady clock and its own
        self._decided_s = float("-inf")
        self._thinking: Future[Recommendation | None] | None = None
        self._beside = BesideProcess()  # a computation in this process would hold back the observer
        self._send_value = None if wish.dry_run else self._outlet(namespace, wish.output.key)
        self._recommendation = self.output(RECOMMENDATION, recorded=False)
        self._decisions = self.output(DECISIONS, recorded=False)
        watch_parameters(self, namespace, self.on_setting)
        self.declare_parameter(PENDING, 0)
        offer(self, SetBool, "~/accept", lambda request: self.accept(request.data))
        offer(self, SetBool, "~/reject", lambda request: self.reject(request.data))

    def _outlet(self, namespace: str, key: str) -> Callable[[float], object]:
        """Return what sends values of an output, the speed command or a live parameter; made only where allowed."""
        if key == COMMAND:
            name = f"{namespace}/{SPEED_COMMAND.name}"
            publisher = self.create_publisher(Float64, name, SPEED_COMMAND.qos)
            return lambda value: publisher.publish(Float64(data=value))
        client = self.create_client(SetParameters, f"{namespace}/linkage/set_parameters")

        def set_parameter(value: float) -> object:
            parameters = [Parameter(key, value=value).to_parameter_msg()]
            answer = client.call_async(SetParameters.Request(parameters=parameters))
            answer.add_done_callback(lambda done: self._on_answer(value, done.result().results[0]))
            return answer

        return set_parameter

    def _on_answer(self, value: float, result: SetParametersResult) -> None:
        """End a trial whose value the machine refuses."""
        if result.successful:
            return
        self.get_logger().error(f"the machine refuses {self.wish.output.key} = {value:.6g}: {result.reason}")
        if self.state.phase == "trial" and self.state.advice is not None:
            self._value = self.state.advice.value
            self._take(not_taken(self.state, self._now_s, result.reason))

    def observe(self, sample: SeenSample) -> None:
        """Update with a sample of the machine."""
        for channel, value in zip(sample.channels, sample.values, strict=True):
            for vector in self._feed.feed(self._columns[channel], [sample.time_s], [value]):
                self._on_cycle(vector)

    def begin_anew(self) -> None:
        """Undo a trial and drop the measurements: the machine was restarted, and its time is another."""
        self._take(ended(self.state, self._now_s, "the machine's time has become another"))
        self.state = self.state._replace(changed_s=float("-inf"))  # a stamp of the time before
        self._feed = self._feed.begun_anew()
        self._forget()
        self._decided_s = float("-inf")

    def on_setting(self, key: str, value: Any) -> None:
        """Take a change of the output: one that is not its own is the value in force, and ends an offer or trial."""
        if key == self.wish.output.key and value != self._value:
            self._value = value
            self._forget()
            self._take(overruled(self.state, self._now_s))

    def _forget(self) -> None:
        """Drop what was measured, and what is computed of it: neither is of the machine as it is now."""
        self._figures.clear()
        self._thinking = None

    def adopt(self, parameters: Parameters) -> None:
        """Use a model with other parameters from now on."""
        self.model = advice_model(catalogue_entry(self.machine_name), parameters, self.wish, self._columns)

    def check_peers(self, now_s: float) -> None:
        """Offer new advice, and end a trial without measurements."""
        if self._thinking is not None and self._thinking.done():
            found, self._thinking = self._found(self._thinking), None
            if found is not None:
                self._take(offered(self.state, found, self._now_s))
        if self.state.phase == "trial":
            silent_s = now_s - self._received_s
            self._take(watched(self.state, self.state.newest_s + silent_s, self.wish))
        self.diagnostics.state = self.state.phase

    def diagnostic_values(self) -> dict[str, str]:
        """Return the newest metric, and whether an accepted advice acts on the machine."""
        newest = f"{self._figures[-1]:.6g}" if self._figures else "nan"
        return {
            self.wish.figure: newest,
            "advice in force": str(self.state.in_force),
            "dry run": str(self.wish.dry_run),
        }

    def close(self) -> None:
        """Undo a trial, and end the computation; samples may still come while the decision is recorded."""
        self._take(ended(self.state, self._now_s))
        self._decided_s = float("inf")
        self._beside.end()

    # -- the machine's cycles ---------------------------------------------------------------------------------------

    def _on_cycle(self, vector: FeatureVector) -> None:
        self._now_s, self._received_s = vector.end_s, time.monotonic()
        self._period_s = vector.end_s - vector.begin_s
        figure = float(vector.values[vector.names.index(self.wish.figure)])
        if not np.isfinite(figure):
            return
        self._figures.append(figure)
        off = figure - self.wish.wanted
        self._take(after_machine_cycle(self.state, off, self._now_s, self.has_fault(), self.wish))
        is_free = self.state.phase == "idle" and self._thinking is None and not self.has_fault()
        is_due = self._now_s - self._decided_s >= self.wish.interval_s
        if is_free and is_due and len(self._figures) == self.wish.cycles:
            measured = np.array(self._figures)
            self._figures.clear()
            model = self.model.under(self.known_changes())
            self._thinking = self._beside.submit(recommendation, model, self._value, measured, self._now_s)

    def _found(self, thinking: Future[Recommendation | None]) -> Recommendation | None:
        try:
            return thinking.result()
        except BrokenProcessPool:
            self.get_logger().error("the process that searched for an advice has died; the next search begins another")
            return None

    def _miss(self) -> float:
        advice = self.state.advice
        if self._figures:
            return abs(float(np.mean(self._figures)) - self.wish.wanted)
        return 0.0 if advice is None else advice.gain

    # -- decisions --------------------------------------------------------------------------------------------------

    def _would_start(self) -> bool:
        """Return whether to send the output would start a machine that stands, such as one that was just stopped."""
        silent_s = time.monotonic() - self._received_s
        return self.wish.output.key == COMMAND and silent_s > max(STANDS_S, STANDS_CYCLES * self._period_s)

    def accept(self, is_meant: bool = True) -> tuple[bool, str]:
        """Accept the advice offered, unless that would start the machine."""
        if self._would_start():
            return False, "the machine stands, and a speed would start it"
        return self._answered(is_meant, accepted(self.state, self._miss(), self._now_s, self.wish))

    def reject(self, is_meant: bool = True) -> tuple[bool, str]:
        """Reject the advice offered, or end its trial."""
        return self._answered(is_meant, rejected(self.state, self._now_s))

    def _answered(self, is_meant: bool, step: AdviceStep) -> tuple[bool, str]:
        if not is_meant:
            return False, "expected data: true"
        self._take(step)
        decision = step.decision
        if decision is None:
            return False, ""
        is_done = decision.what not in ("refused", "expired")
        return is_done, f"{decision.what}: {decision.reason}" if is_done else decision.reason

    def _take(self, step: AdviceStep) -> None:
        """Execute a decision, and publish it."""
        before, self.state = self.state, step.state
        decision = step.decision
        if decision is None:
            return
        if decision.sent is not None and self._would_start():
            reason = f"{decision.reason}; not sent, since the machine stands and a speed would start it"
            decision, self.state = decision._replace(reason=reason, sent=None), step.state._replace(is_kept=True)
        self._decided_s = decision.time_s
        self.answer = self.answer if decision.what == "offered" else decision
        if decision.sent is not None and self._send_value is not None:
            self._send_value(decision.sent.value)
            self._value = decision.sent.value
            self._figures.clear()
        if decision.what == "offered":
            self.number += 1
        pending = self.number if self.state.phase == "offered" else 0
        self.set_parameters([Parameter(PENDING, value=pending)])
        name, advice = f"{self.get_fully_qualified_name()}: advice {self.number}", self.state.advice or before.advice
        sent = "" if decision.sent is None else f"{decision.sent.key} = {decision.sent.value:.6g}"
        decided_s = self._origin.clock_s(decision.time_s)
        decided = {"time s": f"{decided_s:.3f}", "decision": decision.what, "sent": sent}
        self._decisions.send(status_message(name, f"{decision.what}: {decision.reason}", decided))
        content = {} if advice is None else advice._replace(expires_s=self._origin.clock_s(advice.expires_s))._asdict()
        parts = {key.replace("_", " "): f"{value}" for key, value in content.items()}
        own = self.diagnostics.hardware
        self._recommendation.send(status_message(name, decision.what, parts, hardware_id=own))

# SPDX-License-Identifier: Apache-2.0
"""Timing of the steps by the wall clock, and services to pause, step and reset a run, with the types of std_srvs.

If the package simulation_interfaces is installed, the services are offered under its names and types too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.task import Future
from std_srvs.srv import Trigger

if TYPE_CHECKING:
    from mech_twin.nodes.roles.linkage_node import LinkageNode

LOGGED_FROM_S = 0.5  # smallest reported lag
GIVEN_UP_FROM_S = 10.0  # a larger lag is not caught up
LOGGED_EVERY_S = 10.0
BEGINNING_S = 1.0  # after the first step: work that is done once delays the run
NOTICEABLE_S = 0.05


class StepPacer:
    """Schedule of the steps.

    On a slow computer the run falls behind the wall clock, and steps without waiting until it has caught up.  A lag
    of more than 10 s is given up, and the schedule restarts from the present wall clock.  The same holds within the
    first second, in which kernels and libraries are loaded on first use.

    Parameters
    ----------
    step_s : float
        Length of a step in simulated time.
    realtime : bool
        Follow the wall clock; otherwise every step is due at once.
    clock : callable
        Steady time in seconds.
    """

    def __init__(self, step_s: float, realtime: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.realtime = realtime
        self.lag_s = 0.0
        self.worst_lag_s = 0.0
        self.given_up_s = 0.0
        self._step_s = step_s
        self._clock = clock
        self._zero_s: float | None = None
        self._begun_s: float | None = None

    def wait_s(self, step: int) -> float:
        """Return the time until a step is due (s); 0 if it is due."""
        if not self.realtime:
            return 0.0
        now = self._clock()
        if self._zero_s is None:
            self._zero_s = now - step * self._step_s
            self._begun_s = now if self._begun_s is None else self._begun_s
        return max(0.0, self._zero_s + step * self._step_s - now)

    def passed(self, step: int) -> None:
        """Register a step taken now, and its delay."""
        if not self.realtime or self._zero_s is None or self._begun_s is None:
            return
        now = self._clock()
        self.lag_s = now - self._zero_s - step * self._step_s
        if self.lag_s > NOTICEABLE_S and now - self._begun_s < BEGINNING_S:
            self.resume()
        self.worst_lag_s = max(self.worst_lag_s, self.lag_s)
        if self.lag_s > GIVEN_UP_FROM_S:
            self.given_up_s += self.lag_s
            self.resume()

    def resume(self) -> None:
        """Restart from the present wall clock after a wait."""
        self._zero_s = None
        self.lag_s = 0.0


class LagNotice:
    """Log lines on a run that falls behind: at once, every ten seconds, and when it has caught up."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._logged_s: float | None = None
        self._given_up_s = 0.0

    def lines(self, pacer: StepPacer) -> tuple[str, str]:
        """Return the present state, and the line for the log; each empty if there is none."""
        now = self._clock()
        if pacer.given_up_s > self._given_up_s:
            given_up, self._given_up_s = pacer.given_up_s - self._given_up_s, pacer.given_up_s
            self._logged_s = now
            line = f"gave up {given_up:.1f} s it was behind; this machine is too slow for real time"
            return line, line
        if pacer.lag_s < LOGGED_FROM_S:
            was_behind, self._logged_s = self._logged_s is not None, None
            return "", "caught up with the wall clock" if was_behind else ""
        behind = f"behind by {pacer.lag_s:.1f} s"
        if self._logged_s is not None and now - self._logged_s < LOGGED_EVERY_S:
            return behind, ""
        self._logged_s = now
        return behind, behind


class Ration:
    """Rate limit for requests (token bucket): a share of wall time, with a burst.

    Parameters
    ----------
    share : float
        Share of the time that requests may take.
    burst_s : float
        Time in debt (s) up to which a further request is still accepted.
    """

    def __init__(self, share: float, burst_s: float = 0.0) -> None:
        self._share = share
        self._ahead_s = burst_s / share
        self._even_s = 0.0  # steady time at which the share is met again

    def refusal(self) -> str:
        """Return why a further request is refused; empty if it is accepted."""
        wait_s = self._even_s - time.monotonic() - self._ahead_s
        rounded_s = math.ceil(10.0 * wait_s) / 10.0  # rounded up: a request at that time is accepted
        return f"asked too often: ask again in {rounded_s:.1f} s" if wait_s > 0.0 else ""

    @contextmanager
    def taking(self, least_s: float = 0.0) -> Iterator[None]:
        """Charge the duration of the block, at least ``least_s`` for the work it causes elsewhere."""
        begun = time.monotonic()
        try:
            yield
        finally:
            now = time.monotonic()
            self._even_s = max(self._even_s, now) + max(now - begun, least_s) / self._share


STANDARD = "simulation_interfaces"
# of simulation_interfaces/msg/SimulatorFeatures: all features that this run supports
FEATURES = (
    "SIMULATION_RESET",
    "SIMULATION_RESET_STATE",
    "SIMULATION_STATE_GETTING",
    "SIMULATION_STATE_SETTING",
    "SIMULATION_STATE_PAUSE",
    "STEP_SIMULATION_SINGLE",
    "STEP_SIMULATION_MULTIPLE",
)
STATE_FEATURE = "state: get_state returns one, parameter run.reset_state with service reset goes back to one"


class RequestOutcome(NamedTuple):
    """Result of a request: the name of a result of simulation_interfaces, and a line."""

    result: str
    line: str

    @property
    def answer(self) -> tuple[bool, str]:
        """Success and message."""
        return self.result == "RESULT_OK", self.line


class SteppingServices:
    """Services of a run that is stepped from outside; the linkage creates those of std_srvs.

    Parameters
    ----------
    run : LinkageNode
        The linkage's node, which steps.
    wake : callable
        Called when steps are requested.
    """

    def __init__(self, run: LinkageNode, wake: Callable[[], object]) -> None:
        self._run, self._wake = run, wake
        self._left = 0
        self._taken: Callable[[RequestOutcome], None] | None = None
        if find_spec(STANDARD) is not None:
            self._offer_standard()

    @property
    def held(self) -> bool:
        """Whether the run is paused."""
        return self._run.paused and self._left == 0

    def stepped(self) -> None:
        """Register a step."""
        self._left = max(0, self._left - 1)

    def settle(self, answered: bool, ended: bool = False) -> None:
        """Answer a request for steps, once the last of them is taken and its peers have answered."""
        if self._taken is None or not (ended or (self._left == 0 and answered)):
            return
        done, self._left, taken, self._taken = self._left == 0, 0, self._taken, None
        text = self._run.step_text()
        result, line = ("RESULT_OK", text) if done else ("RESULT_OPERATION_FAILED", f"ended at {text}")
        taken(RequestOutcome(result, line))

    def _take(self, steps: int, answered: Callable[[RequestOutcome], Any]) -> Any:
        """Request steps; return the answer, or a future of it."""
        if not self._run.paused:
            line = "the run is not paused: call pause with data: true first"
            return answered(RequestOutcome("RESULT_INCORRECT_STATE", line))
        if self._taken is not None:
            return answered(RequestOutcome("RESULT_INCORRECT_STATE", "steps are being taken"))
        future = Future()
        self._left, self._taken = steps, lambda outcome: future.set_result(answered(outcome))
        self._wake()
        return future

    # -- std_srvs ---------------------------------------------------------------------------------------------------

    def on_step(self, request: Trigger.Request, response: Trigger.Response) -> Any:
        """Take ``run.step_count`` steps of a paused run; the response is a future."""
        return self._take(self._run.get_parameter("run.step_count").value, partial(_with_outcome, response))

    def features(self) -> str:
        """Return the supported features of simulation_interfaces, one a line."""
        lines = [*FEATURES, *([STATE_FEATURE] if self._run.stored().result != "RESULT_FEATURE_UNSUPPORTED" else [])]
        return "\n".join(lines)

    # -- simulation_interfaces --------------------------------------------------------------------------------------

    def _offer_standard(self) -> None:
        services, self._messages = import_module(f"{STANDARD}.srv"), import_module(f"{STANDARD}.msg")
        for name, kind, call in (
            ("get_simulator_features", "GetSimulatorFeatures", self._features),
            ("get_simulation_state", "GetSimulationState", self._state),
            ("set_simulation_state", "SetSimulationState", self._set_state),
            ("reset_simulation", "ResetSimulation", self._reset),
            ("step_simulation", "StepSimulation", self._step),
        ):
            answer_later(self._run.create_service(getattr(services, kind), name, call))

    def _features(self, request: Any, response: Any) -> Any:
        known = self._messages.SimulatorFeatures
        response.features.features = [getattr(known, name) for name in FEATURES]
        response.features.custom_info = STATE_FEATURE
        return response

    def _state(self, request: Any, response: Any) -> Any:
        states = self._messages.SimulationState
        response.state.state = states.STATE_PAUSED if self._run.paused else states.STATE_PLAYING
        return self._answered(response, RequestOutcome("RESULT_OK", self._run.step_text()))

    def _set_state(self, request: Any, response: Any) -> Any:
        states, wanted = self._messages.SimulationState, request.state.state
        if wanted not in (states.STATE_PAUSED, states.STATE_PLAYING):
            line = f"state {wanted}: expected STATE_PLAYING or STATE_PAUSED"
            return self._answered(response, RequestOutcome("RESULT_FEATURE_UNSUPPORTED", line))
        if self._taken is None and self._run.paused == (wanted == states.STATE_PAUSED):
            response.result.result = type(response).ALREADY_IN_TARGET_STATE
            return response
        return self._answered(response, RequestOutcome("RESULT_OK", self._run.pause(wanted == states.STATE_PAUSED)))

    def _reset(self, request: Any, response: Any) -> Any:
        if request.scope != type(request).SCOPE_STATE:
            line = f"scope {request.scope}: expected SCOPE_STATE, since the time of a run goes on"
            return self._answered(response, RequestOutcome("RESULT_FEATURE_UNSUPPORTED", line))
        return self._answered(response, self._run.reset())

    def _step(self, request: Any, response: Any) -> Any:
        if request.steps < 1:
            return self._answered(response, RequestOutcome("RESULT_OPERATION_FAILED", "steps 0: expected 1 or more"))
        return self._take(request.steps, partial(self._answered, response))

    def _answered(self, response: Any, outcome: RequestOutcome) -> Any:
        response.result.result = getattr(self._messages.Result, outcome.result)
        is_done, line = outcome.answer
        response.result.error_message = "" if is_done else line
        return response


def answer_later(service: Any) -> None:
    """Let a service callback return a future: the executor itself sends the result at once and awaits nothing."""
    send = service.send_response

    def send_when_done(response: Any, header: Any) -> None:
        if isinstance(response, Future):
            response.add_done_callback(lambda future: send(future.result(), header))
        else:
            send(response, header)

    service.send_response = send_when_done


def _with_outcome(response: Trigger.Response, outcome: RequestOutcome) -> Trigger.Response:
    response.success, response.message = outcome.answer
    return response

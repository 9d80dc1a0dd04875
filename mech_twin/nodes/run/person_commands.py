# SPDX-License-Identifier: Apache-2.0
"""Commands of a person to the nodes of a running machine: one service call, with the node's answer or refusal."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParametersAtomically,
)
from rclpy.client import Client
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from mech_twin.declarations.captions import unknown_name
from mech_twin.messages.topics import DIAGNOSTICS, SPEED_COMMAND
from mech_twin.nodes.exchange.parameter_bridge import watch_parameters
from mech_twin.nodes.exchange.spinner import Spinner
from mech_twin.nodes.run.domain import UnansweredError
from mech_twin.parameters.live_change import COMMAND

LOOK_S = 0.01
ANSWER_S = 10.0  # an available service answers sooner, unless its node is suspended


class Order(NamedTuple):
    """A command: service below the machine's namespace, its type, and whether a fault's name is set before."""

    service: str
    kind: Any = Trigger
    of_a_fault: bool = False


ORDERS = {
    "start": Order("start"),
    "stop": Order("stop"),
    "reset": Order("reset"),
    "step": Order("step"),
    "snapshot": Order("recorder/snapshot"),
    "acknowledge": Order("monitor/acknowledge", of_a_fault=True),
    "shelve": Order("monitor/shelve", of_a_fault=True),
    "accept": Order("advisor/accept", SetBool),
    "reject": Order("advisor/reject", SetBool),
    "identify": Order("identifier/identify"),
    "take-over": Order("identifier/take_over"),
    "pause": Order("replay/pause"),
    "resume": Order("replay/resume"),
    "next-impact": Order("replay/next_impact"),
}
PAUSED = "paused"  # how the state of a paused run begins
PAUSES = {"pause": True, "resume": False}  # of a run, which has one service for both


class Teller:
    """Commands and live parameters for the nodes of one machine; a context manager, in the thread that uses it.

    Parameters
    ----------
    namespace : str
        Of the machine, such as its name.
    wait_s : float
        How long a service may take to be found (s).
    is_over : callable
        Tells whether the machine's run has ended: then a command is refused, and waits no longer.
    """

    def __init__(self, namespace: str, wait_s: float = 5.0, is_over: Callable[[], bool] = lambda: False) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node("teller", namespace="mech_twin")
        self._spinner = Spinner([self.node])
        self._namespace, self._wait_s, self._is_over = "/" + namespace.strip("/"), wait_s, is_over
        self._clients: dict[str, Client] = {}
        command = f"{self._namespace}/{SPEED_COMMAND.name}"
        self._speed = self.node.create_publisher(Float64, command, SPEED_COMMAND.qos)

    def order(self, order: str, fault: str | None = None) -> str:
        """Send a command of `ORDERS`; return the node's answer; raises as `tell` does."""
        asked = ORDERS[order]
        if order in PAUSES and self._pauses_run(asked):
            return f"{order}: {self.pause(PAUSES[order])}"
        if asked.of_a_fault:
            self.change({"fault": fault or ""}, asked.service.split("/", maxsplit=1)[0])
        request = SetBool.Request(data=True) if asked.kind is SetBool else Trigger.Request()
        answer = self._ask(asked.kind, asked.service, request)
        if not answer.success:
            raise UnansweredError(f"{order}: refused: {answer.message}")
        return f"{order}: {answer.message or 'done'}"

    def change(self, values: Mapping[str, Any], node: str = "linkage") -> str:
        """Change parameters of a node, all or none; return their new values; raises as `tell` does."""
        names, known = list(values), self._parameters(node)
        unknown = [name for name in names if name not in known]
        if unknown:
            drive = [COMMAND] if node == "linkage" else []
            raise UnansweredError(unknown_name(unknown[0], [*self._changeable(node, known), *drive], "parameter "))
        asked = GetParameterTypes.Request(names=names)
        types = self._ask(GetParameterTypes, f"{node}/get_parameter_types", asked).types
        absent = [name for name in names if values[name] is None]
        if absent:
            raise UnansweredError(f"{absent[0]}: has no value; expected {absent[0]}=VALUE")
        reals = {name for name, kind in zip(names, types, strict=True) if kind == ParameterType.PARAMETER_DOUBLE}
        numbers = {
            name: float(value) if name in reals and isinstance(value, int) and not isinstance(value, bool) else value
            for name, value in values.items()
        }
        changes = [Parameter(name, value=value).to_parameter_msg() for name, value in numbers.items()]
        request = SetParametersAtomically.Request(parameters=changes)
        answer = self._ask(SetParametersAtomically, f"{node}/set_parameters_atomically", request).result
        if not answer.successful:
            raise UnansweredError(f"{', '.join(numbers)}: refused: {answer.reason}")
        return ", ".join(f"{name} = {value}" for name, value in numbers.items())

    def values(self) -> dict[str, Any]:
        """Return the parameters of the linkage and their values; raises as `tell` does."""
        names = self._parameters("linkage")
        answer = self._ask(GetParameters, "linkage/get_parameters", GetParameters.Request(names=names))
        found = zip(names, map(parameter_value_to_python, answer.values), strict=True)
        return {name: list(value) if isinstance(value, array) else value for name, value in found if value is not None}

    def pause(self, wanted: bool) -> str:
        """Pause or continue a run; raises as `tell` does."""
        return str(self._ask(SetBool, "pause", SetBool.Request(data=wanted)).message)

    def set_speed(self, share: float) -> str:
        """Command a share of the rated speed.

        Raises
        ------
        UnansweredError
            If it is not between 0 and 1, or no motor subscribes.
        """
        if not 0.0 <= share <= 1.0:
            raise UnansweredError(f"speed {share:g}: expected 0 to 1 of the rated speed")
        if not self._wait(lambda: self._speed.get_subscription_count() > 0):
            raise UnansweredError(f"{self._speed.topic_name}: no motor listens; does the machine run?")
        self._speed.publish(Float64(data=share))
        self._speed.wait_for_all_acked(Duration(seconds=self._wait_s))
        return f"speed {share:.0%} of rated"

    def watch_parameters(self, changed: Callable[[str, Any], None]) -> None:
        """Call ``changed`` with name and value at each parameter change of the linkage."""
        watch_parameters(self.node, self._namespace, changed)

    def watch_pause(self, paused: Callable[[bool], None]) -> None:
        """Call ``paused`` with whether the run is paused, about once a second, from the linkage's diagnostics."""
        name = f"{self._namespace}/linkage"

        def on_diagnostics(message: DiagnosticArray) -> None:
            for status in message.status:
                if status.name == name:
                    paused(status.message.startswith(PAUSED))

        self.node.create_subscription(DIAGNOSTICS.type, DIAGNOSTICS.name, on_diagnostics, DIAGNOSTICS.qos)
        self._client(SetBool, "pause")  # found before it is asked

    def serve_until(self, holds: Callable[[], bool]) -> None:
        """Serve the node until a condition holds."""
        self._spinner.until(holds, LOOK_S)

    def _parameters(self, node: str) -> list[str]:
        """Return the names of all parameters of a node."""
        request = ListParameters.Request(depth=ListParameters.Request.DEPTH_RECURSIVE)
        return list(self._ask(ListParameters, f"{node}/list_parameters", request).result.names)

    def _changeable(self, node: str, names: list[str]) -> list[str]:
        """Return those of the names that a run may change."""
        request = DescribeParameters.Request(names=names)
        described = self._ask(DescribeParameters, f"{node}/describe_parameters", request).descriptors
        return [each.name for each in described if not each.read_only]

    def _ask(self, kind: Any, service: str, request: Any) -> Any:
        """Return the answer of a service; raises `UnansweredError`."""
        client = self._client(kind, service)
        name = client.srv_name
        if not self._wait(client.service_is_ready):
            raise UnansweredError(f"{name}: nobody offers this service after {self._wait_s:g} s; does the machine run?")
        answer = client.call_async(request)
        if not self._wait(answer.done, ANSWER_S):
            raise UnansweredError(f"{name}: no answer within {ANSWER_S:g} s")
        return answer.result()

    def _pauses_run(self, other: Order) -> bool:
        """Wait for the pause service of a run, or that of a replay; return whether the first is offered."""
        run, replay = self._client(SetBool, "pause"), self._client(other.kind, other.service)
        self._wait(lambda: run.service_is_ready() or replay.service_is_ready())
        return bool(run.service_is_ready())

    def _client(self, kind: Any, service: str) -> Client:
        name = f"{self._namespace}/{service}"
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        return self._clients[name]

    def _wait(self, holds: Callable[[], bool], limit_s: float | None = None) -> bool:
        """Wait for a condition, as long as for a service if no limit (s) is given; return whether it holds.

        Raises
        ------
        UnansweredError
            If the run has ended: another one of this name may be there by now.
        """
        end = time.monotonic() + (self._wait_s if limit_s is None else limit_s)
        self._spinner.until(lambda: holds() or self._is_over() or time.monotonic() > end, LOOK_S)
        if self._is_over():
            raise UnansweredError("the run that was told has ended")
        return holds()

    def __enter__(self) -> Teller:
        self._spinner.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._spinner.__exit__(*error)
        self.node.destroy_node()
        rclpy.try_shutdown()


def _share(values: Mapping[str, Any]) -> float:
    share = values[COMMAND]
    if len(values) > 1:
        raise UnansweredError(f"{COMMAND}: expected alone; it goes to the motor, live parameters to the linkage")
    if isinstance(share, bool) or not isinstance(share, int | float):
        raise UnansweredError(f"{COMMAND} {share}: expected 0 to 1 of the rated speed")
    return float(share)


def tell(
    namespace: str, order: str | None, values: Mapping[str, Any], fault: str | None = None, wait_s: float = 5.0
) -> str:
    """Send a command to the nodes of a machine, or change its live parameters; return their answer.

    Parameters
    ----------
    namespace : str
        Of the machine, such as its name.
    order : str or None
        A name of `ORDERS`; None to change parameters.
    values : mapping
        Live parameters and their values, validated as a whole; or ``motor.command`` alone, a share of the rated speed.
    fault : str or None
        The fault that is acknowledged or shelved; None: all.
    wait_s : float
        How long the service may take to be found (s).

    Raises
    ------
    UnansweredError
        If the nodes are absent, do not answer, or refuse.
    """
    with Teller(namespace, wait_s) as teller:
        if COMMAND in values:
            return teller.set_speed(_share(values))
        return teller.change(values) if order is None else teller.order(order, fault)

# SPDX-License-Identifier: Apache-2.0
"""Server of a running machine for Foxglove: its topics, and, if allowed, its live parameters and services.

A topic is subscribed only while a client shows it.  The server requires no token: see SECURITY.md.
"""

from __future__ import annotations

import json
import queue
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from functools import partial
from importlib import import_module
from typing import Any

import foxglove
from foxglove.websocket import Capability, MessageSchema, Parameter, ServerListener, Service, ServiceSchema
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from mech_twin.messages.topics import DIAGNOSTICS
from mech_twin.nodes.run.bench_process import GO_ON, carried_out
from mech_twin.nodes.run.domain import UnansweredError
from mech_twin.nodes.run.person_commands import Teller
from mech_twin.recording.errors import UnknownTypeError
from mech_twin.recording.schemas import message_schema

LOOPBACK = "127.0.0.1"
LOOK_S = 0.5  # period of the search for new topics
ANSWER_S = 15.0
DEPTH = 100
LATCHED = DurabilityPolicy.TRANSIENT_LOCAL
GLOBAL = ("/tf", "/tf_static", DIAGNOSTICS.name)
SERVICES = ("start", "stop", "reset", "pause", GO_ON, "step")
VALUES = "values"
Answered = Future[tuple[Any, bool]]  # message of a request, and whether it succeeded
NOTHING = {"type": "object", "properties": {}}
OUTCOME = {"type": "object", "properties": {"success": {"type": "boolean"}, "message": {"type": "string"}}}


class _Listener(ServerListener):
    """Listener that queues the requests of clients for the node."""

    def __init__(self, server: FoxgloveServer) -> None:
        self._server = server

    def on_subscribe(self, client: Any, channel: Any) -> None:
        self._server.wanted[channel.topic] = self._server.wanted.get(channel.topic, 0) + 1
        self._server.begun.add(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        self._server.wanted[channel.topic] = self._server.wanted.get(channel.topic, 1) - 1

    def on_get_parameters(self, client: Any, param_names: list[str], request_id: str | None = None) -> list[Parameter]:
        known, is_answered = self._server.ask({"name": VALUES})
        if not is_answered:
            self._server.complain(str(known))
            return []
        return [Parameter(name, value=known[name]) for name in param_names or known if name in known]

    def on_set_parameters(
        self, client: Any, parameters: list[Parameter], request_id: str | None = None
    ) -> list[Parameter]:
        changes = {each.name: each.get_value() for each in parameters if each.get_value() is not None}
        answer, is_done = self._server.ask({"name": "change", "values": changes})
        if not is_done:
            self._server.complain(str(answer))
        return self.on_get_parameters(client, list(changes))


class FoxgloveServer:
    """The Foxglove server of one machine.

    Parameters
    ----------
    namespace : str
        Namespace of the machine.
    port : int
        TCP port on the loopback interface; 0 selects a free one.
    commands : bool
        Whether clients may set live parameters and call services.

    Raises
    ------
    OSError
        The port is in use.
    """

    def __init__(self, namespace: str, port: int, *, commands: bool) -> None:
        self.namespace = "/" + namespace.strip("/")
        self.wanted: dict[str, int] = {}
        self.begun: set[str] = set()  # topics that a further client has begun to show
        self._tasks: queue.Queue[tuple[Mapping[str, Any], Answered]] = queue.Queue()
        self._context = foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        self._subscriptions: dict[str, Subscription] = {}
        try:
            self._server = foxglove.start_server(
                name=f"mech_twin {namespace}",
                host=LOOPBACK,
                port=port,
                context=self._context,
                capabilities=[Capability.Parameters, Capability.Services] if commands else [],
                server_listener=_Listener(self),
                supported_encodings=["json"] if commands else [],
                services=[self._service(order) for order in SERVICES] if commands else [],
            )
        except RuntimeError as error:
            raise OSError(f"port {port}: {error}") from error
        self.port = self._server.port

    def serve(
        self, is_over: Callable[[], bool], wait_s: float = 2.0, absent: Callable[[], None] = lambda: None
    ) -> None:
        """Relay topics and execute requests of clients until ``is_over``; call ``absent`` if no node is found."""
        silent_s = time.monotonic() + wait_s
        with Teller(self.namespace, wait_s) as teller:
            teller.watch_parameters(self._changed)
            while not is_over():
                self._look(teller)
                if time.monotonic() > silent_s:
                    silent_s = float("inf")
                    if all(space != self.namespace for _, space in teller.node.get_node_names_and_namespaces()):
                        absent()
                end = time.monotonic() + LOOK_S
                teller.serve_until(partial(self._is_due, is_over, end))
                while not self._tasks.empty():
                    message, answered = self._tasks.get()
                    answered.set_result(_done(teller, message))

    def ask(self, message: Mapping[str, Any]) -> tuple[Any, bool]:
        """Execute a request in the serving thread; return its message, and whether it succeeded."""
        answered = Answered()
        self._tasks.put((message, answered))
        try:
            return answered.result(ANSWER_S)
        except FutureTimeoutError:
            return f"{message['name']}: no answer within {ANSWER_S:g} s", False

    def complain(self, text: str) -> None:
        """Report a refusal to the clients."""
        self._server.publish_status(text, foxglove.websocket.StatusLevel.Warning)

    def close(self) -> None:
        """Disconnect the clients."""
        self._server.stop()

    def _is_due(self, is_over: Callable[[], bool], end_s: float) -> bool:
        return is_over() or not self._tasks.empty() or time.monotonic() > end_s

    def _changed(self, name: str, value: Any) -> None:
        self._server.publish_parameter_values([Parameter(name, value=value)])

    def _look(self, teller: Teller) -> None:
        """Advertise the existing topics, and subscribe to those that clients show, to latched ones anew for each."""
        node, begun = teller.node, {self.begun.pop() for _ in range(len(self.begun))}
        for name, kinds in node.get_topic_names_and_types():
            if name not in self._channels and (name.startswith(f"{self.namespace}/") or name in GLOBAL):
                self._offer(name, kinds[0])
        for name, channel in self._channels.items():
            looked_at, subscription = self.wanted.get(name, 0) > 0, self._subscriptions.get(name)
            is_latched = subscription is not None and subscription.qos_profile.durability is LATCHED
            if subscription is not None and (not looked_at or (is_latched and name in begun)):
                node.destroy_subscription(self._subscriptions.pop(name))
                subscription = None
            if looked_at and subscription is None:
                publishers = node.get_publishers_info_by_topic(name)
                if publishers:
                    offered = publishers[0].qos_profile
                    qos = QoSProfile(depth=DEPTH, reliability=offered.reliability, durability=offered.durability)
                    kind = _message(channel.schema_name() or "")
                    self._subscriptions[name] = node.create_subscription(kind, name, channel.log, qos, raw=True)

    def _offer(self, name: str, kind: str) -> None:
        try:
            text = message_schema(kind).definition.encode()
        except UnknownTypeError:
            return
        schema = foxglove.Schema(name=kind, encoding="ros2msg", data=text)
        self._channels[name] = foxglove.Channel(name, schema=schema, message_encoding="cdr", context=self._context)

    def _service(self, order: str) -> Service:
        schema = ServiceSchema(
            order, request=_schema(f"{order}_request", NOTHING), response=_schema(f"{order}_response", OUTCOME)
        )
        return Service(f"{self.namespace}/{order}", schema=schema, handler=partial(self._called, order))

    def _called(self, order: str, request: Any) -> bytes:
        text, is_done = self.ask({"name": order})
        return json.dumps({"success": is_done, "message": text}).encode()


def _done(teller: Teller, message: Mapping[str, Any]) -> tuple[Any, bool]:
    if message["name"] != VALUES:
        return carried_out(teller, message)
    try:
        return teller.values(), True
    except UnansweredError as error:
        return str(error), False


def _message(kind: str) -> Any:
    package, _, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def _schema(name: str, content: Mapping[str, Any]) -> MessageSchema:
    schema = foxglove.Schema(name=name, encoding="jsonschema", data=json.dumps(content).encode())
    return MessageSchema(encoding="json", schema=schema)

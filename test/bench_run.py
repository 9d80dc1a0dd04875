# SPDX-License-Identifier: Apache-2.0
"""Nodes on a bench: spun by the test itself, with a client beside them; role nodes, or a shadow and its company."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Self

import rclpy
from catalogue import built
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.messages.topics import Topic, full_name
from mech_twin.nodes.exchange.base_node import RunOptions, TwinNode
from mech_twin.nodes.exchange.spinner import Spinner, destroy_nodes
from mech_twin.nodes.roles.linkage_node import LinkageNode
from mech_twin.nodes.run.composition import role_nodes
from mech_twin.nodes.shadow.session import Company, nodes_beside
from mech_twin.nodes.shadow.shadow_node import ShadowNode, ShadowSetup
from mech_twin.samples import LinkageSample

LIMIT_S = 15.0


class Bench:
    """Nodes of the twin, made by a call, and a client node that is none of them."""

    limit_s = LIMIT_S

    def __init__(self, namespace: str, make: Callable[[], list[TwinNode]]) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.nodes = make()
        self.client = rclpy.create_node("client", namespace=namespace)
        self.spinner = Spinner([*self.nodes, self.client])

    def add(self, node: Any) -> None:
        """Serve a further node."""
        self.nodes.append(node)
        self.spinner.add(node)

    def until(self, predicate: Callable[[], bool]) -> None:
        """Spin until something holds; fail if it does not within the limit."""
        end = time.monotonic() + self.limit_s
        self.spinner.until(lambda: predicate() or time.monotonic() > end)
        assert predicate(), "did not happen within the limit"

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Return a service's answer."""
        client = self.client.create_client(kind, service)
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.spinner.__exit__(*error)
        destroy_nodes(self.nodes)
        self.client.destroy_node()
        rclpy.try_shutdown()


class BenchRun(Bench):
    """Role nodes of a machine."""

    def __init__(self, name: str, **options: Any) -> None:
        self.name = name
        self.options = RunOptions(pace="max", **options)
        super().__init__(f"/{name}", lambda: [*role_nodes(name, built(name).parameters, self.options)])
        self.samples: list[LinkageSample] = []
        self._watch(self.linkage)

    @property
    def linkage(self) -> LinkageNode:
        return next(node for node in self.nodes if isinstance(node, LinkageNode))

    def node(self, role: str) -> Any:
        return next(node for node in self.nodes if node.get_name() == role)

    def _watch(self, linkage: LinkageNode) -> None:
        linkage.on_sample = self.samples.append

    def steps(self, number: int) -> None:
        """Spin until so many further steps are taken."""
        goal = len(self.samples) + number
        self.until(lambda: len(self.samples) >= goal)

    def spin_for(self, seconds: float) -> None:
        """Spin for a time, whatever happens."""
        end = time.monotonic() + seconds
        self.spinner.until(lambda: time.monotonic() > end)

    def set_parameters(self, node: str, **values: float) -> Any:
        """Return the results of setting parameters on a node, as a user would."""
        from rcl_interfaces.srv import SetParameters

        parameters = [Parameter(key.replace("__", "."), value=value) for key, value in values.items()]
        request = SetParameters.Request(parameters=[parameter.to_parameter_msg() for parameter in parameters])
        return self.call(SetParameters, f"{node}/set_parameters", request).results

    def publisher(self, topic: Topic) -> Any:
        """Return a matched publisher of the client on one of the machine's topics."""
        publisher = self.client.create_publisher(topic.type, full_name(self.name, topic), topic.qos)
        self.until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def kill(self, role: str) -> None:
        """Take a node away without a word."""
        node = self.node(role)
        self.nodes.remove(node)
        for output in node.outputs:
            output.send = lambda message: None  # what the executor still holds for it must not speak
        self.spinner.remove(node)
        self.spin_for(0.05)
        destroy_nodes([node])

    def revive(self, make: Callable[[str, Any, RunOptions], TwinNode]) -> TwinNode:
        """Bring a node back, as new as a restarted process."""
        node = make(self.name, built(self.name).parameters, self.options)
        self.add(node)
        if isinstance(node, LinkageNode):
            self._watch(node)
        return node


class ShadowBench(Bench):
    """A shadow that follows ``/plant`` by a map, with its company, and a client in the place of the machine."""

    limit_s = 60.0

    def __init__(self, name: str, given: MeasurementMap, company: Company, **options: Any) -> None:
        parameters = built(name).parameters

        def make() -> list[TwinNode]:
            shadow = ShadowNode(name, ShadowSetup("/plant", given), parameters, RunOptions(**options))
            return [shadow, *nodes_beside(name, shadow, parameters, company)]

        super().__init__("/plant", make)
        self.shadow = self.of(ShadowNode)

    def of(self, kind: type[Any]) -> Any:
        """Return the node of this class."""
        return next(node for node in self.nodes if isinstance(node, kind))

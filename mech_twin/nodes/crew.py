"""The nodes of a machine in one process, spun on one executor until the run is over."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

from mech_twin.nodes.body_node import BodyNode
from mech_twin.nodes.force_node import ForceNode
from mech_twin.nodes.linkage_node import LinkageNode
from mech_twin.nodes.motor_node import MotorNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.role_node import RoleNode
from mech_twin.quantity import Parameters

LONGEST_WAIT_S = 0.1
SHORTEST_WAIT_S = 1e-4


def role_nodes(machine_name: str, parameters: Parameters | None, options: RunOptions) -> list[RoleNode]:
    """Return the role nodes of a machine, the linkage last; a machine without a moving body has no body node."""
    nodes: list[RoleNode] = [MotorNode(machine_name, parameters, options), ForceNode(machine_name, parameters, options)]
    if nodes[0].machine.body is not None:
        nodes.append(BodyNode(machine_name, parameters, options))
    nodes.append(LinkageNode(machine_name, parameters, options))
    return nodes


def spin(nodes: Sequence[Node], until: Callable[[], bool]) -> None:
    """Serve the nodes until the run is over, a signal comes, or rclpy is shut down.

    Never ``executor.spin()``: in these wheels it does not end on a signal.
    """
    executor = EventsExecutor()
    linkages = [node for node in nodes if isinstance(node, LinkageNode)]
    for node in nodes:
        executor.add_node(node)
    try:
        while rclpy.ok() and not until():
            wait = min([LONGEST_WAIT_S, *(node.wait_s() for node in linkages)])
            executor.spin_once(timeout_sec=max(wait, SHORTEST_WAIT_S))
            for node in linkages:
                node.tick()
    finally:
        for node in nodes:
            executor.remove_node(node)
        executor.shutdown()

"""A shadow from beginning to end: the name checked, the node spun until a signal or its time is over."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import rclpy
from rclpy.signals import SignalHandlerOptions

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.messages.topics import ESTIMATED, RESIDUALS, TWIN
from mech_twin.nodes.base_node import TwinNode, destroy_nodes, sent_messages
from mech_twin.nodes.name_guard import NameGuard
from mech_twin.nodes.namespace import run_namespace
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.shadow_node import ShadowNode, ShadowSetup
from mech_twin.nodes.shadow_recorder import ShadowRecorder
from mech_twin.nodes.spinner import Spinner
from mech_twin.quantity import Parameters
from mech_twin.stop_signal import StopSignal


class ShadowOutcome(NamedTuple):
    """What a shadow came to: its last diagnostic values, and messages sent by topic."""

    values: dict[str, str]
    sent: dict[str, int]


def followed_namespace(machine_name: str, told: str) -> str:
    """Return the full namespace of the machine that is followed.

    Raises
    ------
    ConfigurationError
        It is no name of ROS, or the shadow's own.
    """
    full = run_namespace(machine_name, told)
    own = f"/{machine_name}/{TWIN}"
    if f"{full}/".startswith(f"{own}/"):
        raise ConfigurationError(f"--from {told}: expected the machine's namespace, {own} is the shadow's own")
    return full


def follow(
    machine_name: str,
    setup: ShadowSetup,
    parameters: Parameters,
    directory: Path | None = None,
    duration_s: float = 0.0,
    ready: Callable[[ShadowNode], None] = lambda node: None,
) -> ShadowOutcome:
    """Follow a machine until a signal, or for a duration.

    Parameters
    ----------
    machine_name, setup, parameters
        The model, and whom it follows.
    directory : Path, optional
        Recording of the machine's topics and the shadow's.
    duration_s : float
        Time (s) after which it ends by itself; 0: never.
    ready : callable
        Told the node when it listens.

    Raises
    ------
    NameInUseError
        Another shadow of this machine is alive.
    """
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[TwinNode] = []
    with StopSignal() as signal, ExitStack() as at_end, ExitStack() as starting:
        at_end.callback(rclpy.try_shutdown)
        at_end.callback(destroy_nodes, nodes)
        starting.enter_context(signal.interrupting())
        guard = starting.enter_context(NameGuard([f"/{machine_name}/{topic.name}" for topic in (ESTIMATED, RESIDUALS)]))
        node = ShadowNode(machine_name, setup, parameters, RunOptions())
        nodes.append(node)
        guard.check(own_publishers=1)
        starting.close()
        if directory is not None:
            nodes.append(ShadowRecorder(machine_name, directory, node, parameters))
        ready(node)
        end_s = time.monotonic() + duration_s if duration_s > 0.0 else float("inf")
        with Spinner(nodes) as spinner:
            spinner.until(lambda: signal.asked or time.monotonic() > end_s)
        node.report()
        return ShadowOutcome(node.diagnostic_values(), sent_messages([node]))

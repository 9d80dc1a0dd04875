# SPDX-License-Identifier: Apache-2.0
"""A replay from start to end: serves the node, executes keys, reports progress."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import NamedTuple

import rclpy
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from mech_twin.nodes.exchange.peers import other_clocks
from mech_twin.nodes.exchange.spinner import Spinner, destroy_nodes
from mech_twin.nodes.replay import FASTEST, SLOWEST
from mech_twin.nodes.replay.replay_node import ReplayNode, ReplayOptions
from mech_twin.nodes.replay.source import ReplaySource
from mech_twin.nodes.run.console import TerminalKeys
from mech_twin.nodes.run.domain import replay_arguments
from mech_twin.nodes.run.name_guard import NameGuard
from mech_twin.process.stop_signal import StopSignal

ARRIVAL_LIMIT_S = 1.0
FASTER = 1.25
KEYS = "space: pause or go on, n: next impact, +/-: faster or slower, q: quit"


class ReplayOutcome(NamedTuple):
    """Result of a replay: messages by topic."""

    published: dict[str, int]
    malformed: dict[str, int]
    refused: dict[str, int]
    unknown: dict[str, str]


def replayed(
    source: ReplaySource,
    options: ReplayOptions,
    progress: Callable[[ReplayNode], None],
    namespace: str | None = None,
) -> ReplayOutcome:
    """Replay a bag until its end, a signal or the key that quits.

    Parameters
    ----------
    source, options
        The recording, and the options.
    progress : callable
        Called with the node repeatedly.
    namespace : str, optional
        Namespace of the topics instead of the recorded one.

    Raises
    ------
    NameInUseError
        If a run or another replay is alive there.
    """
    names = {name: source.below(name) for name in source.topics}
    rclpy.init(args=replay_arguments(names, namespace), signal_handler_options=SignalHandlerOptions.NO)
    node: ReplayNode | None = None
    try:
        with StopSignal() as stop, TerminalKeys() as keys, ExitStack() as at_end:
            node = ReplayNode(source, options)
            steps = [node.resolve_topic_name(name) for name, topic in source.topics.items() if topic.kind is JointState]
            with stop.interrupting():
                at_end.enter_context(NameGuard(steps)).check(own_publishers=1)
            clocks = other_clocks(node)
            if clocks:
                node.get_logger().warning(clocks)
            if keys.listening:
                node.get_logger().info(KEYS)
            with Spinner([node]) as spinner:
                spinner.until(partial(_is_over, node, stop, keys, progress))
            node.finish(0.0 if stop.asked else ARRIVAL_LIMIT_S)
            published = {name: output.published for name, output in node.outputs.items()}
            refused = {name: output.refused for name, output in node.outputs.items() if output.refused}
            return ReplayOutcome(published, dict(source.malformed), refused, dict(source.unknown))
    finally:
        if node is not None:
            destroy_nodes([node])
        rclpy.try_shutdown()


def _is_over(node: ReplayNode, stop: StopSignal, keys: TerminalKeys, progress: Callable[[ReplayNode], None]) -> bool:
    """Obey the keys and report progress; return whether the replay is over."""
    for key in keys.pressed():
        obey(node, key)
    progress(node)
    return stop.asked or node.done


def obey(node: ReplayNode, key: str) -> None:
    """Execute the command of a key; other keys do nothing."""
    if key == " ":
        node.get_logger().info(node.resume() if node.paused else node.pause())
    elif key == "n":
        found, line = node.go_to_next_impact()
        if not found:
            node.get_logger().info(line)
    elif key in "+=":
        _change_rate(node, node.rate * FASTER)
    elif key in "-_":
        _change_rate(node, node.rate / FASTER)
    elif key == "q":
        node.done = True


def _change_rate(node: ReplayNode, rate: float) -> None:
    node.set_parameters([Parameter("rate", value=min(max(rate, SLOWEST), FASTEST))])
    node.get_logger().info(f"rate {node.rate:.4g}")

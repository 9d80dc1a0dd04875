# SPDX-License-Identifier: Apache-2.0
"""Who else tells simulation time on the clock's topic: two clocks on one topic make time jump for who follows it."""

from __future__ import annotations

from rclpy.node import Node

from mech_twin.messages.topics import CLOCK


def other_clocks(node: Node) -> str:
    """Return one line that names the other publishers of a node's clock and what to do; empty if there is none."""
    topic = node.resolve_topic_name(CLOCK.name)
    found = {f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in node.get_publishers_info_by_topic(topic)}
    own = node.get_fully_qualified_name()
    if found <= {own} or own not in found:
        return ""
    others = ", ".join(sorted(found - {own}))
    return f"{topic} is published by {others} as well: with --namespace a run or replay has a clock of its own"

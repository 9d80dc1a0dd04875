# SPDX-License-Identifier: Apache-2.0
"""Takes the nodes of a process down within a bound, since the middleware may never let go.

Fast DDS 2.14 waits until no callback of its discovery runs before it takes a participant down, in a loop that hardly
ever leaves the lock which those callbacks need to end: of nodes that all end at one instant about one in a thousand
went on for ever.  The interpreter's lock is held meanwhile, so no thread and no handler of the process can act.  The
kernel can: by then all that was open is closed.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rclpy.node import Node

from mech_twin.nodes.base_node import TwinNode

LIMIT_S = 4.0  # it takes a tenth of a second, on a busy machine one


def destroy_nodes(nodes: Sequence[Node]) -> None:
    """Close what nodes hold open, then take them down; with the last of a process goes the middleware."""
    for node in nodes:
        if isinstance(node, TwinNode):
            node.close()
    with _bounded():
        for node in nodes:
            node.destroy_node()


@contextmanager
def _bounded() -> Iterator[None]:
    """Let SIGALRM end the process where this takes longer than its limit."""
    handler = signal.signal(signal.SIGALRM, signal.SIG_DFL)
    remaining_s, interval_s = signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, remaining_s, interval_s)
        signal.signal(signal.SIGALRM, handler)

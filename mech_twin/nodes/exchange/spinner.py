# SPDX-License-Identifier: Apache-2.0
"""The one executor of a process: serves its nodes until a condition holds, and shuts them down within a time limit.

The middleware may hang at shutdown.  Fast DDS 2.14 waits for its discovery callbacks before it deletes a participant,
in a loop that rarely releases the lock those callbacks need.  Of nodes that all end at one instant about one in a
thousand hung for ever.  The interpreter's lock is held meanwhile, so no thread or handler of the process can act.
The operating system can: an alarm ends the process, whose files are closed by then.
"""

from __future__ import annotations

import gc
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future

from mech_twin.nodes.exchange.base_node import TwinNode
from mech_twin.nodes.exchange.counting import StepPublisher
from mech_twin.nodes.exchange.direct_exchange import HandOver

LONGEST_WAIT_S = 0.1
SHORTEST_WAIT_S = 1e-4
SLICE_S = 0.02
LATE_S = 0.2  # between two looks: what waits in the executor takes that long
LONGEST_SLICE_S = 1.0
BY_MESSAGE_S = 1.0  # spin message by message for so long after a call of ``interrupt``
# a step makes some thousand short-lived tuples: with the default thresholds the garbage collector takes a twentieth of
# a run to search them for cycles
GARBAGE_THRESHOLDS = (50_000, 20, 50)


@runtime_checkable
class Ticking(Protocol):
    """A node with tasks between messages.

    Attributes
    ----------
    interrupt : callable
        To be called when a message makes a task due earlier than the last ``tick`` returned.
    """

    interrupt: Callable[[], None]

    def tick(self) -> float:
        """Run the due tasks; return the time to the next one (s)."""
        ...


class Spinner:
    """A context in which nodes are served.

    One executor is used as long as the nodes live: a second one is not notified of messages already waiting.  Its own
    ``spin()`` is never called: in these wheels it does not end on a signal.

    Attributes
    ----------
    patient : list of callable
        Called some fifty times a second, when steps are delivered to patient listeners, and at the end.
    """

    def __init__(self, nodes: Iterable[Node] = ()) -> None:
        self.nodes: list[Node] = []
        self._executor = EventsExecutor()
        self._steps = HandOver()
        self._slice = Future()
        self._by_message_until_s = 0.0
        self._behind = False
        self._slice_end_s = 0.0
        self.patient: list[Callable[[], None]] = []
        self._thresholds = gc.get_threshold()
        for node in nodes:
            self.add(node)

    def add(self, node: Node) -> None:
        """Add a node to the executor."""
        self.nodes.append(node)
        self._executor.add_node(node)
        if isinstance(node, TwinNode):
            node.join(self._steps)

    def remove(self, node: Node) -> None:
        """Stop serving a node; a patient one still receives the steps queued for it."""
        self._serve_patient()
        self.nodes.remove(node)
        if isinstance(node, TwinNode):
            node.leave()
        self._executor.remove_node(node)

    def until(self, predicate: Callable[[], bool], look_s: float = LONGEST_WAIT_S) -> None:
        """Spin until the predicate, evaluated after each message and period (s), holds or rclpy is shut down."""
        ticking = [node for node in self.nodes if isinstance(node, Ticking)]
        running, spin_once = rclpy.get_default_context().ok, self._executor.spin_once
        while running() and not predicate():
            if self._steps.waiting:
                self._steps.deliver()
                self._serve_others()
            else:
                self._serve_patient()
                spin_once(timeout_sec=min(look_s, _wait_s(ticking)))
        self._serve_patient()

    def serve(self, ended: Callable[[], bool]) -> None:
        """Serve the nodes until a run has ended, which is checked some fifty times a second, or rclpy is shut down.

        Between two checks (a slice) the executor processes messages by itself, unless a node calls ``interrupt``.
        A node that waits for the wall clock is served message by message.  So are nodes whose messages come faster than
        they are served: a slice, also one with a time limit, ends only after all that waited before, which takes ever
        longer.  Each slice leaks some bytes in rclpy, so a slice lasts until a task is due.
        """
        ticking = [node for node in self.nodes if isinstance(node, Ticking)]
        for node in ticking:
            node.interrupt = self._interrupt
        first, running = self.nodes[0], rclpy.get_default_context().ok

        looked_s = time.monotonic()

        def look() -> None:
            nonlocal looked_s
            self._behind, looked_s = time.monotonic() > looked_s + LATE_S, time.monotonic()
            if self._behind or not running() or ended() or self._steps.waiting or _wait_s(ticking) < SLICE_S:
                self._slice.set_result(None)

        timer = first.create_timer(SLICE_S, look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        try:
            while running() and not ended():
                self._deliver_all()
                if self._steps.waiting:
                    continue
                self._serve_others()
                wait_s = _wait_s(ticking)
                if self._behind or wait_s < SLICE_S or self._steps.used or time.monotonic() < self._by_message_until_s:
                    self._executor.spin_once(timeout_sec=wait_s)
                else:
                    self._slice = Future()
                    self._executor.spin_until_future_complete(self._slice, timeout_sec=LONGEST_SLICE_S)
            self._serve_patient()
        finally:
            first.destroy_timer(timer)

    def _deliver_all(self) -> None:
        """Deliver queued steps, and those they cause, until other work is due."""
        steps = self._steps
        while steps.waiting and not self._serve_others():
            steps.deliver()

    def _serve_others(self) -> bool:
        """Serve patient listeners and the executor if a slice is over; return whether it is."""
        if time.monotonic() < self._slice_end_s:
            return False
        self._serve_patient()
        self._drain()
        self._slice_end_s = time.monotonic() + SLICE_S
        return True

    def _serve_patient(self) -> None:
        self._steps.deliver_later()
        for call in self.patient:
            call()

    def _drain(self) -> None:
        """Serve everything now waiting in the executor, by adding a task and waiting for it."""
        end_s = time.monotonic() + LONGEST_SLICE_S
        task = self._executor.create_task(int)
        while not task.done() and time.monotonic() < end_s:
            self._executor.spin_once(timeout_sec=SHORTEST_WAIT_S)

    def _interrupt(self) -> None:
        self._by_message_until_s = time.monotonic() + BY_MESSAGE_S
        self._slice.set_result(None)

    def __enter__(self) -> Spinner:
        gc.freeze()  # loaded modules stay; collecting over them repeatedly would stop a run for 0.15 s
        self._thresholds = gc.get_threshold()
        gc.set_threshold(*GARBAGE_THRESHOLDS)
        return self

    def __exit__(self, *_: object) -> None:
        for node in list(self.nodes):
            self.remove(node)
        self._executor.shutdown()
        gc.set_threshold(*self._thresholds)
        gc.unfreeze()


def _wait_s(ticking: Iterable[Ticking]) -> float:
    """Return how long to wait for a message (s): until a task is due."""
    wait_s = LONGEST_WAIT_S
    for node in ticking:
        wait_s = min(wait_s, node.tick())
    return max(wait_s, SHORTEST_WAIT_S)


ARRIVAL_LIMIT_S = 0.4  # a run ends within a second; the middleware asks for acknowledgements every 3 s only
LOOK_S = 0.01
LIMIT_S = 4.0  # usually 0.1 s, on a busy machine 1 s


def destroy_nodes(nodes: Sequence[Node]) -> None:
    """Close the resources of nodes, then destroy them; the middleware ends with the last node of a process.

    Steps that have not arrived would be lost with their publisher, so subscribers of other processes get some time.
    """
    twins = [node for node in nodes if isinstance(node, TwinNode)]
    for twin in twins:
        twin.close()
    steps = [output for twin in twins for output in twin.outputs if isinstance(output, StepPublisher)]
    end_s = time.monotonic() + ARRIVAL_LIMIT_S
    while not all(output.arrived for output in steps) and time.monotonic() < end_s:
        time.sleep(LOOK_S)
    with _bounded():
        for node in nodes:
            node.destroy_node()


@contextmanager
def _bounded() -> Iterator[None]:
    """End the process by SIGALRM if the block takes longer than its time limit."""
    handler = signal.signal(signal.SIGALRM, signal.SIG_DFL)
    remaining_s, interval_s = signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, remaining_s, interval_s)
        signal.signal(signal.SIGALRM, handler)

"""The recorder node: every topic of a machine, raw, to an MCAP recording."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from mech_twin.messages.topics import (
    CLOCK,
    EVERY,
    EVERY_LATCHED,
    LATCHED,
    Topic,
    recorded_topics,
    step_topics,
    type_name,
)
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.role_node import RoleNode
from mech_twin.parameters.load import description_text
from mech_twin.quantity import Parameters
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.schemas import offered_qos
from mech_twin.recording.stamps import stamp_ns

TICK_S = 0.1
TICKS_PER_LOSS = 0.2
MIB = 1024.0 * 1024.0


class RecorderNode(RoleNode):
    """Writes what it hears; the log time of a message is the simulated time it belongs to.

    Parameters
    ----------
    directory : Path
        The recording to make.  See `RoleNode` for the other arguments.
    """

    def __init__(
        self,
        machine_name: str,
        directory: Path,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
    ) -> None:
        super().__init__("recorder", machine_name, parameters, options)
        self.last_heard_s = time.monotonic()
        self._now_ns = 0
        self._step_ns = round(self.machine.coupling_step_s * 1e9)
        text = description_text(machine_name, self.machine.parameters)
        self.writer = BagWriter(
            directory,
            configuration=text,
            max_loss_s=self.options.max_loss_s,
            fsync=self.options.fsync,
            split_bytes=round(self.options.split_mib * MIB),
            split_duration_s=self.options.split_s or None,
        )
        self._last_step: dict[str, int] = {}
        has_body = self.machine.body is not None
        self._steps = {topic.name for topic in step_topics(has_body)}
        for topic in recorded_topics(self.machine.forces.pins, has_body):
            self._record(topic)
        self.every(TICK_S, self._tick)

    @property
    def received(self) -> dict[str, int]:
        """Messages heard, by full topic name."""
        return {name: row.received for name, row in self.writer.counters.items()}

    def quiet_s(self) -> float:
        """Return for how long nothing has come to be recorded."""
        return time.monotonic() - self.last_heard_s

    def figures(self) -> dict[str, str]:
        """Return the state of the writer and what it dropped."""
        counters = self.writer.counters.values()
        return {
            "recording": str(self.writer.directory),
            "written": str(sum(row.written for row in counters)),
            "dropped": str(sum(row.dropped for row in counters)),
            "missed": str(sum(row.missed for row in counters)),
        }

    def close(self) -> None:
        """Finish the recording; one in which nothing was recorded is deleted."""
        self.writer.close(discard_empty=True)

    def _record(self, topic: Topic) -> None:
        name = self.resolve_topic_name(topic.name)
        kind = type_name(topic)
        latched = topic.qos is LATCHED
        durability = "transient_local" if latched else "volatile"
        self.writer.add_topic(name, kind, offered_qos(durability=durability, depth=topic.qos.depth))
        heard = partial(self._on_message, name, kind, latched, topic.name in self._steps)
        self.create_subscription(topic.type, topic.name, heard, EVERY_LATCHED if latched else EVERY, raw=True)

    def _on_message(self, name: str, kind: str, latched: bool, is_step: bool, raw: bytes) -> None:
        self.last_heard_s = time.monotonic()
        stamp = stamp_ns(kind, raw)
        if is_step and stamp is not None:  # the steps are the time of a recording, whatever /clock says
            self._now_ns = stamp
            self._watch_sequence(name, stamp)
        at = self._now_ns if stamp is None or name == CLOCK.name else stamp
        self.writer.write(name, raw, at, at, latched=latched)

    def _watch_sequence(self, name: str, stamp: int) -> None:
        step = round(stamp / self._step_ns)
        last = self._last_step.get(name, step - 1)
        if step > last + 1:
            self.writer.count_missed(name, step - last - 1)
            self.ledger.count(name, "missing", f"step {step} after {last}", step - last - 1)
        elif step <= last:
            self.writer.count_late(name)
            self.ledger.count(name, "repeated" if step == last else "late", f"step {step} after {last}")
        self._last_step[name] = max(step, last)

    def _tick(self) -> None:
        self.time_s = self._now_ns * 1e-9
        self.writer.tick()
        self.health.state = self.writer.state.value
        if self.writer.state is WriterState.ERROR:
            self.health.error(self.writer.error)

"""Records what a shadow hears and what it says, in one bag."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rclpy.qos import QoSProfile

from mech_twin.messages.topics import DIAGNOSTICS, EVERY, Topic, shadow_topics, type_name
from mech_twin.nodes.base_node import TwinNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.shadow_node import FOLLOWED, ShadowNode
from mech_twin.parameters.load import catalogue_entry, description_text
from mech_twin.quantity import Parameters
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.schemas import offered_qos
from mech_twin.recording.stamps import stamp_ns

TICK_S = 0.1


class ShadowRecorder(TwinNode):
    """Writes the topics a shadow follows and those it publishes; see `TwinNode` for the other arguments.

    The log time of a message is its stamp where that is not earlier than the newest one, else the newest.

    Parameters
    ----------
    directory : Path
        The recording to make.
    shadow : ShadowNode
        Whose topics are recorded.
    """

    def __init__(
        self,
        machine_name: str,
        directory: Path,
        shadow: ShadowNode,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
    ) -> None:
        super().__init__("shadow_recorder", machine_name, parameters, options)
        described = description_text(machine_name, self.initial_parameters)
        self.writer = BagWriter(directory, configuration=described)
        self._newest_ns = 0
        try:
            machine = catalogue_entry(machine_name).build(self.initial_parameters)
            own = shadow_topics(machine.forces.pins, machine.body is not None)
            for topic in (*own, DIAGNOSTICS):
                self._record(topic, EVERY)
            for followed in shadow.followed:
                self._record(followed.topic, FOLLOWED)
            self.every(TICK_S, self._tick)
        except BaseException:  # a signal, too: what is on the disk is closed
            self.writer.close()
            raise

    @property
    def received(self) -> dict[str, int]:
        """Messages heard, by full topic name."""
        return {name: row.received for name, row in self.writer.counters.items()}

    def close(self) -> None:
        """Finish the recording; one in which nothing was recorded is deleted."""
        self.writer.close(discard_empty=True)

    def _record(self, topic: Topic, qos: QoSProfile) -> None:
        name = self.resolve_topic_name(topic.name)
        self.writer.add_topic(name, type_name(topic), offered_qos(durability="volatile", depth=topic.qos.depth))
        self.subscribe(topic, partial(self._on_message, name, type_name(topic)), qos=qos, raw=True)

    def _on_message(self, name: str, kind: str, raw: bytes) -> None:
        stamp = stamp_ns(kind, raw)
        if stamp is not None and name != DIAGNOSTICS.name:
            self._newest_ns = max(self._newest_ns, stamp)
        self.writer.write(name, raw, self._newest_ns, self._newest_ns)

    def _tick(self) -> None:
        self.time_s = self._newest_ns * 1e-9
        self.writer.tick()
        self.diagnostics.state = self.writer.state.value
        if self.writer.state is WriterState.ERROR:
            self.diagnostics.error(self.writer.error)

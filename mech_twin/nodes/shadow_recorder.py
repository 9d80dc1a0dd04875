# SPDX-License-Identifier: Apache-2.0
"""Records what a shadow hears and what it says: all of it in one bag, or what surrounds a fault (the black box)."""

from __future__ import annotations

from collections import deque
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import NamedTuple

from rclpy.qos import QoSProfile

from mech_twin.messages.topics import DIAGNOSTICS, EVERY, Topic, type_name
from mech_twin.nodes.base_node import TwinNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.shadow_node import FOLLOWED
from mech_twin.parameters.load import description_text
from mech_twin.quantity import Parameters
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.errors import BagError
from mech_twin.recording.schemas import offered_qos
from mech_twin.recording.stamps import stamp_ns

TICK_S = 0.1
BEFORE_S, AFTER_S = 10.0, 5.0
SECOND_NS = 10**9


class HeardMessage(NamedTuple):
    """A message as bytes: full topic name, and log time."""

    topic: str
    raw: bytes
    at_ns: int


class ShadowTopics(NamedTuple):
    """What the shadow says, and what it hears."""

    own: tuple[Topic, ...]
    followed: tuple[Topic, ...]


class ShadowListener(TwinNode):
    """Hears the topics of the machine and of its shadow; see `TwinNode` for the other arguments.

    The log time of a message is its stamp where that is not earlier than the newest one, else the newest.

    Parameters
    ----------
    topics : ShadowTopics
        What is heard here.
    """

    def __init__(
        self,
        name: str,
        machine_name: str,
        topics: ShadowTopics,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
    ) -> None:
        super().__init__(name, machine_name, parameters, options)
        self.newest_ns = 0
        self.topics = {
            self.resolve_topic_name(topic.name): topic for topic in (*topics.own, DIAGNOSTICS, *topics.followed)
        }
        self.described = description_text(machine_name, self.initial_parameters)
        for full, topic in self.topics.items():
            self._listen(full, topic, FOLLOWED if topic in topics.followed else EVERY)
        self.every(TICK_S, self.tick_writer)

    def take(self, message: HeardMessage) -> None:
        """Keep a message."""
        raise NotImplementedError

    def tick_writer(self) -> None:
        """Do what is due ten times a second."""
        raise NotImplementedError

    def opened(self, directory: Path) -> BagWriter:
        """Return a new bag with the topics declared."""
        writer = BagWriter(directory, configuration=self.described)
        for full, topic in self.topics.items():
            writer.add_topic(full, type_name(topic), offered_qos(durability="volatile", depth=topic.qos.depth))
        return writer

    def _listen(self, full: str, topic: Topic, qos: QoSProfile) -> None:
        self.subscribe(topic, partial(self._on_message, full, type_name(topic)), qos=qos, raw=True)

    def _on_message(self, full: str, kind: str, raw: bytes) -> None:
        stamp = stamp_ns(kind, raw)
        if stamp is not None and full != DIAGNOSTICS.name:
            self.newest_ns = max(self.newest_ns, stamp)
        self.take(HeardMessage(full, raw, self.newest_ns))


class ShadowRecorder(ShadowListener):
    """Writes all of it to one bag.

    Parameters
    ----------
    directory : Path
        The recording to make.
    """

    def __init__(
        self, machine_name: str, directory: Path, topics: ShadowTopics, parameters: Parameters | None = None
    ) -> None:
        super().__init__("shadow_recorder", machine_name, topics, parameters)
        self.writer = self.opened(directory)

    @property
    def received(self) -> dict[str, int]:
        """Messages heard, by full topic name."""
        return {name: row.received for name, row in self.writer.counters.items()}

    def take(self, message: HeardMessage) -> None:
        """Write a message."""
        self.writer.write(message.topic, message.raw, message.at_ns, message.at_ns)

    def tick_writer(self) -> None:
        """Let the writer put what is due on the disk, and say how it is."""
        self.time_s = self.newest_ns * 1e-9
        self.writer.tick()
        self.diagnostics.state = self.writer.state.value
        if self.writer.state is WriterState.ERROR:
            self.diagnostics.error(self.writer.error)

    def close(self) -> None:
        """Finish the recording; one in which nothing was recorded is deleted."""
        self.writer.close(discard_empty=True)


class BlackBox(ShadowListener):
    """Keeps the last 10 s, and writes them and the next 5 s to a bag of their own when a fault becomes active.

    A fault within those 5 s prolongs the bag.

    Parameters
    ----------
    directory : Path
        Folder of the bags; each is named for its fault and its stamp, and numbered where a bag of an earlier run has
        that name.
    """

    def __init__(
        self, machine_name: str, directory: Path, topics: ShadowTopics, parameters: Parameters | None = None
    ) -> None:
        super().__init__("black_box", machine_name, topics, parameters)
        self.bags: list[Path] = []
        self._directory = directory
        self._kept: deque[HeardMessage] = deque()
        self._writer: BagWriter | None = None
        self._until_ns = 0
        self.diagnostics.state = "no fault yet"

    def trigger(self, fault: str, time_s: float) -> None:
        """Write what surrounds a fault that became active at a stamp."""
        self._until_ns = round((time_s + AFTER_S) * SECOND_NS)
        if self._writer is not None:
            return
        words = "_".join("".join(sign if sign.isalnum() else " " for sign in fault).split())
        place = _unused(self._directory / f"{words}-{round(time_s * 1000):d}")
        try:
            self._writer = self.opened(place)
        except BagError as error:  # the shadow goes on without: what it finds counts for more than this bag
            self.diagnostics.error(f"no black box: {error}")
            return
        self.bags.append(place)
        self.diagnostics.state = f"writing {place}"
        for message in self._kept:
            if message.at_ns >= round((time_s - BEFORE_S) * SECOND_NS):
                self._writer.write(message.topic, message.raw, message.at_ns, message.at_ns)

    def take(self, message: HeardMessage) -> None:
        """Keep a message, and write it while a fault is near."""
        self._kept.append(message)
        while self._kept[0].at_ns < message.at_ns - round(BEFORE_S * SECOND_NS):
            self._kept.popleft()
        if self._writer is None:
            return
        if message.at_ns > self._until_ns:
            self.close()
        else:
            self._writer.write(message.topic, message.raw, message.at_ns, message.at_ns)

    def tick_writer(self) -> None:
        """Let the writer put what is due on the disk."""
        self.time_s = self.newest_ns * 1e-9
        if self._writer is not None:
            self._writer.tick()

    def close(self) -> None:
        """Finish the bag that is being written."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
            self.diagnostics.state = f"wrote {self.bags[-1]}"


def _unused(place: Path) -> Path:
    """Return the first of a name, and the name with a number, that nothing has."""
    numbered = (place.with_name(f"{place.name}-{number}") for number in count(2))
    return next(each for each in chain([place], numbered) if not (each.exists() or each.is_symlink()))

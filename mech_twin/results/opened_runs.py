# SPDX-License-Identifier: Apache-2.0
"""Opens runs by path, bags and tables alike; reads maps and checks them against the machine; opens recorders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Block, RunReader, SourceColumn
from mech_twin.measurements.measurement_map import MeasurementMap, Source, TimeSource, read_map
from mech_twin.measurements.model_turn import ModelTurn
from mech_twin.measurements.plausibility import implausible
from mech_twin.measurements.runs import MeasuredRun, read_run
from mech_twin.measurements.tables import TableReader, is_table
from mech_twin.measurements.units import machine_columns
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import machine as built_machine
from mech_twin.roles import Machine

if TYPE_CHECKING:
    from mech_twin.recording.frame_recorder import FrameRecorder
    from mech_twin.recording.measured_topics import MeasuredTopics, TopicField


class BagRun:
    """A bag as a run of a measurement."""

    def __init__(self, topics: MeasuredTopics) -> None:
        self.path = topics.path
        self._topics = topics

    def offered(self) -> list[SourceColumn]:
        """Return the source of every number in messages of known types."""
        found = [Source(topic=item.topic, joint=item.joint, field=item.field) for item in self._topics.fields()]
        return [SourceColumn(source, None) for source in found]

    def proposed_time(self) -> TimeSource:
        """Return the stamps in the message headers."""
        return TimeSource(stamps="header")

    def blocks(self, sources: Sequence[Source], time: TimeSource) -> Iterator[Block]:
        """Yield the samples of these channels; see `RunReader.blocks`."""
        fields = [topic_field(source, str(self.path)) for source in sources]
        for found in self._topics.blocks(fields, by_header=time.stamps != "log"):
            yield Block(*found)


def topic_field(source: Source, where: str) -> TopicField:
    """Return the topic field that is the source of a channel; a source that is only a column is refused."""
    from mech_twin.recording.measured_topics import TopicField

    if source.topic is None or source.field is None:
        raise MeasurementError(where, f"source {source.label!r} is a column, expected a topic and a field for a bag")
    return TopicField(source.topic, source.joint, source.field)


@contextmanager
def opened_run(path: Path) -> Iterator[RunReader]:
    """Open one run of a measurement, a bag or a table."""
    if is_table(path):
        yield TableReader(path)
        return
    settle_domain()
    from mech_twin.recording.bag_reader import open_bag
    from mech_twin.recording.measured_topics import MeasuredTopics

    with open_bag(path) as reader:
        yield BagRun(MeasuredTopics(reader))


@cache
def columns_of(name: str) -> Mapping[str, str]:
    """Return the columns of an installed machine with their SI units."""
    return machine_columns(built_machine(name))


def given_map(path: Path, configured: Machine) -> MeasurementMap:
    """Return the map in a file, checked against the configured machine.

    Raises
    ------
    MeasurementError
        The map is for another machine than the configured one.
    """
    known = machine_columns(configured)
    found = read_map(path, lambda name: known if name == configured.name else columns_of(name))
    if found.machine != configured.name:
        raise MeasurementError(path, f"key 'machine', value {found.machine!r}: expected {configured.name!r}")
    return found


def configured_map(path: Path, config: Path | None = None) -> MeasurementMap:
    """Return the map in a file, checked against its machine with a configuration file, or as installed."""
    return read_map(path, lambda name: machine_columns(built_machine(name, config)))


def recorded_to(bag: Path, machine: Machine) -> FrameRecorder:
    """Return the recorder of a run's frames, which replaces an existing recording."""
    settle_domain()
    from mech_twin.recording.bag_metadata import remove_recording
    from mech_twin.recording.frame_recorder import FrameRecorder

    remove_recording(bag)
    return FrameRecorder(machine, bag, description_text(machine.name, machine.parameters, revision=1))


def checked_run(
    path: Path, given: MeasurementMap, machine: Machine, turn: ModelTurn | None
) -> tuple[MeasuredRun, list[str]]:
    """Return a run, and what contradicts that it is one of the machine."""
    with opened_run(path) as reader:
        run = read_run(reader, given)
    return run, [f"{path}: {problem}" for problem in implausible(run, turn, machine_columns(machine))]

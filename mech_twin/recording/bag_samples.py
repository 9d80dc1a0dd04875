# SPDX-License-Identifier: Apache-2.0
"""Decodes a recording to samples, step by step, each step once."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import JointState

from mech_twin.engine.trajectory import StepAssembler, StepSamples
from mech_twin.messages import scene
from mech_twin.messages.cdr import CdrError, received_message
from mech_twin.messages.step_message import (
    ANONYMOUS,
    CODECS,
    SOURCE,
    MessageError,
    configuration_mark,
    step_index,
)
from mech_twin.messages.topics import (
    DESCRIPTION,
    JOINT_STATES,
    SCENE,
    STEP_LINKAGE,
    Topic,
    full_name,
    type_name,
)
from mech_twin.recording.bag_contents import RecordingReader
from mech_twin.recording.bag_reader import open_bag
from mech_twin.recording.errors import BagError, DecodeError, UnknownTypeError
from mech_twin.recording.schemas import decoded, message_class
from mech_twin.samples import Drawing, Sample

if TYPE_CHECKING:
    from mech_twin.recording.bag_contents import BagMessage

MOST_DESCRIPTIONS = 10_000
LARGEST_STEP = 1 << 53
SOURCE_LINE = re.compile(r"^source: (\d{1,17})[ \t]*$", re.MULTILINE)
FIRST_STEP_LINE = re.compile(r"^from_step: 0[ \t]*$", re.MULTILINE)
LATER = "of a later run"


class NoSamplesError(BagError):
    """The bag holds no samples of exactly one machine."""


def recorded_machines(reader: RecordingReader) -> list[str]:
    """Return the namespaces of the machines whose samples a bag holds."""
    kind = type_name(STEP_LINKAGE)
    held = {name for name, topic in reader.topics.items() if topic.type_name == kind and topic.message_count}
    stepped = {name.removesuffix(f"/{STEP_LINKAGE.name}") for name in held if name.endswith(f"/{STEP_LINKAGE.name}")}
    plain = {name.removesuffix(f"/{JOINT_STATES.name}") for name in held if name.endswith(f"/{JOINT_STATES.name}")}
    of_machines = {space for space in plain if {f"{space}/motor", f"{space}/forces"} & plain}
    return sorted(space.removeprefix("/") for space in stepped | of_machines)


def recorded_machine(reader: RecordingReader) -> str:
    """Return the namespace of the machine whose samples a bag holds.

    Raises
    ------
    NoSamplesError
        If there is none, or more than one.
    """
    found = recorded_machines(reader)
    if len(found) == 1:
        return found[0]
    if found:
        raise NoSamplesError(reader.path, f"holds samples of more than one machine: {', '.join(found)}")
    raise NoSamplesError(
        reader.path, f"holds no samples of a machine; expected topics such as NAME/{STEP_LINKAGE.name}"
    )


class BagSamples:
    """The samples of one machine in a bag; the machine need not be in the catalogue.

    Parameters
    ----------
    coupling_step_s : float, optional
        Step length for messages without a step number (a measured linkage).

    Attributes
    ----------
    machine : str
        Namespace of the recorded run.
    topics : dict
        Full name of the topic of each field of `StepSamples` that was recorded.
    has_body : bool
        Whether body samples were recorded.
    unused : Counter
        Messages not used, by reason: ``repeated``, ``contradicting``, ``late``, ``malformed``, `LATER`.
    by_signature : dict
        Fields whose messages, of those read so far, have a source number (True) and have none (False).
    """

    _assembler: StepAssembler | None = None

    def __init__(self, reader: RecordingReader, coupling_step_s: float | None = None) -> None:
        self.machine = recorded_machine(reader)
        self.unused: Counter[str] = Counter()
        self.by_signature: dict[bool, set[str]] = {True: set(), False: set()}
        self._reader = reader
        self._step_s = coupling_step_s
        whole = self._holds(full_name(self.machine, STEP_LINKAGE), STEP_LINKAGE)
        # without step topics: recordings of versions before 0.2, whose joint states were the step messages, and foreign
        known = {full_name(self.machine, codec.steps if whole else codec.joint_states): codec for codec in CODECS}
        self._steps = {name: codec for name, codec in known.items() if self._holds(name, codec.steps)}
        self.topics = {codec.field: name for name, codec in self._steps.items()}
        self.fields = frozenset(self.topics)
        self.has_body = "body" in self.fields
        self._scene = full_name(self.machine, SCENE)

    @property
    def contradicted_from(self) -> int | None:
        """The lowest step so far with two different samples; None if there is none."""
        return None if self._assembler is None else self._assembler.contradicted_from

    @property
    def count(self) -> int:
        """Number of recorded messages of the linkage."""
        return self._reader.topics[self.topics["linkage"]].message_count

    @property
    def users_nodes(self) -> list[str]:
        """The topics, of the messages read so far, that a node of the user's own answered on: it signed nothing.

        In a recording made without nodes no message is signed.
        """
        of_users = self.by_signature[False] if self.by_signature[True] else ()
        return [topic for field, topic in self.topics.items() if field in of_users]

    def descriptions(self) -> list[str]:
        """Return the configurations of the first run, in order; without any, the one attached to the bag."""
        texts = self._runs[0]
        configuration = self._reader.info.configuration
        return texts or ([configuration] if configuration else [])

    @cached_property
    def _runs(self) -> tuple[list[str], list[str]]:
        """The configurations of the first run, and those of later ones, which begin at step 0 with another source.

        The description topic may have foreign publishers: only sources that the step messages refer to are used, and
        none that was restarted at step 0.
        """
        texts = self._described()
        sources = {_source_of(text) for text in texts}
        if texts and sources != {source for source, _ in islice(self._named("linkage"), 1)}:
            reached: dict[float, int] = {}
            for source, step in self._named("linkage"):
                reached[source] = max(step, reached.get(source, 0))
            followed = {source for source, step in reached.items() if step > 0} or set(reached)
            if "forces" in self.topics:  # it answers only the linkage that it follows
                followed &= {source for source, _ in self._named("forces")}
            texts = [text for text in texts if _source_of(text) in followed]
        first = next(map(_source_of, texts), ANONYMOUS)
        begun = (n for n, text in enumerate(texts) if _source_of(text) != first and FIRST_STEP_LINE.search(text))
        end = next(begun, len(texts))
        return texts[:end], texts[end:]

    def _described(self) -> list[str]:
        name = full_name(self.machine, DESCRIPTION)
        texts: list[str] = []
        if self._holds(name, DESCRIPTION):
            kind = message_class(self._reader.topics[name])
            for message in self._reader.messages([name]):
                text = self._decoded(message, kind)
                if text is not None and text.data not in texts[-1:]:
                    texts.append(text.data)
                if len(texts) > MOST_DESCRIPTIONS:
                    raise NoSamplesError(self._reader.path, f"changes its configuration over {MOST_DESCRIPTIONS} times")
        return texts

    def _named(self, field: str) -> Iterator[tuple[float, int]]:
        """Yield the source number in the configuration mark, and the step, of each message of a step topic."""
        return filter(None, map(_named_in, self._reader.messages([self.topics[field]])))

    def steps(self) -> Iterator[StepSamples]:
        """Yield the samples of each step, in order of the steps.

        If a step is recorded more than once, the first sample is used: the run continued with it.
        """
        for item in self.shown(drawings=False):
            if isinstance(item, StepSamples):
                yield item

    @property
    def has_drawings(self) -> bool:
        """Whether the recording holds drawings of the mechanism."""
        return self._holds(self._scene, SCENE)

    def shown(self, drawings: bool = True) -> Iterator[StepSamples | Drawing]:
        """Yield the steps and the drawings of the mechanism, in order of time, up to the end of the first run."""
        later, is_over = {_source_of(text) for text in self._runs[1]}, False
        topics = [*self._steps, *([self._scene] if drawings and self.has_drawings else [])]
        assembler = self._assembler = StepAssembler(self.fields, self.unused)
        for message in self._reader.messages(topics):
            if later and not is_over and message.topic == self.topics["linkage"]:
                named = _named_in(message)
                is_over = named is not None and named[0] in later
            if is_over:
                self.unused[LATER] += message.topic != self._scene
                continue
            if message.topic == self._scene:
                drawing = self._drawing(message)
                if drawing is not None:
                    yield drawing
                continue
            sample = self._sample(message)
            if sample is not None:
                yield from assembler.add(sample)
        yield from assembler.rest()

    def _holds(self, name: str, topic: Topic) -> bool:
        about = self._reader.topics.get(name)
        if about is None or about.type_name != type_name(topic) or not about.message_count:
            return False
        try:
            message_class(about)
        except UnknownTypeError as error:
            raise NoSamplesError(self._reader.path, f"topic {name}: {error}") from error
        return True

    def _decoded(self, message: BagMessage, kind: Any) -> Any:
        try:
            return decoded(message.raw, kind)
        except DecodeError:
            self.unused["malformed"] += 1
            return None

    def _drawing(self, message: BagMessage) -> Drawing | None:
        content = self._decoded(message, SCENE.type)
        try:
            return None if content is None else scene.from_message(content)
        except MessageError:
            self.unused["malformed"] += 1
            return None

    def _sample(self, message: BagMessage) -> Sample | None:
        """Return the sample of a step message; None, counted as malformed, if it cannot be decoded."""
        content = self._decoded(message, JointState)
        if content is None:
            return None
        try:
            sample: Sample | None = self._steps[message.topic].from_message(content, self._step_s)
        except (MessageError, ValueError, OverflowError):
            sample = None
        if sample is None or not 0 <= sample.step < LARGEST_STEP:
            self.unused["malformed"] += 1
            return None
        self.by_signature[SOURCE in content.name].add(self._steps[message.topic].field)
        return sample


def _source_of(description: str) -> float:
    """Return the source number in a description; 0 if it has none, even if the text is not valid."""
    found = SOURCE_LINE.search(description)
    return 0.0 if found is None else float(found.group(1))


def _named_in(message: BagMessage) -> tuple[float, int] | None:
    """Return source number in the configuration mark, and step, of a step message; None of one that is not valid."""
    try:
        received = received_message(message.raw)
        return configuration_mark(received).source, step_index(received) or 0
    except (CdrError, ValueError, OverflowError, LookupError):
        return None


def bag_samples(path: Path) -> Iterator[StepSamples]:
    """Yield the steps of a bag; see `BagSamples.steps`."""
    with open_bag(path) as reader:
        yield from BagSamples(reader).steps()

# SPDX-License-Identifier: Apache-2.0
"""Writes a recording: a rosbag2 directory of MCAP files, with bounded and counted message loss."""

import json
import logging
import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, replace
from enum import Enum
from functools import partial
from pathlib import Path

from mech_twin.process.closing import Closing
from mech_twin.process.interruption import UninterruptedLock
from mech_twin.recording.bag_metadata import FileStatistics, TopicMetadata, new_directory, write_metadata
from mech_twin.recording.bag_split import (
    COMPRESSIONS,
    COUNTERS_KEY,
    FINISHED_KEY,
    BagSplit,
    Latched,
    RecordedTopic,
    SpaceReservation,
    TopicCounters,
)
from mech_twin.recording.errors import UnwritableDirectoryError
from mech_twin.recording.schemas import message_schema, offered_qos

LOG = logging.getLogger(__name__)  # without a handler, warnings go to standard error
_CLOSE_AT = 0.6  # of max_loss_s: the rest allows for the interval between ticks and for the write


class WriterState(Enum):
    """State of a writer."""

    RECORDING = "recording"
    ERROR = "error"
    CLOSED = "closed"


class BagWriter(Closing):
    """A recording in progress.

    Chunks are closed by size and by age.  Each is written to the file at once, followed by the loss counters, so that a
    process that dies loses at most `max_loss_s` of any topic.  A full or failing disk sets `state` to ERROR and never
    raises: messages are dropped and counted, and recording resumes in a new split when the disk accepts data again.

    All methods may be called from any thread.

    Parameters
    ----------
    directory : Path
        The bag; its files are named after it.
    configuration : str
        The machine's configuration as YAML, attached to every split.
    max_loss_s : float
        Greatest age of a message that has not been written to the file.  Call `tick` at least every 0.4 `max_loss_s`.
    fsync : bool
        Also synchronise each chunk to the disk, to survive a power failure.
    split_bytes, split_duration_s : number, optional
        Start a new file at this size, or after this duration of log time.
    chunk_bytes, compression
        Uncompressed size of a chunk; `zstd`, `lz4` or `none`.
    retry_s : float
        Time between attempts to resume after an error.

    Raises
    ------
    BagExistsError, UnwritableDirectoryError
        The recording cannot be created; no file or directory is left behind.
    """

    def __init__(
        self,
        directory: Path | str,
        *,
        configuration: str,
        max_loss_s: float = 0.5,
        fsync: bool = False,
        split_bytes: int | None = None,
        split_duration_s: float | None = None,
        chunk_bytes: int = 256 * 1024,
        compression: str = "zstd",
        retry_s: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not max_loss_s > 0.0:
            raise ValueError(f"expected max_loss_s > 0, got {max_loss_s}")
        if chunk_bytes <= 0 or compression not in COMPRESSIONS:
            expected = f"chunk_bytes > 0 and compression one of {', '.join(COMPRESSIONS)}"
            raise ValueError(f"expected {expected}; got {chunk_bytes}, '{compression}'")
        self.error = ""
        self._state = WriterState.RECORDING
        self._lock = UninterruptedLock()
        self._close_age_s = _CLOSE_AT * max_loss_s
        self._split_bytes = math.inf if split_bytes is None else split_bytes
        self._split_ns = math.inf if split_duration_s is None else split_duration_s * 1e9
        self._new_split = partial(
            BagSplit, configuration=configuration, chunk_bytes=chunk_bytes, compression=compression, fsync=fsync
        )
        self._retry_s = retry_s
        self._clock = clock
        self._topics: dict[str, RecordedTopic] = {}
        self._split: BagSplit | None = None
        self._started = 0
        self._finished: list[FileStatistics] = []
        self._repeat_due = True
        self._commit_due = math.inf  # when the chunk, or a change of counters, is too old
        self._next_attempt = 0.0
        opened = False
        try:
            with self._lock:
                self.directory, self._made = new_directory(Path(directory))
                self._reservation = SpaceReservation(self.directory)
                self._open_first()
                opened = True
        except (KeyboardInterrupt, SystemExit):  # a delayed signal: the caller has no writer to close
            if opened:
                self._discard()
            raise

    @property
    def state(self) -> WriterState:
        """Whether messages are being recorded."""
        return self._state

    @property
    def counters(self) -> dict[str, TopicCounters]:
        """The counters by topic; messages not yet accepted by the disk after an error do not count as written."""
        with self._lock:
            waiting = self._waiting()
            return {
                name: replace(row, written=row.written - waiting[name]) for name, row in self._counter_rows().items()
            }

    @property
    def dropped(self) -> int:
        """Number of messages lost because of disk errors so far."""
        return sum(row.dropped for row in self.counters.values())

    def add_topic(self, topic: str, type_name: str, qos_yaml: str | None = None) -> None:
        """Register a topic before its first message; a second time with the same type is a no-op.

        Raises
        ------
        UnknownTypeError
            The type is not installed.
        ValueError
            The topic is registered with another type.
        """
        with self._lock:
            known = self._topics.get(topic)
            if known is not None:
                if known.schema.type_name != type_name:
                    raise ValueError(f"topic {topic} is of {known.schema.type_name}, not of {type_name}")
                return
            entry = RecordedTopic(message_schema(type_name), offered_qos() if qos_yaml is None else qos_yaml)
            self._topics[topic] = entry
            if self._state is WriterState.RECORDING and self._split is not None:
                try:
                    self._split.add_topic(topic, entry.schema, entry.qos_yaml)
                    self._split.file.commit()  # the current chunk stays open
                except OSError as error:
                    self._fail(error, self._clock())

    def write(self, topic: str, raw: bytes, log_time_ns: int, publish_time_ns: int, latched: bool = False) -> None:
        """Record one message.

        Parameters
        ----------
        raw : bytes
            CDR with its encapsulation header.
        log_time_ns, publish_time_ns : int
            Time of reception and of publication.
        latched : bool
            Whether to repeat it at the start of every later split.
        """
        with self._lock:
            entry = self._topics.get(topic)
            if entry is None:
                raise ValueError(f"topic {topic} was not added; topics: {', '.join(self._topics)}")
            if self._state is WriterState.CLOSED:
                raise ValueError(f"{self.directory}: the recording is closed")
            now = self._clock()
            entry.counters.received += 1
            if self._state is WriterState.RECORDING and self._is_full(log_time_ns):
                try:
                    self._next_split()
                except OSError as error:
                    self._fail(error, now)
            if self._state is WriterState.ERROR:
                self._attempt(now)
            if self._state is WriterState.RECORDING:
                self._add(topic, entry, raw, log_time_ns, publish_time_ns, now)
            else:
                entry.counters.dropped += 1
            if latched:
                entry.latched = Latched(raw, publish_time_ns, entry.counters.received)

    def count_missed(self, topic: str, n: int = 1) -> None:
        """Count messages of a topic that were published but never received."""
        with self._lock:
            self._topics[topic].counters.missed += n
            self._touch_counters()

    def count_late(self, topic: str, n: int = 1) -> None:
        """Count messages of a topic that were received after a later one."""
        with self._lock:
            self._topics[topic].counters.late += n
            self._touch_counters()

    def count_publishers(self, topic: str, number: int) -> None:
        """Keep the largest number of publishers that a topic had at one time."""
        with self._lock:
            counters = self._topics[topic].counters
            if number > counters.publishers:
                counters.publishers = number
                self._touch_counters()

    def tick(self, monotonic_now: float | None = None) -> None:
        """Write a chunk that is due by age, and resume after an error; call it every 0.4 `max_loss_s` or more often."""
        with self._lock:
            now = self._clock() if monotonic_now is None else monotonic_now
            if self._state is WriterState.ERROR:
                self._attempt(now)
            elif self._state is WriterState.RECORDING and now >= self._commit_due:
                self._commit(now)

    def close(self, *, discard_empty: bool = False) -> None:
        """Finish the bag; idempotent.  If the disk fails, `state` stays ERROR and the bag unfinished but readable.

        Parameters
        ----------
        discard_empty : bool
            Delete the recording if it holds nothing but latched messages: the run it belongs to never started.
        """
        with self._lock:
            if self._state is WriterState.CLOSED:
                return
            if discard_empty and self._state is WriterState.RECORDING and self._is_empty():
                self._discard()
                return
            try:
                self._reservation.release()
                self._finish_split()
                self._write_metadata(finished=True)
            except OSError as error:
                self._note(error)
                self._write_losses()
            else:
                self._state = WriterState.CLOSED

    def _add(
        self, topic: str, entry: RecordedTopic, raw: bytes, log_time_ns: int, publish_time_ns: int, now: float
    ) -> None:
        split = self._split
        assert split is not None
        if self._repeat_due:
            self._repeat_latched(split, log_time_ns)
        if self._commit_due == math.inf:
            self._commit_due = now + self._close_age_s
        counters = entry.counters
        counters.written += 1
        full = split.add_message(topic, raw, log_time_ns, publish_time_ns, counters.received)
        if full or now >= self._commit_due:
            self._commit(now)

    def _repeat_latched(self, split: BagSplit, log_time_ns: int) -> None:
        self._repeat_due = False
        for name, entry in self._topics.items():
            if (last := entry.latched) is not None:
                split.add_message(name, last.raw, log_time_ns, last.publish_time_ns, last.sequence)

    def _open_first(self) -> None:
        try:
            self._open_split()
        except OSError as error:
            for path in self._made:
                path.rmdir()
            raise UnwritableDirectoryError(self.directory, f"cannot be written ({error.strerror})") from error

    def _is_empty(self) -> bool:
        return all(entry.latched is not None or entry.counters.received == 0 for entry in self._topics.values())

    def _discard(self) -> None:
        self._reservation.release()
        if self._split is not None:
            self._split.file.close()
            self._split.file.path.unlink(missing_ok=True)
            self._split = None
        self._state = WriterState.CLOSED
        for path in self._made:
            if not any(path.iterdir()):
                path.rmdir()

    def _touch_counters(self) -> None:
        if self._commit_due == math.inf:
            self._commit_due = self._clock() + self._close_age_s

    def _commit(self, now: float) -> None:
        self._commit_due = math.inf
        if self._split is None:
            return
        try:
            self._split.commit(self._counter_rows())
            self._reserve_space(self._split)
        except OSError as error:
            self._fail(error, now)

    def _next_split(self) -> None:
        self._finish_split()
        self._write_metadata(finished=False)
        self._open_split()
        self._repeat_due = True
        self._commit_due = math.inf

    def _note(self, error: OSError) -> None:
        self.error = f"{self.directory}: {error.strerror or error}"
        if self._state is not WriterState.ERROR:
            LOG.error("%s: the recording loses messages", self.error)
        self._state = WriterState.ERROR

    def _write_losses(self) -> None:
        """Write the loss counters to `metadata.yaml`, if the disk accepts it."""
        try:
            self._write_metadata(finished=False)
        except OSError as error:
            self._note(error)

    def _fail(self, error: OSError, now: float) -> None:
        """Stop recording; release the reserved disk space, in which the buffered data and the summary fit."""
        self._note(error)
        self._next_attempt = now + self._retry_s
        try:
            self._reservation.release()
            self._finish_split()
        except OSError as again:
            self._note(again)
        self._write_losses()

    def _attempt(self, now: float) -> None:
        """Resume in a new split, if the disk accepts one."""
        if now < self._next_attempt:
            return
        self._next_attempt = now + self._retry_s
        try:
            self._next_split()
        except OSError as error:
            self._note(error)
        else:
            self._state = WriterState.RECORDING
            self.error = ""
            LOG.warning("%s: recording again; %d messages were lost", self.directory, self.dropped)

    # -- files, whose methods raise OSError and may be called again --------------------------------------------------

    def _is_full(self, log_time_ns: int) -> bool:
        """Whether a message of this log time belongs in a new file."""
        if self._split is None or self._split.statistics.start_ns is None:
            return False
        age_ns = log_time_ns - self._split.statistics.start_ns
        return self._split.size_bytes >= self._split_bytes or age_ns >= self._split_ns

    def _open_split(self) -> None:
        """Start a file; it is deleted if that fails."""
        path = self.directory / f"{self.directory.name}_{self._started}.mcap"
        latched = {name: topic.latched.sequence for name, topic in self._topics.items() if topic.latched}
        repeated = latched if self._started else {}
        split = self._new_split(path, self._started, repeated)
        try:
            for name, topic in self._topics.items():
                split.add_topic(name, topic.schema, topic.qos_yaml)
            split.file.commit()
            self._split = split
            self._reserve_space(split)
        except OSError:
            self._split = None
            split.file.close()
            path.unlink(missing_ok=True)
            self._reservation.release()
            raise
        self._started += 1

    def _finish_split(self) -> None:
        """Finish the current file, if there is one."""
        if self._split is not None:
            self._split.finish(self._counter_rows())
            self._finished.append(self._split.statistics)
            self._split = None

    def _reserve_space(self, split: BagSplit) -> None:
        self._reservation.reserve(1 << (split.closing_bytes - 1).bit_length())

    def _counter_rows(self) -> dict[str, TopicCounters]:
        return {name: topic.counters for name, topic in self._topics.items()}

    def _waiting(self) -> Counter[str]:
        """Return the number of messages by topic that are buffered because the disk did not accept them."""
        split = self._split
        return split.uncommitted if split is not None and split.file.pending else Counter()

    def _write_metadata(self, finished: bool) -> None:
        """Write `metadata.yaml` for the finished files; ``finished`` is False while more may follow."""
        topics = [
            TopicMetadata(name, topic.schema.type_name, topic.qos_yaml, topic.schema.type_hash)
            for name, topic in self._topics.items()
        ]
        waiting = self._waiting()
        rows = {
            name: asdict(replace(row, written=row.written - waiting[name], dropped=row.dropped + waiting[name]))
            for name, row in self._counter_rows().items()
        }
        custom = {FINISHED_KEY: str(finished).lower(), COUNTERS_KEY: json.dumps(rows)}
        write_metadata(self.directory, topics, self._finished, custom)

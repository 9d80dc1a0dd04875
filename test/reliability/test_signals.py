# SPDX-License-Identifier: Apache-2.0
"""A signal at any moment ends every verb soon, with its exit code or a closed recording, and leaves nobody behind.

Each verb meets each of its moments here, run and simulation every signal, a run in one process each signal at each
moment; the whole matrix is ``benchmarks/reliability/signals.py``.
"""

from __future__ import annotations

import signal
import time
from itertools import product
from pathlib import Path

import pytest
from bag_cases import string_cdr
from mcap.opcode import Opcode
from signal_cases import (
    SIGNALS,
    VERBS,
    descendants,
    faults,
    has_recorded,
    has_workers,
    lasting,
    running,
    running_in_a_terminal,
    seen_after,
    until,
)

from mech_twin.process.interruption import interruptible
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_split import SplitFile
from mech_twin.recording.bag_writer import BagWriter

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("ros_domain")]
LIMIT_S = 6.0  # promised is a second on a quiet machine; start-up of an interpreter and load come on top here
EVERY_SIGNAL = ("run", "processes", "simulate")
EVERY_MOMENT = ("importing", "compiling", "under way")
OTHERS = [("run", "discovery")]
OTHERS += [(verb, moment) for verb in VERBS if verb not in EVERY_SIGNAL for moment in VERBS[verb].moments]
CASES = [("run", *case, False) for case in product(EVERY_MOMENT, SIGNALS)]
CASES += [
    (verb, moment, SIGNALS[(i + j) % 3], False)
    for i, verb in enumerate(EVERY_SIGNAL[1:])
    for j, moment in enumerate(EVERY_MOMENT)
]
CASES += [(verb, moment, SIGNALS[i % 3], True) for i, (verb, moment) in enumerate(OTHERS)]
CASES += [("processes", "starting", number, group) for number in SIGNALS for group in (False, True)]
CASES += [("processes", "importing", signal.SIGINT, True), ("processes", "under way", signal.SIGINT, True)]


@pytest.mark.parametrize(("verb", "moment", "number", "group"), CASES)
def test_a_signal_ends_everything(verb: str, moment: str, number: signal.Signals, group: bool, tmp_path: Path) -> None:
    seen = seen_after(VERBS[verb], moment, number, tmp_path, group)
    assert faults(VERBS[verb], moment, number, seen, tmp_path) == []
    assert seen.took_s < LIMIT_S


def test_every_signal_meets_a_verb_of_every_kind() -> None:
    assert {(verb, moment) for verb, moment, _, _ in CASES} == {
        (verb, moment) for verb in VERBS for moment in VERBS[verb].moments
    }
    assert {number for verb, _, number, _ in CASES if verb not in EVERY_SIGNAL} == set(SIGNALS)
    assert {(verb, number) for verb, _, number, _ in CASES if verb in EVERY_SIGNAL} == {*product(EVERY_SIGNAL, SIGNALS)}
    assert {(moment, number) for _, moment, number, _ in CASES} >= {*product(EVERY_MOMENT, SIGNALS)}


def test_killing_the_parent_leaves_no_orphan_and_a_recording_that_is_closed(tmp_path: Path) -> None:
    with running(VERBS["processes"], tmp_path) as started:
        until(lambda: has_recorded(started))
        children = descendants(started.process.pid)
        assert len(children) >= 4
        started.process.kill()
        assert not lasting(children)
    with BagReader(started.bag) as reader:
        assert reader.info.finished


def test_a_run_ends_with_its_terminal_and_closes_its_recording(tmp_path: Path) -> None:
    with running_in_a_terminal(VERBS["run"], tmp_path) as started:
        until(lambda: has_recorded(started))
        children = descendants(started.process.pid)
        started.hang_up()
        assert started.process.wait(30.0) in (0, 128 + signal.SIGHUP)
        assert not lasting(children)
    with BagReader(started.bag) as reader:
        assert reader.info.finished


def test_killing_a_study_leaves_no_worker(tmp_path: Path) -> None:
    with running(VERBS["study"], tmp_path) as started:
        until(lambda: has_workers(started))
        children = descendants(started.process.pid)
        started.process.kill()
        assert not lasting(children)


def test_a_second_signal_does_not_spoil_the_recording(tmp_path: Path) -> None:
    with running(VERBS["run"], tmp_path) as started:
        until(lambda: has_recorded(started))
        for _ in range(5):
            started.process.send_signal(signal.SIGINT)
            time.sleep(0.03)
        assert started.process.wait(30.0) in (0, 130, -signal.SIGINT)  # the last may meet an interpreter that is done
    with BagReader(started.bag) as reader:
        assert reader.info.finished


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_while_a_chunk_is_written_waits_until_its_summary_knows_it(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag, buffer, sent = tmp_path / "bag", SplitFile.write, []

    def interrupted(file: SplitFile, data: bytes) -> int:
        length = buffer(file, data)
        if data[:1] == bytes([Opcode.CHUNK]) and not sent:
            sent.append(number)
            signal.raise_signal(number)
        return length

    monkeypatch.setattr(SplitFile, "write", interrupted)
    written = 0
    end = time.monotonic() + LIMIT_S
    with (
        pytest.raises((KeyboardInterrupt, SystemExit)),
        interruptible(),
        BagWriter(bag, configuration="", chunk_bytes=4096) as writer,
    ):
        writer.add_topic("/a", "std_msgs/msg/String")
        while time.monotonic() < end:
            written += 1
            writer.write("/a", string_cdr(str(written)), written, written)
    assert sent
    with BagReader(bag) as reader:
        assert reader.info.finished
        assert reader.info.message_count == written


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_while_a_recording_is_created_leaves_nothing_of_it(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer = SplitFile.write

    def interrupted(file: SplitFile, data: bytes) -> int:
        signal.raise_signal(number)
        return buffer(file, data)

    monkeypatch.setattr(SplitFile, "write", interrupted)
    with pytest.raises((KeyboardInterrupt, SystemExit)), interruptible():
        BagWriter(tmp_path / "bag", configuration="")
    assert list(tmp_path.iterdir()) == []

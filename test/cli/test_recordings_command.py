# SPDX-License-Identifier: Apache-2.0
"""Recordings on the command line: replayed, compared, shown, described, recovered; bad ones in one line."""

from __future__ import annotations

import io
import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from catalogue import built
from command_line import Ended, in_a_process, mech_twin
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from recordings import Entry, altered_bag, decoded_messages, earlier_layout, edited, simulated_bag, written_bag
from rrd_tables import rrd_tables

from mech_twin.cli.main import with_options_repeated
from mech_twin.declarations.captions import metrics_table

pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.slow]
COMMAND = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
DRUM = "winding_drum"
STATES = f"/{DRUM}/step/linkage"
MOTOR = f"/{DRUM}/step/motor"
FORCES = f"/{DRUM}/step/forces"
END_LIMIT_S = 1.0


def document(*words: str | Path) -> Any:
    done = mech_twin(*words, "--json")
    assert done.code in (0, 1), done.err
    return done.code, json.loads(done.out)


def flipped(bag: Path, damaged: Path) -> Path:
    """Write a copy in which one bit of the first chunk is another."""
    content = bytearray((bag / "bag_0.mcap").read_bytes())
    chunks = StreamReader(io.BytesIO(content), emit_chunks=True).records
    messages = next(record.data for record in chunks if isinstance(record, Chunk))
    content[content.index(messages) + len(messages) // 2] ^= 0x10
    damaged.write_bytes(content)
    return damaged


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("recordings") / "bag"
    simulated_bag(DRUM, 0.2, directory)
    return directory


def tampered(bag: Path, out: Path, topic: str, step: int, column: str) -> Path:
    """Write a copy in which the last bits of one number of one step are others."""

    def alter(entry: Entry) -> Iterable[Entry]:
        if entry.topic != topic or round(entry.log_time_ns / 1e6) != step:
            return (entry,)

        def edit(message: Any) -> None:
            values = getattr(message, column)
            values[0] = values[0] * (1.0 + 2e-16) + 1e-300

        return (edited(entry, edit),)

    return altered_bag(bag, out, alter)


@pytest.mark.parametrize("mode", ["--analyse", "--resimulate"])
def test_a_recording_of_before_the_step_topics_is_compared_like_any_other(bag: Path, tmp_path: Path, mode: str) -> None:
    earlier = altered_bag(bag, tmp_path / "earlier", earlier_layout)
    code, now = document("replay", bag, mode)
    assert (code, now["identical"]) == (0, True)
    code, before = document("replay", earlier, mode)
    assert code == 0
    assert before | {"bag": ""} == now | {"bag": ""}
    assert mech_twin("view", earlier, "--save", tmp_path / "earlier.rrd").code == 0
    told = tampered(earlier, tmp_path / "told", f"/{DRUM}/forces/joint_states", 7, "effort")
    assert document("replay", told, mode)[1]["first_difference"]["topic"] == f"/{DRUM}/forces/joint_states"


# -- replay ---------------------------------------------------------------------------------------------------------


def test_a_replay_ends_by_itself_and_counts(bag: Path) -> None:
    done = in_a_process("replay", bag, "--rate", "2", "--topics", "step/linkage", "description")
    assert done.code == 0, done.err
    assert "published 202 messages on 2 topics" in done.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_replay_within_a_second(bag: Path, number: signal.Signals) -> None:
    process = subprocess.Popen([*COMMAND, "replay", str(bag), "--loop"], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if "jumps back" in line:
            break
    before = time.monotonic()
    process.send_signal(number)
    assert process.wait(10) == 0
    assert time.monotonic() - before < END_LIMIT_S
    assert "Traceback" not in process.stderr.read()
    process.stderr.close()


def test_keys_steer_a_replay_in_a_terminal(bag: Path) -> None:
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(sys.executable, [*COMMAND, "replay", str(bag), "--loop"])
    try:
        until_shown(terminal, "quit")
        os.write(terminal, b" ")
        until_shown(terminal, "paused at")
        os.write(terminal, b" ")
        until_shown(terminal, "going on at")
        os.write(terminal, b"+")
        until_shown(terminal, "rate 1.25")
        os.write(terminal, b"--")
        until_shown(terminal, "rate 0.8")
        os.write(terminal, b"n")
        until_shown(terminal, "no impact after")
        os.write(terminal, b"q")
        assert exit_code(pid, terminal) == 0
    finally:
        os.close(terminal)


def until_shown(terminal: int, words: str) -> None:
    shown, end = "", time.monotonic() + 20.0
    while words not in shown:
        assert time.monotonic() < end, shown
        if select.select([terminal], [], [], 0.1)[0]:
            shown += os.read(terminal, 4096).decode(errors="replace")


def exit_code(pid: int, terminal: int) -> int:
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.05)[0]:
            try:
                os.read(terminal, 4096)
            except OSError:  # the other side has closed
                time.sleep(0.05)
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
    os.kill(pid, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def test_an_option_takes_several_values() -> None:
    given = ["bag", "--topics", "a", "b", "--rate", "2", "--topics", "c"]
    assert with_options_repeated(given) == ["bag", "--topics", "a", "--topics", "b", "--rate", "2", "--topics", "c"]
    assert with_options_repeated(["bag", "--topics"]) == ["bag", "--topics"]


# -- compared -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["--analyse", "--resimulate"])
def test_a_recording_computed_again_is_identical(bag: Path, mode: str) -> None:
    code, result = document("replay", bag, mode)
    assert code == 0
    assert result["identical"] is True
    assert result["steps_compared"] == 201
    assert result["first_difference"] is None
    shown = [tuple(line.split()) for line in mech_twin("replay", bag, mode).out.splitlines()]
    assert ("identical", "yes") in shown
    assert ("steps", "compared", "201") in shown
    assert ("samples", "compared", str(result["samples_compared"])) in shown
    assert not any("_" in word for line in shown[1:] for word in line if word != DRUM)


@pytest.mark.parametrize(
    ("mode", "topic", "column"),
    [("--resimulate", MOTOR, "effort"), ("--resimulate", STATES, "velocity"), ("--analyse", FORCES, "effort")],
)
def test_the_first_difference_is_shown_with_time_topic_and_field(
    bag: Path, tmp_path: Path, mode: str, topic: str, column: str
) -> None:
    changed = tampered(bag, tmp_path / "changed", topic, 77, column)
    code, result = document("replay", changed, mode)
    assert code == 1
    first = result["first_difference"]
    assert (first["topic"], first["step"], first["time_s"]) == (topic, 77, 77 * 0.001)
    assert "effort" in first["field"] or "velocity" in first["field"] or "force" in first["field"]
    said = mech_twin("replay", changed, mode)
    assert said.code == 1
    assert f"first difference at 0.077 s (step 77), topic {topic}, field {first['field']}" in said.err


@pytest.mark.parametrize(("mode", "topic", "role"), [("--resimulate", MOTOR, "motor"), ("--analyse", FORCES, "forces")])
def test_a_recording_without_a_needed_role_is_not_compared(
    bag: Path, tmp_path: Path, mode: str, topic: str, role: str
) -> None:
    other = altered_bag(bag, tmp_path / "other", lambda e: (e._replace(topic="/mine") if e.topic == topic else e,))
    code, result = document("replay", other, mode)
    assert (code, result["identical"], result["steps_compared"]) == (1, None, 0)
    said = mech_twin("replay", other, mode)
    assert "nothing compared" in said.out
    assert f"nothing could be compared: the recording has no steps of the {role}" in said.err


def test_another_version_is_said(bag: Path, tmp_path: Path) -> None:
    def older(entry: Entry) -> Iterable[Entry]:
        if not entry.topic.endswith("/description"):
            return (entry,)

        def edit(message: Any) -> None:
            head, _, rest = message.data.partition("version: ")
            message.data = f"{head}version: 0.0.1\n{rest.partition(chr(10))[2]}"

        return (edited(entry, edit),)

    done = mech_twin("replay", altered_bag(bag, tmp_path / "older", older), "--resimulate")
    assert done.code == 0
    assert "recorded with version 0.0.1" in done.err


def test_a_machine_the_catalogue_does_not_know_cannot_be_computed(bag: Path, tmp_path: Path) -> None:
    done = mech_twin("replay", foreign_machine(bag, tmp_path / "other"), "--resimulate")
    assert_refused(done, "no machine 'somebodys_press'")


def foreign_machine(bag: Path, out: Path) -> Path:
    def renamed(entry: Entry) -> Iterable[Entry]:
        entry = entry._replace(topic=entry.topic.replace(DRUM, "somebodys_press"))
        if not entry.topic.endswith("/description"):
            return (entry,)
        return (edited(entry, lambda m: setattr(m, "data", m.data.replace(DRUM, "somebodys_press"))),)

    return altered_bag(bag, out, renamed)


# -- shown ----------------------------------------------------------------------------------------------------------


def test_a_recording_is_shown_into_a_file_with_the_numbers_of_its_run_alone(bag: Path, tmp_path: Path) -> None:
    done = mech_twin("view", bag, "--save", tmp_path / "bag.rrd")
    assert done.code == 0, done.err
    moving, _ = rrd_tables(tmp_path / "bag.rrd")
    (shown,) = moving["/metrics"]["TextDocument:text"].to_pylist()[-1]
    rows = set(shown.splitlines())
    without_run = metrics_table(built(DRUM).report()).splitlines()[2:]
    assert len(rows) > 5 and without_run
    assert not rows.intersection(without_run)


def test_a_recording_of_an_unknown_machine_is_shown_without_metrics(bag: Path, tmp_path: Path) -> None:
    done = mech_twin("view", foreign_machine(bag, tmp_path / "other"), "--save", tmp_path / "other.rrd")
    assert done.code == 0, done.err
    assert "no metrics" in done.err
    assert (tmp_path / "other.rrd").stat().st_size > 10_000


def test_the_viewer_stays_on_this_machine_until_it_is_stopped(bag: Path) -> None:
    process = subprocess.Popen([*COMMAND, "view", str(bag)], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    lines = []
    for line in process.stderr:
        lines.append(line)
        if "complete; press Ctrl-C" in line:
            break
    assert any("http://127.0.0.1:" in line for line in lines)
    before = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert process.wait(10) == 0
    assert time.monotonic() - before < END_LIMIT_S + 0.8  # the viewer's own limit comes first
    assert "Traceback" not in process.stderr.read()
    process.stderr.close()


# -- described and recovered ----------------------------------------------------------------------------------------


def test_info_tells_machine_counts_duration_losses_and_files(bag: Path) -> None:
    code, result = document("info", bag)
    assert code == 0
    assert (result["machine"], result["finished"], result["duration_s"]) == (DRUM, True, 0.2)
    assert result["topics"][STATES]["messages"] == 201
    assert result["topics"][STATES]["counters"]["written"] == 201
    assert result["message_count"] == sum(topic["messages"] for topic in result["topics"].values())
    assert [split["file"] for split in result["splits"]] == ["bag_0.mcap"]
    assert mech_twin("info", bag).code == 0


def test_a_flipped_bit_is_found_and_its_loss_counted_where_every_chunk_is_read(bag: Path, tmp_path: Path) -> None:
    damaged = flipped(bag, tmp_path / "damaged.mcap")
    whole, seen = document("info", bag, "--verify"), document("info", damaged)
    assert (whole[0], seen[0]) == (0, 0)
    assert whole[1] == document("info", bag)[1]
    code, found = document("info", damaged, "--verify")
    assert (code, len(found["problems"]), found["finished"]) == (1, 1, True)
    lost = whole[1]["message_count"] - found["message_count"]
    assert lost == sum(topic["counters"].get("cut", 0) for topic in found["topics"].values()) > 0
    assert f"closed, but not complete; {lost} cut" in mech_twin("info", damaged, "--verify").out


def test_topics_stand_in_their_groups_below_any_namespace(bag: Path, tmp_path: Path) -> None:
    def moved(each: Entry) -> Iterable[Entry]:
        return (each._replace(topic=each.topic.replace(f"/{DRUM}/", "/plant/hall_2/")),)

    plain, nested = (mech_twin("info", each).out for each in (bag, altered_bag(bag, tmp_path / "bag", moved)))
    assert "topics below /plant/hall_2/" in nested
    groups = [[line.split()[0] for line in shown.splitlines()] for shown in (plain, nested)]
    assert set(groups[1]) <= set(groups[0])
    assert "plant" not in nested.replace("topics below /plant/hall_2/", "")


def test_topics_of_a_recording_that_is_none_of_the_twin_are_named_in_full(bag: Path, tmp_path: Path) -> None:
    def alone(each: Entry) -> Iterable[Entry]:
        return (each._replace(topic="/plant/temperature"),) if each.type_name == "rosgraph_msgs/msg/Clock" else ()

    foreign = altered_bag(bag, tmp_path / "foreign", alone)
    lines = mech_twin("info", foreign).out.splitlines()
    assert [line.split()[0] for line in lines if "temperature" in line] == ["/plant/temperature"]


def test_times_of_files_count_from_the_first_where_an_epoch_would_hide_them(bag: Path, tmp_path: Path) -> None:
    day_ns = 1_700_000_000_000_000_000
    later = altered_bag(bag, tmp_path / "later", lambda each: (each._replace(log_time_ns=each.log_time_ns + day_ns),))
    shown = mech_twin("info", later).out
    assert "times since 2023-11-14 22:13:20 UTC" in shown
    assert mech_twin("info", bag).out.splitlines()[-1].split()[2:] == shown.splitlines()[-1].split()[2:]


def test_what_was_cut_off_is_recovered(bag: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut"
    cut.mkdir()
    whole = (bag / "bag_0.mcap").read_bytes()
    (cut / "cut_0.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    assert document("info", cut)[1]["finished"] is False
    refused = mech_twin("replay", cut)
    assert_refused(refused, "recover")
    code, result = document("recover", cut, tmp_path / "saved")
    assert code == 0
    saved = len(decoded_messages(tmp_path / "saved", STATES))
    assert 0 < saved <= 201
    assert result["messages"][STATES] == saved
    assert document("replay", tmp_path / "saved", "--resimulate")[1]["identical"] is True
    assert_refused(mech_twin("recover", cut, tmp_path / "saved"), "use --force to overwrite")


# -- refused --------------------------------------------------------------------------------------------------------


def assert_refused(done: Ended, words: str) -> None:
    assert done.code == 2, done.err
    assert "Traceback" not in done.err
    lines = [line for line in done.err.splitlines() if line.startswith("mech-twin:")]
    assert len(lines) == 1
    assert words in lines[0]


VERBS = [["replay"], ["replay", "--analyse"], ["replay", "--resimulate"], ["view", "--save", "out.rrd"]]


@pytest.mark.parametrize("verb", [*VERBS, ["info"], ["recover"]], ids=" ".join)
def test_a_missing_bag_is_refused_in_one_line(verb: list[str], tmp_path: Path) -> None:
    rest = [str(tmp_path / "out")] if verb == ["recover"] else []
    words = (verb[0], tmp_path / "nowhere", *rest, *verb[1:])
    assert_refused(mech_twin(*words), "nowhere")
    if len(verb) == 1:
        assert_refused(in_a_process(*words), "nowhere")


@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_a_foreign_file_and_an_empty_bag_are_refused_in_one_line(verb: list[str], tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(b"SQLite format 3\0" * 40)
    assert_refused(mech_twin(verb[0], foreign, *verb[1:]), "not an MCAP recording")
    assert_refused(mech_twin(verb[0], written_bag(tmp_path / "empty", []), *verb[1:]), "holds no")


@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_a_flipped_bit_is_refused_in_one_line(verb: list[str], bag: Path, tmp_path: Path) -> None:
    damaged = flipped(bag, tmp_path / "damaged.mcap")
    verb = [str(tmp_path / word) if word.endswith(".rrd") else word for word in verb]
    run = in_a_process if verb == ["replay"] else mech_twin  # a replay gets as far as the damage
    assert_refused(run(verb[0], damaged, *verb[1:]), "damaged.mcap")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--rate", "nan"], "--rate nan: expected"),
        (["--start", "9"], "--start 9 is beyond its end"),
        (["--duration", "inf"], "--duration inf: expected"),
        (["--topics", "nonsense"], "has no topic 'nonsense'"),
    ],
)
def test_a_replay_that_cannot_be_is_refused_in_one_line(bag: Path, words: list[str], expected: str) -> None:
    assert_refused(mech_twin("replay", bag, *words), expected)

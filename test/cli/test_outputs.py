# SPDX-License-Identifier: Apache-2.0
"""Verbs that write files check them before they compute, keep existing results, and leave nothing half-written."""

from __future__ import annotations

import csv
import fcntl
import io
import os
import pty
import re
import signal
import stat
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from command_line import in_a_process, mech_twin
from recordings import simulated_bag
from signal_cases import processor_s, until

from mech_twin.recording.bag_reader import BagReader

pytestmark = pytest.mark.usefixtures("ros_domain")
COMMAND = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
DRUM = "winding_drum"
DRAWN_BYTES = 10_000
BEGUN_S = 3.0  # of the processor, however long that takes: more than the imports, and less than any of these verbs
# two objectives: a whole front, which takes much longer than the test
SEARCH = ["study", "compaction_press", "search"]
SEARCH += ["--objective", "flywheel_inertia_kg_m2", "--objective", "peak_torque_nm"]
MAP = f"""machine: {DRUM}
channels:
  - {{source: {{topic: /{DRUM}/joint_states, joint: drum, field: position}}, is: linkage.drum.position}}
"""
FILE_VERBS = {
    "run --view": ["run", DRUM, "--no-record", "--view", "OUT.rrd"],
    "view --save": ["view", "BAG", "--save", "OUT.rrd"],
    "study sweep": ["study", DRUM, "sweep", "--over", "package.traverse_m=0.2,0.3", "--out", "OUT.csv"],
    "study size": ["study", "vibration_crank", "size", "--out", "OUT.yaml"],
    "study search": ["study", "compaction_press", "search", "--out", "OUT.yaml"],
    "study designs": ["study", "compaction_press", "designs", "--out", "OUT.parquet"],
    "study synthesise": ["study", "impact_mass", "synthesise", "--out", "OUT.yaml"],
    "study regimes": ["study", "impact_mass", "regimes", "--over", "period_s=0.1,0.2", "--out", "OUT.png"],
    "map": ["map", "BAG", DRUM, "--out", "OUT.yaml"],
    "identify": ["identify", DRUM, "BAG", "--map", "MAP", "--out", "OUT.yaml"],
    "monitor": ["monitor", DRUM, "BAG", "--save-baseline", "OUT.json"],
    "compare": ["compare", "BAG", "BAG", "--picture", "OUT.png"],
    "shadow --view": ["shadow", DRUM, "--from", "elsewhere", "--view", "OUT.rrd"],
}
DIRECTORY_VERBS = {
    "run --record": ["run", DRUM, "--view", "none", "--duration", "0.1", "--pace", "max", "--record", "OUT"],
    "simulate --bag": ["simulate", DRUM, "--duration", "0.1", "--bag", "OUT"],
    "recover": ["recover", "BAG", "OUT"],
    "reproduce --figures": ["reproduce", DRUM, "--figures", "OUT"],
    "identify": ["identify", DRUM, "BAG", "--map", "MAP", "--out", "OUT"],
    "shadow --record": ["shadow", DRUM, "--from", "elsewhere", "--record", "OUT"],
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("outputs") / "bag"
    simulated_bag(DRUM, 0.05, directory)
    (directory.parent / "map.yaml").write_text(MAP)
    return directory


def refusal(words: list[str]) -> str:
    """Return the one line with which the command is refused, in a time in which nothing can have been computed."""
    done = mech_twin(*words)
    lines = done.err.splitlines()
    assert done.code == 2
    assert len(lines) == 1
    assert lines[0].startswith("mech-twin: ")
    return lines[0]


def aimed(words: list[str], out: str, bag: Path) -> list[str]:
    places = {"BAG": str(bag), "MAP": str(bag.parent / "map.yaml"), "BASELINE": str(bag.parent / "baseline.json")}
    return [places.get(word, word.replace("OUT", out)) for word in words]


@pytest.mark.parametrize("verb", [*FILE_VERBS, *DIRECTORY_VERBS])
def test_an_output_that_cannot_be_written_is_refused_first(verb, bag):
    words = aimed((FILE_VERBS | DIRECTORY_VERBS)[verb], "/proc/x", bag)
    assert "/proc/x" in refusal(words)


@pytest.mark.parametrize("verb", FILE_VERBS)
def test_an_existing_file_is_kept_without_force(verb, bag, tmp_path):
    words = aimed(FILE_VERBS[verb], str(tmp_path / "out"), bag)
    (there,) = [Path(word) for word in words if str(tmp_path) in word]
    there.write_text("kept")
    assert f"{there}: exists already; use --force" in refusal(words)
    assert there.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [there]


@pytest.mark.parametrize("verb", FILE_VERBS)
def test_a_file_is_not_written_through_a_link_even_with_force(verb, bag, tmp_path):
    words = [*aimed(FILE_VERBS[verb], str(tmp_path / "out"), bag), "--force"]
    (link,) = [Path(word) for word in words if str(tmp_path) in word]
    link.symlink_to(tmp_path / "elsewhere")
    assert "not a regular file" in refusal(words)
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize("verb", DIRECTORY_VERBS)
def test_an_existing_directory_is_kept_without_force(verb, bag, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "out_0.mcap").write_text("kept")
    assert "--force" in refusal(aimed(DIRECTORY_VERBS[verb], str(tmp_path / "out"), bag))
    assert (tmp_path / "out" / "out_0.mcap").read_text() == "kept"


def test_a_place_of_a_black_box_is_refused_before_there_is_a_fault(tmp_path):
    words = ["shadow", DRUM, "--from", "elsewhere", "--monitor", "none.json", "--black-box"]
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    assert "/proc/x: cannot be written" in refusal([*words, "/proc/x"])
    assert "not a directory" in refusal([*words, str(tmp_path / "link")])
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize("verb", ["run --record", "simulate --bag", "recover"])
def test_force_replaces_a_recording_but_no_other_files(verb, bag, tmp_path):
    words = [*aimed(DIRECTORY_VERBS[verb], str(tmp_path / "out"), bag), "--force"]
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("kept")
    assert "thesis.txt" in refusal(words)
    assert (tmp_path / "out" / "thesis.txt").read_text() == "kept"


@pytest.mark.parametrize("verb", ["simulate --bag", "recover"])
def test_force_replaces_a_recording(verb, bag, tmp_path):
    words = aimed(DIRECTORY_VERBS[verb], str(tmp_path / "out"), bag)
    for more in ([], ["--force"]):
        done = mech_twin(*words, *more)
        assert done.code == 0, done.err
    assert mech_twin("info", tmp_path / "out", "--json").code == 0


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.slow
def test_a_recording_gives_way_only_to_another_one(tmp_path):
    """What is refused after the place of the recording was looked at leaves the earlier recording there."""
    out, sensors = tmp_path / "out", tmp_path / "sensors.yaml"
    mech_twin("simulate", DRUM, "--duration", "0.1", "--bag", out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    drum = ("source: {column: drum}", "is: linkage.drum.position", "unit: rad")
    sensors.write_text(f"machine: {DRUM}\nchannels:\n  - {{{', '.join(drum)}}}\n")
    words = ["--record", str(out), "--force", "--view", "none"]
    refused = in_a_process("run", DRUM, "--motor", "nobodys:Motor", *words)
    assert (refused.code, "No module named 'nobodys'" in refused.err) == (2, True)
    said = refusal(["shadow", DRUM, "--from", "plant", "--map", str(sensors), *words])
    assert f"{sensors}: key 'channels.0': expected a topic to follow" in said
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert {path.name for path in tmp_path.iterdir()} == {"out", "sensors.yaml"}
    assert in_a_process("run", DRUM, "--duration", "0.05", *words).code == 0
    assert (out / "out_0.mcap").read_bytes() != before["out_0.mcap"]
    assert {path.name for path in tmp_path.iterdir()} == {"out", "sensors.yaml"}


def test_a_recording_is_not_recovered_onto_itself(bag):
    before = (bag / "bag_0.mcap").read_bytes()
    for out in (bag, bag / "inside", bag / ".." / "bag"):
        assert "not separate" in refusal(["recover", str(bag), str(out), "--force"])
    assert (bag / "bag_0.mcap").read_bytes() == before


def test_a_run_that_fails_at_its_start_leaves_no_recording(tmp_path):
    words = ["simulate", DRUM, "--duration", "0.1", "--bag", str(tmp_path / "a" / "bag"), "--set", "no.such_key=1"]
    refusal(words)
    assert list(tmp_path.iterdir()) == []


def test_outputs_follow_the_umask_and_are_never_writable_for_everyone(tmp_path):
    before = os.umask(0)
    try:
        simulated_bag(DRUM, 0.02, tmp_path / "bag")
    finally:
        os.umask(before)
    for path in (tmp_path / "bag", *(tmp_path / "bag").iterdir()):
        assert not stat.S_IMODE(path.stat().st_mode) & stat.S_IWOTH


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["simulate", DRUM, "--duration", "1e6"],
        ["analyse", DRUM, "--cycle", "1000000"],
        ["view", "BAG", "--save", "OUT.rrd"],
        ["reproduce", "--figures", "OUT"],
        [*SEARCH, "--points", "1000", "--out", "OUT.yaml"],
        ["study", "compaction_press", "designs", "--count", "1000000000", "--out", "OUT.parquet"],
    ],
)
def test_ctrl_c_is_one_line_and_leaves_no_file(words, tmp_path):
    directory = tmp_path / "long"
    if "BAG" in words:
        simulated_bag(DRUM, 20.0, directory)
    process = subprocess.Popen(
        [*COMMAND, *aimed(words, str(tmp_path / "out"), directory)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
    )
    until(lambda: processor_s(process.pid) > BEGUN_S and ("BAG" not in words or is_drawing(tmp_path, directory)))
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 130, errors
    *before, last = errors.decode().splitlines()
    assert last == "mech-twin: interrupted"
    # a search that has come so far says how far it is, in a line of its own where nobody looks at a terminal
    assert all(re.fullmatch(r"searching designs of .* left at this speed; Ctrl-C ends it", line) for line in before)
    assert [path for path in tmp_path.iterdir() if path != directory] == []


def is_drawing(folder: Path, recording: Path) -> bool:
    """Whether pictures of a recording are being written: the viewer's library may take longer to load than others."""
    return any(path.stat().st_size > DRAWN_BYTES for path in folder.iterdir() if path != recording)


def in_a_terminal(words: list[str], columns: int) -> list[str]:
    """Return the lines that a command writes to a terminal of this width."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    environment = {key: value for key, value in os.environ.items() if key not in {"COLUMNS", "LINES"}}
    process = subprocess.Popen([*COMMAND, *words], stdout=theirs, stderr=theirs, env=environment | {"TERM": "xterm"})
    os.close(theirs)
    text = b""
    try:
        while piece := os.read(ours, 65536):
            text += piece
    except OSError:  # the terminal is closed at the other end
        pass
    assert process.wait(10) == 0
    os.close(ours)
    return re.sub(r"\x1b\[[0-9;]*m", "", text.decode()).splitlines()


@pytest.mark.slow
def test_info_fits_80_columns_with_every_topic_in_one_piece(tmp_path: Path) -> None:
    simulated_bag("mb10_breaker", 0.02, tmp_path / "bag")
    with BagReader(tmp_path / "bag") as reader:
        names = [name.removeprefix("/mb10_breaker/") for name in reader.topics]
        joint_states = sum(topic.type_name == "sensor_msgs/msg/JointState" for topic in reader.topics.values())
    lines = in_a_terminal(["info", str(tmp_path / "bag")], 80)
    assert max(map(len, lines)) <= 80
    for name in names:
        assert sum(f" {name} " in f" {line}" for line in lines) == 1
    wide = in_a_terminal(["info", str(tmp_path / "bag"), "--wide"], 80)
    assert joint_states == 8  # of each role its step and its plain one
    assert sum("sensor_msgs/msg/JointState" in line for line in wide) == joint_states


def test_the_topics_of_a_recording_as_csv(bag):
    rows = list(csv.DictReader(io.StringIO(mech_twin("info", bag, "--csv").out)))
    with BagReader(bag) as reader:
        assert {row["topic"]: int(row["messages"]) for row in rows} == {
            name: topic.message_count for name, topic in reader.topics.items()
        }

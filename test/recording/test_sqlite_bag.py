# SPDX-License-Identifier: Apache-2.0
"""A recording in sqlite3 storage gives the same messages, samples and comparison as the MCAP it was made from."""

from __future__ import annotations

import io
import json
import sqlite3
import sys
from contextlib import closing, redirect_stdout
from pathlib import Path

import pytest
import yaml
from foreign_bags import by_topic, converted
from recordings import simulated_bag

from mech_twin.cli.main import main
from mech_twin.recording.bag_reader import BagReader, bag_info, open_bag
from mech_twin.recording.bag_samples import BagSamples
from mech_twin.recording.errors import BagError, DamagedBagError, ForeignFileError, MissingBagError, OutsideBagError
from mech_twin.recording.recovery import recover
from mech_twin.recording.schemas import recorded_qos
from mech_twin.recording.sqlite_reader import SqliteReader

DRUM = "winding_drum"


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    directory = tmp_path_factory.mktemp("sqlite")
    simulated_bag(DRUM, 0.2, directory / "bag")
    return directory / "bag", converted(directory / "bag", directory / "sqlite")


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("part", [{}, {"start_s": 0.05, "duration_s": 0.1}, {"topics": [f"/{DRUM}/step/linkage"]}])
def test_the_same_messages_topics_and_times(bags, part, version, tmp_path):
    sqlite = converted(bags[0], tmp_path / "old", version) if version != 9 else bags[1]
    with open_bag(bags[0]) as one, open_bag(sqlite) as other:
        assert isinstance(one, BagReader)
        assert isinstance(other, SqliteReader)
        assert by_topic(list(other.messages(**part))) == by_topic(list(one.messages(**part)))
        assert (other.start_ns, other.end_ns) == (one.start_ns, one.end_ns)
        for name, topic in one.topics.items():
            again = other.topics[name]
            assert (again.type_name, again.message_count) == (topic.type_name, topic.message_count)
            assert recorded_qos(again.qos_yaml) == recorded_qos(topic.qos_yaml)
        assert (other.info.duration_s, other.info.message_count) == (one.info.duration_s, one.info.message_count)
        times = [message.log_time_ns for message in other.messages()]
        assert times == sorted(times)


def test_the_same_samples(bags):
    with open_bag(bags[0]) as one, open_bag(bags[1]) as other:
        assert list(BagSamples(other).steps()) == list(BagSamples(one).steps())


def test_one_file_opens_alone_and_a_missing_page_is_named(bags, tmp_path):
    (file,) = bags[1].glob("*.db3")
    assert bag_info(file).message_count == bag_info(bags[1]).message_count
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / file.name).write_bytes(file.read_bytes())
    info = bag_info(tmp_path / "bag")
    assert not info.finished
    assert info.problems == (f"{tmp_path / 'bag'}: has no metadata.yaml",)


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("words", [["info"], ["replay", "--resimulate"], ["replay", "--analyse"]])
def test_the_commands_take_it(bags, words, monkeypatch):
    output = io.StringIO()
    monkeypatch.setattr(sys, "argv", ["mech-twin", *words, str(bags[1]), "--json"])
    with redirect_stdout(output), pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    answer = json.loads(output.getvalue())
    assert answer.get("identical", True)
    assert answer.get("message_count", 1) > 0


@pytest.mark.usefixtures("ros_domain")
def test_it_is_shown(bags, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["mech-twin", "view", str(bags[1]), "--save", str(tmp_path / "out.rrd")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert (tmp_path / "out.rrd").stat().st_size > 10_000


def copied(bag: Path, to: Path) -> Path:
    to.mkdir()
    for file in bag.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


def break_page(bag: Path, **changes: object) -> None:
    page = yaml.safe_load((bag / "metadata.yaml").read_text())
    page["rosbag2_bagfile_information"].update(changes)
    (bag / "metadata.yaml").write_text(yaml.safe_dump(page))


def no_database(file: Path) -> None:
    file.write_bytes(b"no database" * 1000)


def other_tables(file: Path) -> None:
    file.unlink()
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("CREATE TABLE messages(x)")
        database.execute("CREATE TABLE topics(y)")


def a_huge_message(file: Path) -> None:
    """Let the column of the payload compute 900 MB from nothing."""
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("ALTER TABLE messages RENAME TO old")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
            " data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL)"
        )
        database.execute("INSERT INTO messages(id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM old")


@pytest.mark.parametrize(
    ("harm", "error"),
    [
        (no_database, DamagedBagError),
        (other_tables, DamagedBagError),
        (a_huge_message, DamagedBagError),
        (lambda file: file.write_bytes(file.read_bytes()[:9000]), DamagedBagError),
        (lambda file: file.unlink(), BagError),
        (lambda file: break_page(file.parent, compression_format="lzma"), ForeignFileError),
        (lambda file: break_page(file.parent, relative_file_paths=["absent.db3"]), MissingBagError),
        (lambda file: break_page(file.parent, relative_file_paths=["/etc/hostname"]), DamagedBagError),
    ],
)
def test_what_cannot_be_read_is_said_in_one_line(bags, harm, error, tmp_path):
    bag = copied(bags[1], tmp_path / "bag")
    harm(next(bag.glob("*.db3")))
    with pytest.raises(error) as caught, open_bag(bag) as reader:
        list(reader.messages())
    assert "\n" not in str(caught.value)
    assert "mech-twin recover" not in str(caught.value)  # it takes no database


def test_a_database_is_not_read_through_a_link_out_of_the_bag(bags, tmp_path):
    bag = copied(bags[1], tmp_path / "bag")
    file = next(bag.glob("*.db3"))
    file.rename(tmp_path / "outside.db3")
    file.symlink_to(tmp_path / "outside.db3")
    with pytest.raises(OutsideBagError, match="leads out of the bag's directory"):
        open_bag(bag)


def test_recovery_names_the_converter(bags, tmp_path):
    with pytest.raises(MissingBagError, match="ros2 bag convert"):
        recover(bags[1], tmp_path / "out")
    with pytest.raises(ForeignFileError, match=r"\.db3: expected a file \.mcap .*ros2 bag convert"):
        recover(next(bags[1].glob("*.db3")), tmp_path / "out")
    assert not list(tmp_path.iterdir())

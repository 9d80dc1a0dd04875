# SPDX-License-Identifier: Apache-2.0
"""What other writers compress, files, messages or chunks, gives the same messages, in both storages."""

from __future__ import annotations

import io
import json
import shutil
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest
import zstandard
from bag_cases import written
from foreign_bags import by_topic, converted
from recordings import simulated_bag
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from mech_twin.cli.main import main
from mech_twin.recording.bag_directory import plain_message
from mech_twin.recording.bag_reader import bag_info, open_bag
from mech_twin.recording.bag_samples import BagSamples
from mech_twin.recording.errors import BagBeyondLimitsError, DamagedBagError, MissingPartError
from mech_twin.recording.record_file import UnreadableRecordError
from mech_twin.recording.recovery import recover

DRUM = "winding_drum"
MODES = CompressionMode
FORMS = [
    (storage, mode) for storage in StoragePlugin for mode in (MODES.FILE, MODES.MESSAGE, MODES.STORAGE)
    if (storage, mode) != (StoragePlugin.SQLITE3, MODES.STORAGE)
]  # fmt: skip


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("plain")
    simulated_bag(DRUM, 0.2, directory / "bag")
    return directory / "bag"


@pytest.fixture(scope="module", params=FORMS, ids=lambda form: f"{form[0].name}-{form[1].name}")
def packed(request: pytest.FixtureRequest, plain: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    storage, mode = request.param
    return converted(plain, tmp_path_factory.mktemp("packed") / "bag", storage=storage, mode=mode)


def told(words: list[str], monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """Return exit code and JSON of a command."""
    output = io.StringIO()
    monkeypatch.setattr(sys, "argv", ["mech-twin", *words, "--json"])
    with redirect_stdout(output), pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, json.loads(output.getvalue())


def test_a_compressed_bag_gives_the_messages_and_samples_of_the_plain_one(packed: Path, plain: Path) -> None:
    with open_bag(packed) as one, open_bag(plain) as other:
        assert by_topic(list(one.messages())) == by_topic(list(other.messages()))
        assert list(BagSamples(one).steps()) == list(BagSamples(other).steps())
        assert one.info.finished
        assert one.info.problems == ()


def test_one_file_of_a_compressed_bag_opens_alone(packed: Path, plain: Path) -> None:
    (file,) = (path for path in packed.iterdir() if path.name != "metadata.yaml")
    with open_bag(file) as one, open_bag(plain) as other:
        assert by_topic(list(one.messages())) == by_topic(list(other.messages()))


@pytest.mark.usefixtures("ros_domain")
def test_info_names_the_machine_that_a_comparison_computes(packed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code, about = told(["info", str(packed)], monkeypatch)
    again, verdict = told(["replay", "--resimulate", str(packed)], monkeypatch)
    assert (code, again, verdict["identical"]) == (0, 0, True)
    assert about["machine"] == verdict["machine"] == DRUM
    assert about["version"] == ", ".join(verdict["recorded_with"])


def test_a_compressed_file_leaves_nothing_behind(packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with open_bag(packed) as reader:
        assert reader.info.message_count > 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("mode", [MODES.FILE, MODES.MESSAGE])
def test_a_compressed_bag_is_salvaged_into_a_plain_one(plain: Path, tmp_path: Path, mode: MODES) -> None:
    bag = converted(plain, tmp_path / "bag", storage=StoragePlugin.MCAP, mode=mode)
    recover(bag, tmp_path / "out")
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".mcap", ".yaml"}
    with open_bag(tmp_path / "out") as one, open_bag(plain) as other:
        assert by_topic(list(one.messages())) == by_topic(list(other.messages()))


@pytest.mark.slow
def test_a_compressed_file_that_is_cut_is_told_and_salvaged_as_far_as_it_goes(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 20_000, compression="none")
    whole = bag_info(bag).message_count
    file = bag / "bag_0.mcap"
    data = zstandard.ZstdCompressor(write_content_size=False).compress(file.read_bytes())
    file.unlink()
    (bag / "bag_0.mcap.zstd").write_bytes(data[: len(data) * 2 // 3])
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("bag_0.mcap", "bag_0.mcap.zstd"))
    with pytest.raises(DamagedBagError, match=f"mech-twin recover {bag}"), open_bag(bag):
        pass
    assert bag_info(bag).problems
    report = recover(bag, tmp_path / "out")
    assert 0 < report.messages.total() < whole
    assert any("salvaged from a damaged recording" in line for line in bag_info(tmp_path / "out").problems)


def test_a_file_larger_than_the_disk_is_refused(plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = converted(plain, tmp_path / "bag", storage=StoragePlugin.MCAP, mode=MODES.FILE)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10_000, 0, 10_000))  # type: ignore[attr-defined]
    with pytest.raises(BagBeyondLimitsError, match="does not fit the disk"), open_bag(bag):
        pass


@pytest.mark.parametrize("raw", [b"\x28\xb5\x2f\xfd", b"\x28\xb5\x2f\xfd" + bytes(30)])
def test_a_message_that_cannot_be_decompressed_is_refused(raw: bytes) -> None:
    with pytest.raises(UnreadableRecordError):
        plain_message(raw)


def test_a_missing_part_in_sqlite3_storage_is_told_with_a_remedy_that_works(plain: Path, tmp_path: Path) -> None:
    bag = converted(plain, tmp_path / "bag")
    (file,) = bag.glob("*.db3")
    listed = bag / "metadata.yaml"
    listed.write_text(listed.read_text().replace(f"- {file.name}", f"- {file.name}\n  - bag_1.db3", 1))
    with pytest.raises(MissingPartError, match=f"move {listed} away"), open_bag(bag):
        pass
    info = bag_info(bag)
    assert info.problems == (f"{bag}: its part bag_1.db3 is missing",)
    assert info.message_count > 0
    listed.rename(tmp_path / "away.yaml")
    assert bag_info(bag).message_count == info.message_count


def test_a_gap_in_the_numbers_of_sqlite3_parts_is_told_without_metadata(plain: Path, tmp_path: Path) -> None:
    bag = converted(plain, tmp_path / "bag")
    (file,) = bag.glob("*.db3")
    file.rename(bag / "bag_2.db3")
    (bag / "metadata.yaml").unlink()
    assert [line for line in bag_info(bag).problems if "bag_1.db3 is missing" in line]

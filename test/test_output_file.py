# SPDX-License-Identifier: Apache-2.0
"""Outputs are checked before the work, complete or absent after it, and never written through a symbolic link."""

import os
import stat

import pytest

from mech_twin.files.output_file import OutputError, check_output_directory, check_output_file, written_file


def names(directory):
    return sorted(path.name for path in directory.iterdir())


@pytest.fixture(params=[0o022, 0o077, 0o000])
def umask(request):
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_a_finished_file_has_the_mode_of_the_umask_and_is_never_writable_for_everyone(tmp_path, umask):
    with written_file(tmp_path / "out.csv") as temporary:
        temporary.write_text("a,b\n")
    assert (tmp_path / "out.csv").read_text() == "a,b\n"
    assert stat.S_IMODE((tmp_path / "out.csv").stat().st_mode) == 0o664 & ~umask
    assert names(tmp_path) == ["out.csv"]


@pytest.mark.parametrize("failure", [KeyboardInterrupt, SystemExit, ValueError, OSError(28, "No space left on device")])
@pytest.mark.parametrize("there", [False, True])
def test_what_fails_leaves_what_was_there(tmp_path, failure, there):
    out = tmp_path / "out.csv"
    if there:
        out.write_text("before")
    with (
        pytest.raises((KeyboardInterrupt, SystemExit, ValueError, OutputError)),
        written_file(out, force=there) as file,
    ):
        file.write_text("half of")
        raise failure
    assert names(tmp_path) == (["out.csv"] if there else [])
    assert not there or out.read_text() == "before"


def test_an_existing_file_is_kept_unless_forced(tmp_path):
    out = tmp_path / "out.csv"
    out.write_text("before")
    with pytest.raises(OutputError, match=r"out\.csv: exists already; use --force"), written_file(out):
        pytest.fail("the work was begun")
    with written_file(out, force=True) as file:
        file.write_text("after")
    assert out.read_text() == "after"


def test_a_file_that_appears_during_the_work_is_kept(tmp_path):
    out = tmp_path / "out.csv"
    with pytest.raises(OutputError, match="exists already"), written_file(out) as file:
        file.write_text("ours")
        out.write_text("theirs")
    assert out.read_text() == "theirs"
    assert names(tmp_path) == ["out.csv"]


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("target", ["kept.txt", "absent.txt"])
def test_a_symbolic_link_is_never_followed(tmp_path, force, target):
    kept, link = tmp_path / "kept.txt", tmp_path / "out.csv"
    kept.write_text("kept")
    link.symlink_to(tmp_path / target)
    with pytest.raises(OutputError, match="not a regular file"), written_file(link, force=force):
        pytest.fail("the work was begun")
    with pytest.raises(OutputError, match="not a directory"):
        check_output_directory(link, force=force)
    assert kept.read_text() == "kept"
    assert not (tmp_path / "absent.txt").exists()


def test_a_link_put_there_during_the_work_is_replaced_and_not_followed(tmp_path):
    kept, out = tmp_path / "kept.txt", tmp_path / "out.csv"
    kept.write_text("kept")
    out.write_text("before")
    with written_file(out, force=True) as file:
        file.write_text("after")
        out.unlink()
        out.symlink_to(kept)
    assert (kept.read_text(), out.read_text(), out.is_symlink()) == ("kept", "after", False)


@pytest.mark.parametrize("path", ["/proc/x.csv", "/no/such/place/x.csv", "/dev/null", "/etc/hostname/x.csv", "/etc"])
def test_what_cannot_be_written_is_one_line_before_the_work(path, tmp_path):
    with pytest.raises(OutputError) as refusal:
        check_output_file(tmp_path / path, force=True)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)


def test_a_directory_is_checked_without_being_made(tmp_path):
    check_output_directory(tmp_path / "a" / "b")
    check_output_directory(tmp_path)
    assert names(tmp_path) == []
    with pytest.raises(OutputError, match="cannot be written"):
        check_output_directory(tmp_path / "/proc/x/y")
    (tmp_path / "old.png").touch()
    with pytest.raises(OutputError, match="not empty; use --force"):
        check_output_directory(tmp_path)
    check_output_directory(tmp_path, force=True)

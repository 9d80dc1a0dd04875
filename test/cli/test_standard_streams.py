# SPDX-License-Identifier: Apache-2.0
"""A result that cannot be written is one line and an exit code; what a terminal would obey reaches none."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import mech_twin

COMMAND = [sys.executable, "-m", "mech_twin"]
FULL = "standard output: cannot be written: No space left on device"
CLOSED = "standard output: cannot be written: Bad file descriptor"
OUTPUTS = {"JSON": ["list", "--json"], "table": ["list"], "help": ["--help"], "version": ["--version"]}
ESCAPE = "\x1b[31m\x9b"


def in_shell(words: list[str], redirection: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["sh", "-c", f'exec "$@" {redirection}', "sh", *COMMAND, *words],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize("words", OUTPUTS.values(), ids=OUTPUTS)
@pytest.mark.parametrize(("redirection", "line"), [(">/dev/full", FULL), (">&-", CLOSED)], ids=["full", "closed"])
def test_an_output_that_cannot_be_written_is_one_line(words: list[str], redirection: str, line: str) -> None:
    done = in_shell(words, redirection)
    assert (done.returncode, done.stderr) == (2, f"mech-twin: {line}\n")


@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-"], ids=["full", "closed"])
def test_an_error_that_cannot_be_said_keeps_its_exit_code(redirection: str) -> None:
    assert in_shell(["analyse", "nothing"], redirection).returncode == 2


def test_with_every_stream_closed_an_output_file_holds_only_what_belongs_there(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    words = ["simulate", "winding_drum", "--duration", "0.01", "--table", str(table)]
    assert in_shell(words, "<&- >&- 2>&-").returncode == 2  # the summary could not be written
    assert table.read_text(encoding="utf-8").splitlines()[0].startswith("time_s,")


@pytest.mark.parametrize("words", OUTPUTS.values(), ids=OUTPUTS)
def test_who_reads_no_further_ends_a_command_as_other_tools_without_a_word(words: list[str]) -> None:
    script = 'set -o pipefail; (sleep 0.2; exec "$@") | true'
    done = subprocess.run(
        ["bash", "-c", script, "bash", *COMMAND, *words], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("words", [["analyse", "mb10_breaker"], ["analyse", "mb10_breaker", "--json"]])
def test_what_an_encoding_lacks_is_said_as_an_escape(words: list[str]) -> None:
    strange = {**os.environ, "LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([*COMMAND, *words], capture_output=True, timeout=120, check=False, env=strange)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()
    assert "--json" in words or rb"m/rad\u00b2" in done.stdout


def test_a_working_directory_that_is_gone_is_one_line(tmp_path: Path) -> None:
    """Or none, where no library looks for it while it is loaded."""
    script = 'mkdir gone; cd gone; rmdir ../gone; exec "$@"'
    done = subprocess.run(
        ["sh", "-c", script, "sh", *COMMAND, "analyse", "vibration_crank"],
        capture_output=True, text=True, timeout=120, check=False, cwd=tmp_path,
    )  # fmt: skip
    line = "mech-twin: the working directory does not exist any more: change to another one\n"
    assert (done.returncode, done.stderr) in ((2, line), (0, ""))


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "mb10_breaker", "--duration", "1", "--set", f"key{ESCAPE}=1"],
        ["simulate", "mb10_breaker", "--duration", "1", "--config", f"file{ESCAPE}.yaml"],
        ["simulate", "mb10_breaker", f"--option{ESCAPE}"],
        [f"verb{ESCAPE}"],
        ["info", f"bag{ESCAPE}"],
    ],
    ids=["key", "file", "option", "verb", "bag"],
)
def test_what_a_terminal_would_obey_is_said_as_an_escape(words: list[str]) -> None:
    said = mech_twin(*words).err
    assert said.rstrip("\n").isprintable()
    assert r"\x1b[31m\x9b" in said


def test_a_key_of_a_file_is_said_as_an_escape(tmp_path: Path) -> None:
    file = tmp_path / "keys.yaml"
    file.write_text('/**:\n  ros__parameters:\n    "key\\e[31m": 1\n', encoding="utf-8")
    assert r"key\x1b[31m" in mech_twin("analyse", "mb10_breaker", "--config", file).err


PIPES = {
    "configuration": ["simulate", "winding_drum", "--duration", "1", "--config"],
    "map": ["info", "pyproject.toml", "--map"],
    "recording": ["info"],
    "run": ["monitor", "winding_drum", "--baseline", "none.json"],
}


@pytest.mark.parametrize("words", PIPES.values(), ids=PIPES)
def test_a_pipe_that_nobody_writes_is_refused(words: list[str], tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    done = subprocess.run([*COMMAND, *words, str(pipe)], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert re.search("pipe: .*is not a regular file", done.stderr)


@pytest.mark.parametrize("verb", ["run", "simulate"])
@pytest.mark.parametrize("text", ["1e300", "2147483648", "1e6h"])
def test_a_duration_that_no_stamp_can_hold_is_refused(verb: str, text: str) -> None:
    ended = mech_twin(verb, "winding_drum", "--duration", text)
    assert ended.code == 2
    assert f"--duration {text}: expected at most 2147483647 s" in ended.err

# SPDX-License-Identifier: Apache-2.0
"""A signal at a moment of a verb: the programs, how a moment is known to have come, and what is seen at the end."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import pi, sin
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
from pyarrow import compute as pc
from pyarrow import parquet

from mech_twin.kernels.cache import DIRECTORY_VARIABLE
from mech_twin.recording.bag_reader import BagReader, bag_info
from mech_twin.recording.errors import BagError

COMMAND = "from mech_twin.programs import {program}; {program}()"
ROOT = Path(__file__).resolve().parents[1]
SENSORS = ROOT / "benchmarks" / "monitoring" / "sensors"
SAMPLE_BAG = str(ROOT / "bags" / "impact_mass")
RUN = ["run", "winding_drum", "--view", "none", "--record", "BAG"]
START_LIMIT_S = 90.0
END_LIMIT_S = 30.0
WORKERS = 2
IMPORTING_S, BRIEFLY_S = 0.5, 0.5
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
COMPUTED_S = 8.0  # of the processor: more than the imports take
MIDDLEWARE, DRAWING, TABLES = "librmw_fastrtps", "matplotlib", "libarrow"
TURN_ROWS, TURNS = 1_000_000, 100


class Started(NamedTuple):
    """A program under way."""

    process: subprocess.Popen[bytes]
    folder: Path
    far_end: int | None = None  # of its terminal, where it has one

    @property
    def bag(self) -> Path:
        """Where it records."""
        return self.folder / "bag"

    @property
    def errors(self) -> str:
        """What it has written to standard error."""
        return (self.folder / "errors").read_text()

    def hang_up(self) -> None:
        """Close its terminal."""
        assert self.far_end is not None
        os.close(self.far_end)


class Verb(NamedTuple):
    """A command line (BAG, OUT, TABLE, SAMPLE are places), and what shows each of its moments; 0 is an end of it."""

    words: list[str]
    under_way: Callable[[Started], bool]
    moments: tuple[str, ...] = ("importing", "under way")
    ends_well: bool = False  # where a signal is how it is ended
    records: bool = False
    program: str = "command"


class Seen(NamedTuple):
    """What became of a program that was sent a signal."""

    code: int
    took_s: float
    errors: str
    left: set[int]  # of its processes


def until(predicate: Callable[[], bool], limit_s: float = START_LIMIT_S) -> None:
    """Wait until something holds; fail if it does not within the limit."""
    end = time.monotonic() + limit_s
    while not predicate():
        assert time.monotonic() < end, "did not happen within the limit"
        time.sleep(0.02)


def descendants(of: int) -> set[int]:
    """Return the processes below one."""
    found: set[int] = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except (OSError, IndexError):
                continue
            if parent == of:
                found |= {int(entry.name), *descendants(int(entry.name))}
    return found


def alive(pid: int) -> bool:
    """Return whether a process has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def answers(pid: int, number: signal.Signals) -> bool:
    """Return whether a process has a handler for a signal: before, its interpreter is not ready."""
    caught = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


def has_loaded(library: str) -> Callable[[Started], bool]:
    """Return whether a library has been loaded for a while."""
    since: dict[int, float] = {}

    def loaded(started: Started) -> bool:
        pid = started.process.pid
        if library in Path(f"/proc/{pid}/maps").read_text():
            since.setdefault(pid, time.monotonic())
        return pid in since and time.monotonic() > since[pid] + BRIEFLY_S

    return loaded


def has_recorded(started: Started) -> bool:
    """Return whether chunks of steps have been written since the file was begun with its message definitions."""
    file = started.bag / "bag_0.mcap"
    return file.exists() and file.stat().st_size > 100_000


def processor_s(pid: int) -> float:
    """Return how long a process and those below it have used the processor."""
    ticks = 0
    for each in {pid, *descendants(pid)}:
        with suppress(OSError, IndexError):
            fields = Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def has_computed(started: Started) -> bool:
    """Return whether it and its processes have used the processor for longer than their imports."""
    return processor_s(started.process.pid) >= COMPUTED_S


def has_workers(started: Started) -> bool:
    """Return whether its workers have been started."""
    return len(descendants(started.process.pid)) >= WORKERS


def has_said(word: str) -> Callable[[Started], bool]:
    """Return whether a word stands in what it has written to standard error."""
    return lambda started: word in started.errors


SWEEP = ["sweep", "--over", "eccentricity_m=0:0.01:4000", "--duration", "2", "--cores", str(WORKERS), "--no-picture"]
VERBS = {
    "run": Verb(RUN, has_recorded, ("importing", "compiling", "discovery", "under way"), True, True),
    "processes": Verb(
        [*RUN, "--processes"], has_recorded, ("importing", "compiling", "starting", "under way"), True, True
    ),
    "simulate": Verb(
        ["simulate", "winding_drum", "--duration", "3600", "--bag", "BAG"],
        has_recorded,
        ("importing", "compiling", "under way"),
        True,
        True,
    ),
    "node": Verb(
        ["--ros-args", "-p", "machine:=winding_drum"],
        has_loaded(MIDDLEWARE),
        ("importing", "compiling", "under way"),
        True,
        program="linkage_node",
    ),
    "replay": Verb(
        ["replay", "SAMPLE", "--loop"], has_loaded(MIDDLEWARE), ("importing", "discovery", "under way"), True
    ),
    "shadow": Verb(
        ["shadow", "winding_drum", "--from", "elsewhere"],
        has_loaded(MIDDLEWARE),
        ("importing", "discovery", "under way"),
        True,
    ),
    "view": Verb(["view", "SAMPLE", "--port", "0"], has_said("complete"), ("importing", "starting", "under way"), True),
    "study": Verb(
        ["study", "winding_drum", *SWEEP, "--out", "OUT.csv"], has_workers, ("importing", "compiling", "under way")
    ),
    "identify": Verb(
        ["identify", "mb10_breaker", "--plan", "--sensors", f"{SENSORS}/mb10_breaker.yaml", "--duration", "60"],
        has_computed,
    ),
    "monitor": Verb(["monitor", "mb10_breaker", "--design", "--sensors", f"{SENSORS}/mb10_breaker.yaml"], has_computed),
    "map": Verb(["map", "TABLE.parquet", "vibration_crank"], has_loaded(TABLES)),
    "figures": Verb(["reproduce", "mb10_breaker", "--figures", "OUT"], has_loaded(DRAWING)),
}


@contextmanager
def running_in_a_terminal(verb: Verb, folder: Path) -> Iterator[Started]:
    """Start a verb at a terminal, all of whose output goes there; see `running`."""
    ours, theirs = pty.openpty()
    command = ["setsid", "--ctty", *_command(verb, folder)]  # executes it in place
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    with _killed_at_the_end(process):
        yield Started(process, folder, ours)


@contextmanager
def running(verb: Verb, folder: Path, cache: Path | None = None) -> Iterator[Started]:
    """Start a verb in a process group of its own, with kernels of its own in a cache where one is given.

    What is left of it at the end is killed.
    """
    command = _command(verb, folder)
    environment = {**os.environ, **({} if cache is None else {DIRECTORY_VARIABLE: str(cache)})}
    with (folder / "errors").open("wb") as errors:
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=errors, env=environment, start_new_session=True
        )
    with _killed_at_the_end(process):
        yield Started(process, folder)


def _command(verb: Verb, folder: Path) -> list[str]:
    places = {"BAG": str(folder / "bag"), "OUT": str(folder / "out"), "OUT.csv": str(folder / "out.csv")}
    if "TABLE.parquet" in verb.words:
        places["TABLE.parquet"] = str(_long_table(folder / "table.parquet"))
    words = [places.get(word, word.replace("SAMPLE", SAMPLE_BAG)) for word in verb.words]
    return [sys.executable, "-c", COMMAND.format(program=verb.program), *words]


def _long_table(file: Path) -> Path:
    """Write a table that takes far longer to read than a test to come: one turn of a crank, again and again."""
    if not file.exists():
        angles = [i * 2.0 * pi / TURN_ROWS for i in range(TURN_ROWS)]
        positions = {"linkage.crank.position": angles, "linkage.slider.position": [0.1 * sin(each) for each in angles]}
        turn = pa.table({"time_s": [i * 1e-6 for i in range(TURN_ROWS)], **positions})
        rounded = pa.table({name: pc.round(turn[name], 2) for name in turn.column_names})  # small in a dictionary
        with parquet.ParquetWriter(file, rounded.schema, compression="zstd") as table:
            for _ in range(TURNS):
                table.write_table(rounded)
    return file


@contextmanager
def _killed_at_the_end(process: subprocess.Popen[bytes]) -> Iterator[None]:
    try:
        yield
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def wait_for(moment: str, verb: Verb, started: Started, cache: Path) -> None:
    """Wait until a moment has come; kernels are being compiled from the first in the cache on, with dozens to come."""
    match moment:
        case "importing":
            until(lambda: answers(started.process.pid, SIGNALS[-1]))  # the last to be set
            time.sleep(IMPORTING_S)
        case "compiling":
            until(lambda: any(path.is_file() for path in cache.rglob("*")))
        case "discovery":
            until(lambda: MIDDLEWARE in Path(f"/proc/{started.process.pid}/maps").read_text())
        case "starting":
            until(lambda: bool(descendants(started.process.pid)))
        case _:
            until(lambda: verb.under_way(started))


def seen_after(verb: Verb, moment: str, number: signal.Signals, folder: Path, group: bool = False) -> Seen:
    """Start a verb, send it a signal at a moment, and return what was seen.

    Parameters
    ----------
    verb : Verb
        What to start.
    moment : str
        One of its moments.
    number : Signals
        What to send.
    folder : Path
        For all it writes, and for its kernels where the moment is "compiling".
    group : bool
        Whether its children get the signal too, as from a terminal.
    """
    cache = folder / "kernels"
    with running(verb, folder, cache if moment == "compiling" else None) as started:
        wait_for(moment, verb, started, cache)
        children = descendants(started.process.pid)
        asked = time.monotonic()
        if group:
            os.killpg(started.process.pid, number)
        else:
            started.process.send_signal(number)
        code = started.process.wait(END_LIMIT_S)
        took_s = time.monotonic() - asked
        left = lasting(children)
    return Seen(code, took_s, started.errors, left)


def lasting(processes: set[int], limit_s: float = 10.0) -> set[int]:
    """Return those processes that still live after a time in which they should have ended."""
    end = time.monotonic() + limit_s
    while any(map(alive, processes)) and time.monotonic() < end:
        time.sleep(0.02)
    return {process for process in processes if alive(process)}


def is_recording(bag: Path) -> bool:
    """Return whether a bag is closed and holds something: the signal may come late on a busy machine."""
    try:
        info = bag_info(bag)
    except BagError:
        return False
    return info.finished and info.message_count > 0


def faults(verb: Verb, moment: str, number: signal.Signals, seen: Seen, folder: Path) -> list[str]:
    """Return what is wrong with what was seen."""
    found = []
    wanted = {128 + number} | ({0} if verb.ends_well and moment == "under way" else set())
    if seen.code not in wanted:
        found.append(f"exit code {seen.code}: {seen.errors[-500:]}")
    if "Traceback" in seen.errors:
        found.append(f"a trace: {seen.errors[-500:]}")
    if seen.left:
        found.append(f"{len(seen.left)} of its processes live on")
    if verb.records and moment == "under way":
        with BagReader(folder / "bag") as reader:
            if not reader.info.finished:
                found.append("the recording is not closed")
    elif verb.records and (folder / "bag").exists() and not is_recording(folder / "bag"):
        found.append("a folder is left of a run that had not begun")
    return found

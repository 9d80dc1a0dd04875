# SPDX-License-Identifier: Apache-2.0
"""Sweep of configuration keys: summary numbers at every point of a grid."""

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import StudyError
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.declared_studies import FilePath, refusing
from mech_twin.studies.spreading import check_scheduler, spread, used_cores
from mech_twin.studies.sweep_table import Point, Question, points, question, require_outputs, write_picture, write_table

LARGEST_BATCH = 64
WORTH_SPREADING_S = 3.0  # total work below which starting processes costs more than it saves
FORMATS = (".parquet", ".csv")

Progress = Callable[[int, int], None]


class SweepJournal:
    """The finished points of one question on disk, so that an interrupted sweep can be resumed.

    The file has one JSON document per line: first the question, then each finished point.  A line that was cut off by
    an interruption is dropped; a repeated index is ignored.
    """

    def __init__(self, path: Path, asked: Question) -> None:
        self._path = path
        self._head = json.loads(json.dumps(asdict(asked)))
        self.finished: dict[int, Point] = {}
        if path.exists():
            self._resume()
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(self._head) + "\n", encoding="utf-8")
        self._stream = path.open("a", encoding="utf-8")

    def _resume(self) -> None:
        text = self._path.read_bytes()
        whole = text[: text.rfind(b"\n") + 1]
        lines = whole.decode("utf-8").splitlines()
        if not lines or json.loads(lines[0]) != self._head:
            raise StudyError(f"{self._path}: holds points of another sweep; remove it or write elsewhere")
        if len(whole) < len(text):
            with self._path.open("r+b") as stream:
                stream.truncate(len(whole))
        for line in lines[1:]:
            known = json.loads(line)
            numbers = {name: float(value) for name, value in known["numbers"].items()}
            self.finished.setdefault(known["index"], Point(known["index"], numbers, known["refused"]))

    def add(self, found: Iterable[Point]) -> int:
        """Write points that are new; return their number."""
        fresh = [point for point in found if point.index not in self.finished]
        for point in fresh:
            self.finished[point.index] = point
            numbers = {name: value if math.isfinite(value) else repr(value) for name, value in point.numbers.items()}
            self._stream.write(json.dumps({"index": point.index, "numbers": numbers, "refused": point.refused}) + "\n")
        self._stream.flush()
        return len(fresh)

    def close(self) -> None:
        """Close the file, without removing it."""
        self._stream.close()

    def remove(self) -> None:
        """Close and remove the file, after the table of the sweep was written."""
        self.close()
        self._path.unlink()


@dataclass(frozen=True)
class Sweep:
    """A finished sweep: its question, points in order, files, and the number of points taken from an earlier run."""

    asked: Question
    points: tuple[Point, ...]
    table: Path
    picture: Path | None
    resumed: int

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all summary numbers, in order of appearance."""
        return tuple(dict.fromkeys(name for found in self.points for name in found.numbers))


def journal_of(table: Path) -> Path:
    """Return the path of the journal of a table."""
    return table.with_name(table.name + ".partial")


@refusing()
def sweep(
    machine: str,
    axes: Mapping[str, Sequence[float | int | str | bool]],
    table: FilePath,
    *,
    parameters: Parameters | None = None,
    outputs: Sequence[str] = (),
    duration_s: float = 0.0,
    cores: int | None = None,
    scheduler: str | None = None,
    picture: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Compute the summary numbers of a machine over a grid of configuration keys; write a table and a plot.

    An interrupted sweep continues where it stopped if it is called again with the same table.

    ``NAME.partial`` beside the table stores finished points until then.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    axes : mapping
        Dotted configuration keys and the values each takes; several keys make a grid.
    table : path
        ``.parquet`` or ``.csv`` file to write.
    parameters : Parameters, optional
        The rest of the configuration; the installed one if absent.
    outputs : sequence of str
        Names of the requested summary numbers; all if empty.
    duration_s : float
        Simulated time at each point, whose metrics are added to the summary; 0 for the report alone.
    cores : int, optional
        Processes to spread over; all cores if absent.
    scheduler : str, optional
        Address of a Dask scheduler to use instead.
    picture : bool
        Whether to plot the table.
    progress : callable, optional
        ``progress(done, all)``.

    Raises
    ------
    StudyError
        If the file name has another suffix, or every point is rejected; then no table is written.
    """
    table, asked = Path(table), question(machine, parameters or machine_parameters(machine), axes, outputs, duration_s)
    if table.suffix not in FORMATS:
        raise StudyError(f"{table}: expected a name that ends in {' or '.join(FORMATS)}")
    require_outputs(asked)
    workers = used_cores(cores)
    check_scheduler(scheduler)  # before the first points, which are computed here
    journal = SweepJournal(journal_of(table), asked)
    resumed = len(journal.finished)
    try:
        _finish(asked, journal, workers, scheduler, progress or (lambda _done, _all: None))
    finally:
        journal.close()
    found = tuple(journal.finished[index] for index in range(asked.count))
    if all(point.refused for point in found):
        journal.remove()
        raise StudyError(f"no point of the sweep is possible ({asked.count} refused); the first: {found[0].refused}")
    write_table(asked, found, table)
    drawn = table.with_suffix(".png") if picture and asked.count > 1 else None
    if drawn is not None and not write_picture(asked, found, drawn):
        drawn = None
    journal.remove()
    return Sweep(asked, found, table, drawn, resumed)


def _finish(asked: Question, journal: SweepJournal, cores: int, scheduler: str | None, progress: Progress) -> None:
    missing = [index for index in range(asked.count) if index not in journal.finished]
    progress(len(journal.finished), asked.count)
    if not missing:
        return
    # the first points in this process, so that kernels are compiled before others need them; the second is timed
    for index in missing[:2]:
        begun = time.monotonic()
        journal.add(points(asked, [index]))
        progress(len(journal.finished), asked.count)
    rest, taken = missing[2:], time.monotonic() - begun
    if scheduler is None and taken * len(rest) < WORTH_SPREADING_S:
        cores = 1
    with closing(spread(partial(points, asked), batches_of(rest, cores, taken), cores, scheduler)) as results:
        for found in results:
            journal.add(found)
            progress(len(journal.finished), asked.count)


def batches_of(indices: list[int], cores: int, seconds_each: float) -> list[list[int]]:
    """Return the indices in batches of about half a second of work, several for every core, at most `LARGEST_BATCH`."""
    wanted = 0.5 / max(seconds_each, 1e-6)
    shared = math.ceil(len(indices) / (8 * max(cores, 1)))
    size = max(1, min(LARGEST_BATCH, int(wanted), shared))
    return [indices[start : start + size] for start in range(0, len(indices), size)]

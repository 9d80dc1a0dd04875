# SPDX-License-Identifier: Apache-2.0
"""Sweep of configuration keys: summary numbers at every point of a grid."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mech_twin.capabilities.errors import StudyError
from mech_twin.studies.spreading import available_cores, spread
from mech_twin.studies.sweep_journal import SweepJournal
from mech_twin.studies.sweep_points import Point, Question, points, require_outputs
from mech_twin.studies.sweep_table import write_picture, write_table

LARGEST_BATCH = 64
WORTH_SPREADING_S = 3.0  # total work below which starting processes costs more than it saves
FORMATS = (".parquet", ".csv")

Progress = Callable[[int, int], None]


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


def swept(
    asked: Question,
    table: Path,
    *,
    cores: int | None = None,
    scheduler: str | None = None,
    picture: bool = True,
    progress: Progress | None = None,
) -> Sweep:
    """Compute every point not finished by an earlier run, and write table and plot.

    Parameters
    ----------
    asked : Question
        Machine, axes and outputs.
    table : Path
        Parquet or CSV file to write; ``NAME.partial`` beside it stores finished points until then.
    cores : int, optional
        Processes on this computer; all cores if absent.
    scheduler : str, optional
        Address of a Dask scheduler to use instead.
    picture : bool
        Whether to plot the table too (PNG of the same name).
    progress : callable, optional
        ``progress(done, all)`` after each batch.

    Raises
    ------
    StudyError
        If the file name has another suffix, or every point is rejected; then no table is written.
    """
    if table.suffix not in FORMATS:
        raise StudyError(f"{table}: expected a name that ends in {' or '.join(FORMATS)}")
    require_outputs(asked)
    journal = SweepJournal(journal_of(table), asked)
    resumed = len(journal.finished)
    try:
        _finish(asked, journal, cores or available_cores(), scheduler, progress or (lambda _done, _all: None))
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

"""Scan of the press's design space: very many random designs, spread over cores or a cluster."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from mech_twin.machines.compaction_press.design_problem import OBJECTIVES, SENSES, Space, evaluation
from mech_twin.studies.spreading import available_cores, spread

Array = NDArray[np.float64]
BATCH = 20_000
VARIABLES = ("crank_m", "length_m", "height_m", "pendulum_m")


class Scanned(NamedTuple):
    """A batch: its number, how many designs it drew, and the feasible ones with their objectives, shape (n, 7)."""

    number: int
    designs: int
    feasible: Array


@dataclass(frozen=True)
class DesignScan:
    """All batches together: designs drawn, and the feasible ones with their objectives, in order of the batches."""

    designs: int
    feasible: Array

    @property
    def share(self) -> float:
        """Share of the designs that is feasible."""
        return len(self.feasible) / self.designs

    def best(self, objective: str) -> dict[str, float]:
        """Return the best design for an objective, by name."""
        column = len(VARIABLES) + OBJECTIVES.index(objective)
        row = self.feasible[int(np.argmin(SENSES[OBJECTIVES.index(objective)] * self.feasible[:, column]))]
        return dict(zip((*VARIABLES, *OBJECTIVES), map(float, row), strict=True))

    def write(self, path: Path) -> None:
        """Write the feasible designs as Parquet."""
        import pyarrow as pa
        from pyarrow import parquet

        columns = dict(zip((*VARIABLES, *OBJECTIVES), self.feasible.T, strict=True))
        parquet.write_table(pa.table(columns), path, compression="zstd")


def scanned_batch(space: Space, seed: int, threads: int, batch: tuple[int, int]) -> Scanned:
    """Return one batch (number, size): its designs depend on seed and number alone, not on who computes it."""
    number, size = batch
    numba.set_num_threads(min(threads, available_cores()))
    lower, upper = np.array(space.lower_m), np.array(space.upper_m)
    designs = lower + np.random.default_rng([seed, number]).random((size, 4)) * (upper - lower)
    found = evaluation(designs, space.limits)
    keep = found.feasible
    return Scanned(number, size, np.hstack((designs[keep], found.objectives[keep])))


def design_scan(
    count: int,
    space: Space | None = None,
    seed: int = 1,
    *,
    cores: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DesignScan:
    """Return the feasible designs among ``count`` drawn evenly from the space.

    On one machine the compiled loop uses the cores itself; on a cluster each worker takes batches of its own.
    """
    sizes = [min(BATCH, count - start) for start in range(0, count, BATCH)]
    threads = 1 if scheduler is not None else cores or available_cores()
    task = partial(scanned_batch, space or Space(), seed, threads)
    done: dict[int, Scanned] = {}
    for found in spread(task, list(enumerate(sizes)), 1, scheduler):
        done.setdefault(found.number, found)
        if progress is not None:
            progress(sum(batch.designs for batch in done.values()), count)
    ordered = [done[number] for number in range(len(sizes))]
    return DesignScan(sum(batch.designs for batch in ordered), np.vstack([batch.feasible for batch in ordered]))

# SPDX-License-Identifier: Apache-2.0
"""Scan of a machine's design space: many random designs, distributed over cores or a cluster."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.arguments import GREATEST_SEED, sequence_items, whole_number
from mech_twin.capabilities.design import Design, DesignQuestion, DesignSpace
from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import StudyError
from mech_twin.files.output_file import written_file
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.declared_studies import asked_of, refusing, searches_by_runs
from mech_twin.studies.spreading import available_cores, spread, used_cores
from mech_twin.studies.sweep_table import write_parquet

Array = NDArray[np.float64]
BATCH = 20_000
MOST_DESIGNS = 1_000_000_000
MOST_POINTS = 1000  # of a front


class Scanned(NamedTuple):
    """A batch: its number, number of designs drawn, and the feasible ones, variables then objectives as columns."""

    number: int
    designs: int
    feasible: Array


@dataclass(frozen=True)
class DesignScan:
    """All batches: number of designs drawn, and the feasible ones with their objectives, in order of the batches."""

    variables: tuple[str, ...]
    objectives: Mapping[str, float]
    designs: int
    feasible: Array

    @property
    def share(self) -> float:
        """Share of feasible designs."""
        return len(self.feasible) / self.designs

    def best(self, objective: str) -> dict[str, float]:
        """Return the best design for an objective: variables and objectives by name."""
        names = (*self.variables, *self.objectives)
        values = self.objectives[objective] * self.feasible[:, names.index(objective)]
        return dict(zip(names, map(float, self.feasible[int(np.argmin(values))]), strict=True))

    def write(self, path: Path, notes: Mapping[str, str] | None = None) -> None:
        """Write the feasible designs to a Parquet file, which is overwritten, with notes in its metadata."""
        columns = dict(zip((*self.variables, *self.objectives), self.feasible.T, strict=True))
        with written_file(path, force=True) as unfinished:
            write_parquet(columns, notes or {}, unfinished)


def read_scan(machine: str, designs: int, table: Path) -> DesignScan:
    """Return a scan whose feasible designs were written by `DesignScan.write`.

    Raises
    ------
    StudyError
        The file cannot be read, or is of another machine.
    """
    from pyarrow import parquet

    question = design_question(machine)
    try:
        found = parquet.read_table(table)
        feasible = np.column_stack([found[name].to_numpy() for name in (*question.variables, *question.objectives)])
    except (OSError, ValueError, KeyError) as error:
        raise StudyError(f"{table}: expected the table of designs of {machine} ({error})") from error
    return DesignScan(tuple(question.variables), question.objectives, designs, feasible)


def design_question(machine: str) -> DesignQuestion:
    """Return the design question of a machine.

    Raises
    ------
    StudyError
        If the machine has none.
    """
    question: DesignQuestion = asked_of(machine, "design", "no design question")
    return question


def asked_objectives(question: DesignQuestion, objectives: tuple[str, ...]) -> tuple[str, ...]:
    """Return the requested objectives, by default the usual one; raise a StudyError for one unknown or twice."""
    for name in objectives:
        if objectives.count(name) > 1:
            raise StudyError(f"objective '{name}' stands twice; expected it once")
        if name not in question.objectives:
            raise StudyError(f"no objective '{name}'; expected one of {', '.join(question.objectives)}")
    return objectives or (next(iter(question.objectives)),)


def scanned_batch(
    machine: str, parameters: Parameters, space: DesignSpace, seed: int, threads: int, batch: tuple[int, int]
) -> Scanned:
    """Return one batch (number, size); its designs depend only on seed and number."""
    number, size = batch
    numba.set_num_threads(min(threads, available_cores()))
    designs = space.designs(np.random.default_rng([seed, number]).random((size, len(space.lower))))
    found = design_question(machine).evaluate(parameters, space, designs)
    keep = found.feasible
    return Scanned(number, size, np.hstack((designs[keep], found.objectives[keep])))


@refusing()
def search(
    machine: str,
    objectives: Sequence[str] = (),
    *,
    parameters: Parameters | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    limits: Mapping[str, float] | None = None,
    seed: int = 1,
    points: int = 9,
) -> list[Design]:
    """Return a machine's best design for one objective, or the Pareto front of several; the same for the same seed.

    Parameters
    ----------
    machine : str
        Machine of the catalogue that has a design question.
    objectives : sequence of str
        Objectives of the machine; its usual one if empty.
    parameters : Parameters, optional
        Configuration for all values but the design variables; the installed one if absent.
    bounds, limits : mapping, optional
        Bounds of variables and limits of constraints that differ from the usual ones, by name.
    seed : int
        Seed of scan and optimiser.
    points : int
        Directions of the Pareto front that are refined, besides one per objective.
    """
    if searches_by_runs(machine):
        raise StudyError(f"{machine}: no design question; `mech_twin.studies.search_runs` finds a design by its runs")
    question = design_question(machine)
    wanted = asked_objectives(question, sequence_items("objectives", objectives, "a list of names"))
    seed, points = whole_number("seed", seed, 0, GREATEST_SEED), whole_number("points", points, 1, MOST_POINTS)
    return question.search(
        parameters or machine_parameters(machine), question.space(bounds, limits), wanted, seed, points
    )


@refusing()
def designs(
    machine: str,
    count: int,
    *,
    parameters: Parameters | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    limits: Mapping[str, float] | None = None,
    seed: int = 1,
    cores: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DesignScan:
    """Return the feasible designs of a machine among ``count`` random ones.

    On one computer the compiled loop uses several threads; on a cluster each worker computes its own batches.

    Parameters
    ----------
    machine : str
        Machine of the catalogue that has a design question.
    count : int
        Number of random designs.
    parameters : Parameters, optional
        Configuration that is designed; the installed one if absent.
    bounds, limits : mapping, optional
        Bounds of variables and limits of constraints that differ from the usual ones, by name.
    seed : int
        Seed; the result does not depend on where a design is computed.
    cores : int, optional
        Cores of this machine; all if absent.
    scheduler : str, optional
        Address of a Dask scheduler to spread over instead.
    progress : callable, optional
        ``progress(done, all)``.
    """
    count, seed = whole_number("count", count, 1, MOST_DESIGNS), whole_number("seed", seed, 0, GREATEST_SEED)
    question = design_question(machine)
    sizes = [min(BATCH, count - start) for start in range(0, count, BATCH)]
    space, known = question.space(bounds, limits), parameters or machine_parameters(machine)
    threads = 1 if scheduler is not None else used_cores(cores)
    task = partial(scanned_batch, machine, known, space, seed, threads)
    done: dict[int, Scanned] = {}
    for found in spread(task, list(enumerate(sizes)), 1, scheduler):
        done.setdefault(found.number, found)
        if progress is not None:
            progress(sum(batch.designs for batch in done.values()), count)
    ordered = [done[number] for number in range(len(sizes))]
    return DesignScan(
        tuple(question.variables),
        question.objectives,
        sum(batch.designs for batch in ordered),
        np.vstack([batch.feasible for batch in ordered]),
    )

# SPDX-License-Identifier: Apache-2.0
"""The unknowns of a fit: keys, start times of runs, and sensor parameters that the map leaves free.

Here too are the question that an identification answers, and the simulations for values of the free keys, with the
command of each measured run; the last ones are cached.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import numpy.typing as npt

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import FREE, PER_RUN
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.identification.fit_runs import ColumnCurves, FitRun, needed_columns
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration, number_at
from mech_twin.studies.named_rollouts import rollouts

Curves = tuple[ColumnCurves, ...]
KEPT = 3  # simulations
KEY, BEGIN, ZERO, GAIN, LAG = "key", "begin", "zero", "gain", "lag"
TIME_SCALE_S = 1e-3
LONGEST_LAG_S = 0.5


class ModelRuns:
    """Simulations of a machine for comparison with measured runs.

    Parameters
    ----------
    longest_begin_s : float
        Latest start of a run whose start is unknown, as time since the machine's start.
    cores : int, optional
        Threads; all cores if absent.
    """

    def __init__(
        self, keyed: KeyedConfiguration, runs: Sequence[FitRun], longest_begin_s: float = 0.0, cores: int | None = None
    ) -> None:
        keyed.check()
        self.keyed, self.runs, self.rolled_out = keyed, tuple(runs), 0
        self._cores, self._longest_begin_s = cores, longest_begin_s
        names = [channel.name for run in runs for channel in run.channels if not channel.of_events]
        self._columns = needed_columns(names)
        self._kept: dict[bytes, Curves | None] = {}

    def over(self, runs: Sequence[FitRun]) -> ModelRuns:
        """Return the same machine with other parts of the runs."""
        return ModelRuns(self.keyed, runs, self._longest_begin_s, self._cores)

    def at(self, values: Array) -> Curves | None:
        """Return the columns of each run for these values of the keys; None if they are rejected or a run fails."""
        self.prepare([values])
        return self._kept[values.tobytes()]

    def prepare(self, members: Sequence[Array]) -> None:
        """Compute what `at` will be asked for, at most `KEPT` sets of values, on all cores."""
        lacking = [values for values in members if values.tobytes() not in self._kept]
        if lacking:
            found = zip((values.tobytes() for values in lacking), self.many(lacking), strict=True)
            self._kept = dict([*self._kept.items(), *found][-KEPT:])

    def many(self, members: Sequence[Array]) -> list[Curves | None]:
        """Return the same for several sets of values, computed on all cores."""
        configured = [self._parameters(values) for values in members]
        legal = [each for each in configured if each is not None]
        columns: list[list[ColumnCurves | None]] = [[] for _ in legal]
        for run in self.runs:
            for place, curves in enumerate(self._rolled(run, legal)):
                columns[place].append(curves)
        whole = iter(columns)
        found: list[Curves | None] = []
        for each in configured:
            rolled = [] if each is None else next(whole)
            kept = tuple(curves for curves in rolled if curves is not None)
            found.append(kept if rolled and len(kept) == len(self.runs) else None)
        return found

    @property
    def step_s(self) -> float:
        """The coupling step."""
        return number_at(self.keyed.tree, "coupling.step_s", self.keyed.name)

    def duration_s(self, run: FitRun) -> float:
        """Return the duration of the simulation that a measured run needs (s)."""
        begin = self._longest_begin_s if run.begin_s is None else run.begin_s
        return max(run.end_s, 0.0) + begin

    def _rolled(self, run: FitRun, configured: Sequence[Parameters]) -> list[ColumnCurves | None]:
        if not configured:
            return []
        duration_s = self.duration_s(run) + 2.0 * self.step_s
        command = run.command or 1.0
        self.rolled_out += len(configured)
        members: Iterable[RollOut]
        if len(configured) == 1 or self._cores == 1:  # without the overhead of threads
            entry = catalogue_entry(self.keyed.name)
            members = [roll_out(entry.build(each), duration_s, self._columns, None, command) for each in configured]
        else:
            members = rollouts(
                self.keyed.name,
                duration_s,
                list(configured),
                columns=self._columns,
                commands=[command] * len(configured),
                cores=self._cores,
            )
        return [None if member.error is not None else ColumnCurves(member) for member in members]

    def _parameters(self, values: Array) -> Parameters | None:
        if not np.isfinite(values).all():
            return None
        try:
            return self.keyed.parameters(values)
        except ConfigurationError:
            return None


@dataclass(frozen=True)
class IdentificationQuestion:
    """Specification of a fit: machine, free keys, and what is known of them.

    Attributes
    ----------
    base : Parameters
        Configuration to start from; keys that are not estimated keep its values.
    keys : tuple of str
        Keys that may change.
    bounds : mapping
        Lower and upper bounds of some keys.
    priors : mapping
        Mean and standard deviation of some keys.
    longest_begin_s : float
        Latest start of a run whose start is unknown, as time since the machine's start.
    seed : int
        Seed of the random further starts.
    cores : int, optional
        Threads; all cores if absent.
    scheduler : str, optional
        Address of a Dask scheduler that distributes starts and profiles.
    """

    machine: str
    base: Parameters
    keys: tuple[str, ...]
    bounds: Mapping[str, tuple[Annotated[float, -np.inf], Annotated[float, np.inf]]] = field(default_factory=dict)
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    longest_begin_s: float = 0.0
    seed: int = 0
    cores: int | None = None
    scheduler: str | None = None

    @property
    def keyed(self) -> KeyedConfiguration:
        """The configuration as a function of the keys."""
        return KeyedConfiguration(self.machine, self.base, self.keys)

    def of(self, keys: Iterable[str]) -> IdentificationQuestion:
        """Return the same question about some of the keys, the others fixed as configured."""
        return replace(self, keys=tuple(keys))


@dataclass(frozen=True)
class Unknown:
    """One unknown number.

    Attributes
    ----------
    kind : str
        ``key``, ``begin`` (start), ``zero`` (SI units, added to column over gain), ``gain`` (its inverse) or ``lag``.
    name : str
        The key, the file of the run, or the column of the channel.
    runs : tuple of int
        Indices of the runs it applies to.
    place : int
        Index of the key among the keys, or of the channel among the channels.
    scale, low, high : float
        Scale of the unknown, and its bounds.
    """

    kind: str
    name: str
    runs: tuple[int, ...]
    place: int
    scale: float
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class Unknowns:
    """All unknowns of a fit, in the order of its vector; a vector holds each divided by its scale."""

    all: tuple[Unknown, ...]
    start: Array

    @property
    def scales(self) -> Array:
        """Scales, shape (unknowns,)."""
        return np.array([each.scale for each in self.all])

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper bounds as vectors."""
        scales = self.scales
        return np.array([u.low for u in self.all]) / scales, np.array([u.high for u in self.all]) / scales

    def keys(self, x: Array) -> Array:
        """Return the values of the keys."""
        chosen = self.places(KEY)
        return x[chosen] * self.scales[chosen]

    def places(self, *kinds: str) -> npt.NDArray[np.intp]:
        """Return the indices of the unknowns of these kinds in the vector."""
        return np.array([i for i, each in enumerate(self.all) if each.kind in kinds], dtype=np.intp)

    def of_channel(self, kind: str, run: int, place: int) -> int | None:
        """Return the index of the unknown of a channel in a run; None if the map gives its value."""
        found = (i for i, u in enumerate(self.all) if u.kind == kind and run in u.runs and u.place == place)
        return next(found, None)

    def value(self, x: Array, kind: str, run: int, place: int, known: float) -> float:
        """Return the value of the unknown of a channel in a run; ``known`` if it is not an unknown."""
        found = self.of_channel(kind, run, place)
        return known if found is None else float(x[found] * self.all[found].scale)


def unknowns_of(
    keyed: KeyedConfiguration, bounds: Array, runs: Sequence[FitRun], longest_begin_s: float = 0.0
) -> Unknowns:
    """Return the unknowns of a fit of these keys to these runs."""
    values, scales = keyed.values(), keyed.scales()
    every = tuple(range(len(runs)))
    found = [
        (Unknown(KEY, key, every, i, float(scales[i]), float(bounds[0, i]), float(bounds[1, i])), float(values[i]))
        for i, key in enumerate(keyed.keys)
    ]
    for i, run in enumerate(runs):
        if run.begin_s is None:
            found.append((Unknown(BEGIN, str(run.path), (i,), 0, TIME_SCALE_S, 0.0, longest_begin_s), 0.0))
    for place in range(len(runs[0].channels)):
        found += _of_channel(runs, place)
    start = np.array([value / unknown.scale for unknown, value in found])
    return Unknowns(tuple(unknown for unknown, _ in found), start)


def _of_channel(runs: Sequence[FitRun], place: int) -> list[tuple[Unknown, float]]:
    fitted = runs[0].channels[place]
    size = float(np.mean([np.std(run.channels[place].values) for run in runs])) or 1.0
    open_words = (
        (ZERO, fitted.channel.zero, size, 0.0, np.inf),
        (GAIN, fitted.channel.gain, 1.0, 1.0, np.inf),
        (LAG, fitted.channel.lag_s, TIME_SCALE_S, 0.0, LONGEST_LAG_S),
    )
    found = []
    for kind, word, scale, start, reach in open_words:
        groups: list[tuple[int, ...]] = []
        if word == FREE:
            groups = [tuple(range(len(runs)))]
        elif word == PER_RUN:
            groups = [(i,) for i in range(len(runs))]
        found += [(Unknown(kind, fitted.name, group, place, scale, -reach, reach), start) for group in groups]
    return found

# SPDX-License-Identifier: Apache-2.0
"""The unknowns of a fit: keys, start times of runs, and sensor parameters that the map leaves free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import FREE, PER_RUN
from mech_twin.studies.identification.fit_runs import FitRun
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration

KEY, BEGIN, ZERO, GAIN, LAG = "key", "begin", "zero", "gain", "lag"
TIME_SCALE_S = 1e-3
LONGEST_LAG_S = 0.5


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

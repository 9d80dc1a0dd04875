# SPDX-License-Identifier: Apache-2.0
"""The unknowns of a fit: keys, beginnings of runs, and what the map leaves open of each channel."""

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
        ``key``, ``begin``, ``zero`` (SI units, added to the column over the gain), ``gain`` (its inverse) or ``lag``.
    name : str
        The key, or the column of the channel.
    runs : tuple of int
        Runs it belongs to.
    place : int
        Of a key among the keys, of a channel among the channels.
    scale, low, high : float
        Size in which steps are measured, and bounds.
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
    """All unknowns of a fit, in the order of its vector; a vector holds each over its scale."""

    all: tuple[Unknown, ...]
    start: Array

    @property
    def scales(self) -> Array:
        """Scales, shape (unknowns,)."""
        return np.array([each.scale for each in self.all])

    def bounds(self) -> tuple[Array, Array]:
        """Return least and largest vector."""
        scales = self.scales
        return np.array([u.low for u in self.all]) / scales, np.array([u.high for u in self.all]) / scales

    def keys(self, x: Array) -> Array:
        """Return the values of the keys."""
        chosen = self.places(KEY)
        return x[chosen] * self.scales[chosen]

    def places(self, *kinds: str) -> npt.NDArray[np.intp]:
        """Return where the unknowns of these kinds stand in the vector."""
        return np.array([i for i, each in enumerate(self.all) if each.kind in kinds], dtype=np.intp)

    def of_channel(self, kind: str, run: int, place: int) -> int | None:
        """Return where the unknown of a channel in a run stands, None where the map knows it."""
        found = (i for i, u in enumerate(self.all) if u.kind == kind and run in u.runs and u.place == place)
        return next(found, None)

    def value(self, x: Array, kind: str, run: int, place: int, known: float) -> float:
        """Return the unknown of a channel in a run, or what is known in its place."""
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

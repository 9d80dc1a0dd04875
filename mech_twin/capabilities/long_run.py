# SPDX-License-Identifier: Apache-2.0
"""Questions on the long run of a periodically driven machine: a cycle to a specification, and regimes over a key."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from mech_twin.declarations.quantity import Parameters

MOST_STARTS = 1_000_000  # of a basin: each is followed to its end at every point of the box of tolerances
MOST_ENDURANCE_PERIODS = 1_000_000_000  # minutes of computing
MOST_SETTLING_PERIODS = 100_000  # every period is kept, and there are up to 16 times as many


@dataclass(frozen=True)
class CycleAnswer:
    """A synthesised cycle: its name, its configuration, all that is known of it, and that in lines for people."""

    name: str
    parameters: Parameters
    record: Mapping[str, Any]
    lines: Mapping[str, Any]


@dataclass(frozen=True)
class SynthesisAnswer:
    """Cycles for one specification side by side; ``chosen`` names the one to use, ``asked`` what was asked."""

    asked: Mapping[str, Any]
    cycles: tuple[CycleAnswer, ...]
    chosen: str

    def cycle(self, name: str) -> CycleAnswer:
        """Return the cycle of this name."""
        return next(cycle for cycle in self.cycles if cycle.name == name)


class SynthesisQuestion(NamedTuple):
    """How a machine's cycle is synthesised.

    Attributes
    ----------
    options : mapping
        Names of the options of robustness, with their usual values.
    answer : callable
        ``answer(parameters, impact_speed_m_per_s, options, periods)``; ``periods`` is the length of the endurance runs.
    lines : callable
        ``lines(record)``: the record of a cycle for people.
    """

    options: Mapping[str, float | int]
    answer: Callable[[Any, float, Mapping[str, float | int], int], SynthesisAnswer]
    lines: Callable[[Mapping[str, Any]], dict[str, Any]]


@dataclass(frozen=True)
class RegimeAnswer:
    """Long-run regimes over the values of a key: a record each, in columns for people, and a picture to write."""

    key: str
    records: tuple[Mapping[str, Any], ...]
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    write_picture: Callable[[Path], None]


class RegimeQuestion(NamedTuple):
    """How the regimes of a machine are mapped.

    ``answer(parameters, values, key, settling_periods, progress)``; ``usual_key`` is the key that is varied if none is
    named; ``read(key, records)`` returns an answer from its records.
    """

    usual_key: str
    answer: Callable[[Any, Sequence[float], str, int, Callable[[int, int], None] | None], RegimeAnswer]
    read: Callable[[str, Sequence[Mapping[str, Any]]], RegimeAnswer]

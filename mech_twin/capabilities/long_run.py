# SPDX-License-Identifier: Apache-2.0
"""Studies of the long-run behaviour of a periodically driven machine: synthesis of a cycle, and regimes over a key."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from mech_twin.declarations.quantity import Parameters

MOST_STARTS = 1_000_000  # of a basin of attraction: each is simulated at every point of the box of tolerances
MOST_ENDURANCE_PERIODS = 1_000_000_000  # takes minutes of computing time
MOST_SETTLING_PERIODS = 100_000  # all periods are stored, up to 16 times this number


@dataclass(frozen=True)
class CycleAnswer:
    """A synthesised cycle: name, configuration, complete record, and a readable summary of it."""

    name: str
    parameters: Parameters
    record: Mapping[str, Any]
    lines: Mapping[str, Any]


@dataclass(frozen=True)
class SynthesisAnswer:
    """Cycles for one specification; ``chosen`` is the name of the recommended one, ``asked`` the specification."""

    asked: Mapping[str, Any]
    cycles: tuple[CycleAnswer, ...]
    chosen: str

    def cycle(self, name: str) -> CycleAnswer:
        """Return the cycle of this name."""
        return next(cycle for cycle in self.cycles if cycle.name == name)


class SynthesisQuestion(NamedTuple):
    """Synthesis of a machine's cycle.

    Attributes
    ----------
    options : mapping
        Options of robustness with their default values.
    answer : callable
        ``answer(parameters, impact_speed_m_per_s, options, periods)``; ``periods`` is the length of the endurance runs.
    lines : callable
        ``lines(record)``: readable summary of the record of a cycle.
    """

    options: Mapping[str, float | int]
    answer: Callable[[Any, float, Mapping[str, float | int], int], SynthesisAnswer]
    lines: Callable[[Mapping[str, Any]], dict[str, Any]]


@dataclass(frozen=True)
class RegimeAnswer:
    """Long-run regimes over the values of a key: records, table columns and rows, and a function that writes a plot."""

    key: str
    records: tuple[Mapping[str, Any], ...]
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    write_picture: Callable[[Path], None]


class RegimeQuestion(NamedTuple):
    """Map of the regimes of a machine.

    ``answer(parameters, values, key, settling_periods, progress)`` computes it; ``usual_key`` is the default key;
    ``read(key, records)`` returns an answer from its records.
    """

    usual_key: str
    answer: Callable[[Any, Sequence[float], str, int, Callable[[int, int], None] | None], RegimeAnswer]
    read: Callable[[str, Sequence[Mapping[str, Any]]], RegimeAnswer]

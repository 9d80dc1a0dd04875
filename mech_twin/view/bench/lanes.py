# SPDX-License-Identifier: Apache-2.0
"""Regimes of a machine's parts over time: one lane for each part, and its changes for each picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from mech_twin.roles import Machine
from mech_twin.samples import BodySample, LinkageSample, MotorSample
from mech_twin.view.annotations import is_stalled

MOST_CHANGES = 400  # per lane and picture; the oldest are dropped
SENSE = "_sense"  # suffix of a memory with the direction of friction
SENSES = ("held", "forwards", "backwards")  # for 0, 1, -1
TOOL = ("stands", "moves", "pushed", "blocked")  # values of the memory `tool_regime`


class Lanes:
    """Lanes of a run."""

    def __init__(self, machine: Machine) -> None:
        self._linkage = machine.linkage.regimes
        self._body = () if machine.body is None else machine.body.regimes
        self._now: dict[str, str] = {}
        self._first: dict[str, str] = {}
        self._begin_s: float | None = None
        self._changes: dict[str, list[list[Any]]] = {}

    def add(self, motor: MotorSample | None, linkage: LinkageSample | None, body: BodySample | None) -> None:
        """Update with a step."""
        for time_s, lane, word in self._words(motor, linkage, body):
            if self._begin_s is None:
                self._begin_s = time_s
            before = self._now.get(lane)
            if word == before:
                continue
            self._now[lane] = word
            changes = self._changes.setdefault(lane, [])
            changes.append([round(time_s, 9), word])
            del changes[:-MOST_CHANGES]

    def taken(self) -> list[list[Any]]:
        """Return and clear for each lane its name, start time (s), regime at that time, and later changes."""
        begin_s = self._begin_s
        if begin_s is None:
            return []
        rows = [
            [lane, round(begin_s, 9), self._first.get(lane, word), self._changes.get(lane, [])]
            for lane, word in self._now.items()
        ]
        self._first, self._changes, self._begin_s = dict(self._now), {}, None
        return rows

    def _words(
        self, motor: MotorSample | None, linkage: LinkageSample | None, body: BodySample | None
    ) -> Iterator[tuple[float, str, str]]:
        if linkage is not None:
            if len(self._linkage) > 1 and not self._body:  # else the regimes are those of the body
                yield linkage.time_s, "machine", _named(self._linkage, linkage.regime)
            yield from self._remembered(linkage)
        if body is not None and self._body:
            yield body.time_s, "body", _named(self._body, body.regime)
        if motor is not None:
            stalled = linkage is not None and is_stalled(linkage)
            yield motor.time_s, "supply", "stalled" if stalled else "on" if motor.command > 0.0 else "off"

    @staticmethod
    def _remembered(linkage: LinkageSample) -> Iterator[tuple[float, str, str]]:
        for name, value in zip(linkage.memory.names, linkage.memory.values, strict=True):
            if name == "tool_regime":
                yield linkage.time_s, "tool", _named(TOOL, int(value))
            elif name.endswith(SENSE):
                part = name.removesuffix(SENSE)
                yield linkage.time_s, f"{part} friction", SENSES[int(value)]


def _named(words: Sequence[str], number: int) -> str:
    return words[number].replace("_", " ") if 0 <= number < len(words) else str(number)

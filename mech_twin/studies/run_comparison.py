# SPDX-License-Identifier: Apache-2.0
"""Comparison of two runs or two configurations: settings, numbers and columns that differ."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.arguments import real_number
from mech_twin.capabilities.plots import house_style, sheet
from mech_twin.declarations.captions import axis_title, unit_of
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.errors import StudyError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import PAGE, machine_parameters
from mech_twin.parameters.written_configuration import leaves

LABEL_LETTERS = 32  # in a line of an axis label
ROUNDING = 1e-9  # of the largest number in a unit: smaller columns are rounding errors
SAME_UNIT = {"J": "N m"}  # the work of a torque in a radian is as large as the torque
RESIDUAL = "worst_"  # prefix of residuals in a summary


class ComparedRun(NamedTuple):
    """One side: label, machine, configuration tree, summary numbers, and samples as columns over time.

    ``broken`` are the names of residuals beyond their limits; residuals are rounding errors and not compared.
    ``units`` are those of columns whose name does not end in the unit, such as the position of a joint.  ``changes``
    counts changes of parameters during a recorded run, whose configuration is that at its start.  ``since`` is that of
    `RunMetrics`.
    """

    label: str
    machine: str
    configuration: Mapping[str, Any]
    summary: Mapping[str, float]
    broken: tuple[str, ...]
    samples: Mapping[str, Sequence[float] | NDArray[np.float64]]
    units: Mapping[str, str] = MappingProxyType({})
    changes: int = 0
    since: str = ""


class Differing(NamedTuple):
    """A setting or number of both sides, None where it is absent; ``relative`` is that of `relative_difference`."""

    name: str
    first: Any
    second: Any
    relative: float


@dataclass(frozen=True)
class Comparison:
    """Settings that differ, all numbers of both sides, and the tolerance; ``machine`` is the name its user gave it."""

    machine: str
    labels: tuple[str, str]
    settings: tuple[Differing, ...]
    numbers: tuple[Differing, ...]
    tolerance: float

    @property
    def beyond(self) -> tuple[Differing, ...]:
        """Numbers that differ by more than the tolerance."""
        return tuple(number for number in self.numbers if not number.relative <= self.tolerance)


def require_one_machine(labels: Sequence[str], machines: Sequence[str], names: Sequence[str]) -> None:
    """Raise a StudyError where the machines of two sides differ; ``names`` are those that their users gave them."""
    if machines[0] != machines[1]:
        raise StudyError(f"A ({labels[0]}) is {names[0]}, B ({labels[1]}) {names[1]}; expected one machine")


def compared(first: ComparedRun, second: ComparedRun, tolerance: float = 0.0) -> Comparison:
    """Return the comparison of two sides.

    Parameters
    ----------
    tolerance : float
        Relative difference, |a - b| / max(|a|, |b|, rounding of the largest number in the unit), up to which two
        numbers count as equal.

    Raises
    ------
    StudyError
        If the machines differ, or the tolerance is not a number from 0 to 1.
    """
    labels = first.label, second.label
    names = [str(side.configuration.get("name", side.machine)) for side in (first, second)]
    require_one_machine(labels, (first.machine, second.machine), names)
    tolerance = real_number("tolerance", tolerance, "0 to 1, a part of the larger of two numbers", 0.0, 1.0)
    summaries = first.summary, second.summary
    settings = _paired(dict(leaves(first.configuration)), dict(leaves(second.configuration)))
    return Comparison(
        " and ".join(dict.fromkeys(names)),
        labels,
        tuple(setting for setting in settings if setting.first != setting.second),
        _paired(*({name: x for name, x in each.items() if not name.startswith(RESIDUAL)} for each in summaries)),
        tolerance,
    )


def changed_settings(name: str, tree: Mapping[str, Any]) -> list[list[str]]:
    """Return key, installed value and value of each setting that differs from the installed configuration."""
    if name not in CATALOGUE or name == PAGE.name:
        return []
    installed = dict(leaves(configuration_tree(machine_parameters(name))))
    return [
        [key, str(installed.get(key, "-")), str(value)] for key, value in leaves(tree) if installed.get(key) != value
    ]


def _paired(first: Mapping[str, Any], second: Mapping[str, Any]) -> tuple[Differing, ...]:
    least = rounding_errors(first, second)
    pairs = ((name, first.get(name), second.get(name)) for name in dict.fromkeys((*first, *second)))
    return tuple(Differing(*each, relative_difference(*each[1:], least[each[0]])) for each in pairs)


def _size_of(name: str) -> str:
    """Return the unit with whose numbers a number is compared in size."""
    unit = unit_of(name)
    return SAME_UNIT.get(unit, unit)


def rounding_errors(*sides: Mapping[str, Any]) -> dict[str, float]:
    """Return the rounding error of each number: that of the largest number in its unit; 0 for one without a unit."""
    largest: dict[str, float] = {}
    names = dict.fromkeys(name for side in sides for name in side)
    for name, value in (item for side in sides for item in side.items()):
        if isinstance(value, int | float) and math.isfinite(value):
            largest[_size_of(name)] = max(largest.get(_size_of(name), 0.0), abs(value))
    return {name: ROUNDING * largest.get(_size_of(name), 0.0) if _size_of(name) else 0.0 for name in names}


def relative_difference(first: Any, second: Any, least: float = 0.0) -> float:
    """Return |a - b| / max(|a|, |b|, least) of two numbers; 0 for equal values, infinite if one is not a number."""
    if first == second:
        return 0.0
    if not all(isinstance(value, int | float) for value in (first, second)):
        return math.inf
    if math.isnan(first) and math.isnan(second):
        return 0.0
    apart = abs(first - second) / max(abs(first), abs(second), least)
    return math.inf if math.isnan(apart) else float(apart)


def columns_apart(first: ComparedRun, second: ComparedRun, most: int) -> list[str]:
    """Return the columns that differ most: largest difference at a common time over the largest magnitude.

    A column that is rounding error compared with others of its unit is left out.
    """
    found: list[tuple[float, float, str]] = []
    largest: dict[str, float] = {}
    time, other_time = (np.asarray(side.samples["time_s"]) for side in (first, second))
    for name in first.samples:
        if name == "time_s" or name not in second.samples:
            continue
        here, there = (np.asarray(side.samples[name], dtype=np.float64) for side in (first, second))
        shared = time[(time >= other_time[0]) & (time <= other_time[-1])]
        if not len(shared):
            continue
        distance = np.abs(np.interp(shared, time, here) - np.interp(shared, other_time, there)).max()
        size = max(np.abs(here).max(), np.abs(there).max())
        unit = _unit(name, first)
        largest[unit] = max(largest.get(unit, 0.0), float(size))
        if distance > 0.0:
            found.append((float(distance / size), float(size), name))
    real = [each for each in found if each[1] > ROUNDING * largest[_unit(each[2], first)]]
    return [name for _, _, name in sorted(real, key=lambda item: -item[0])[:most]]


def drawn_side_by_side(first: ComparedRun, second: ComparedRun, names: Sequence[str]) -> Any:
    """Return a figure of columns of both sides over time, one panel for each column."""
    with house_style():
        figure, all_axes = sheet(len(names), 1, height=1.0 + 1.7 * len(names), sharex=True)
        for axes, name in zip(all_axes, names, strict=True):
            for side, line in ((first, "-"), (second, "--")):
                axes.plot(side.samples["time_s"], side.samples[name], line, label=side.label)
            label = f"{name.partition('.')[0]} {axis_title(name, _unit(name, first, second))}"
            axes.set_ylabel(fill(label, LABEL_LETTERS), fontsize=7.5)
        all_axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        all_axes[-1].set_xlabel("time [s]")
    return figure


def at_equal_angle(
    first: ComparedRun, second: ComparedRun, column: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return times of the second side, and of the first side at the same angle; None if either turns less than once.

    Parameters
    ----------
    column : str
        Column of the angle that drives the cycle (rad), continuous or wrapped.
    """
    times, turned = zip(*(_turned(side, column) for side in (first, second)), strict=True)
    if any(not len(angle) or angle[-1] - angle[0] < 2.0 * np.pi for angle in turned):
        return None
    shared = (turned[1] >= turned[0][0]) & (turned[1] <= turned[0][-1])
    return times[1][shared], np.interp(turned[1][shared], turned[0], times[0])


def _turned(side: ComparedRun, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and angle of a side where the angle exceeds all earlier ones, so that each angle has one time."""
    if column not in side.samples:
        return np.empty(0), np.empty(0)
    time_s = np.asarray(side.samples["time_s"], dtype=np.float64)
    angle = np.unwrap(np.asarray(side.samples[column], dtype=np.float64))
    if len(angle) and angle[-1] < angle[0]:
        angle = -angle
    further = np.ones(len(angle), dtype=bool)
    further[1:] = angle[1:] > np.maximum.accumulate(angle)[:-1]
    return time_s[further], angle[further] - angle[0]


def _unit(name: str, *sides: ComparedRun) -> str:
    """Return the unit of a column on both sides; for user-defined linkages they may differ."""
    return " / ".join(dict.fromkeys(unit for side in sides if (unit := side.units.get(name) or unit_of(name))))

# SPDX-License-Identifier: Apache-2.0
"""Studies that a machine declares: sizing, one turn as columns, published numbers and figures.

Sizing gives a configuration, the constraints it satisfies and which of them is active.  Every published number of the
machines' sources is compared with the computed one, and their figures are reproduced.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mech_twin.capabilities.arguments import GREATEST_SEED, by_name, real_number, sequence_items, whole_number
from mech_twin.capabilities.long_run import (
    MOST_ENDURANCE_PERIODS,
    MOST_SETTLING_PERIODS,
    MOST_STARTS,
    RegimeAnswer,
    RegimeQuestion,
    SynthesisAnswer,
    SynthesisQuestion,
)
from mech_twin.capabilities.plots import Picture, house_style, written
from mech_twin.capabilities.published import CONTRADICTS, PublishedRow
from mech_twin.capabilities.sizing import Sizing, SizingQuestion
from mech_twin.declarations.captions import unknown_name
from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import StudyError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import catalogue_entry, machine_parameters, table
from mech_twin.roles import Machine
from mech_twin.studies.sweep_table import require_key

FilePath = str | PathLike[str]
MOST_TOLERANCE = 0.5  # a wider box of tolerances does not describe one machine


@contextmanager
def refusing() -> Iterator[None]:
    """Turn what a configuration refuses of the values that a study tries into an error of one line."""
    try:
        yield
    except ValidationError as error:
        raise refusal("this study", error) from error


def asked_of(machine: str, capability: str, lack: str) -> Any:
    """Return a capability of a machine.

    Parameters
    ----------
    capability : str
        Field of `mech_twin.roles.Capabilities`.
    lack : str
        Error text for a machine without it.

    Raises
    ------
    StudyError
        If the machine lacks the capability; the message names those that have it.
    """
    entry = catalogue_entry(machine)
    found = getattr(entry.capabilities, capability)
    if found is None:
        others = [name for name, other in CATALOGUE.items() if getattr(other.capabilities, capability) is not None]
        raise StudyError(f"{machine}: {lack}; there is an answer for {', '.join(others)}")
    return found


def searches_by_runs(machine: str) -> bool:
    """Return whether a machine has no design question of its own, so that it is searched by simulated runs."""
    return catalogue_entry(machine).capabilities.design is None


def questions_of(machine: str) -> tuple[str, ...]:
    """Return the questions of ``study`` that this machine answers; any machine can be swept, and searched by runs."""
    able = catalogue_entry(machine).capabilities
    answered = {
        "sweep": True,
        "size": able.sizing,
        "search": True,
        "designs": able.design,
        "synthesise": able.synthesis,
        "regimes": able.regimes,
    }
    return tuple(name for name, capability in answered.items() if capability)


def cycle_positions(count: int) -> list[float]:
    """Return ``count`` crank angles (rad), evenly spaced over one turn from 0, without its end."""
    return [2.0 * math.pi * i / count for i in range(count)]


def analysed_columns(machine: Machine, crank_rad: Iterable[float]) -> dict[str, list[Any]]:
    """Return all results of the analysis at these crank angles (rad), one list for each name."""
    rows = [{"crank_rad": angle, **machine.analyse(angle)} for angle in crank_rad]
    return {key: [row[key] for row in rows] for key in rows[0]}


def machine_pictures(machine: str, parameters: Parameters | None = None) -> tuple[Picture, ...]:
    """Return the figures of one machine for these parameters or the installed configuration."""
    entry = catalogue_entry(machine)
    pictures = entry.capabilities.pictures
    if pictures is None:
        raise StudyError(f"{machine}: no published figures to draw")
    with house_style():
        return tuple(pictures(parameters or machine_parameters(entry.name)))


@refusing()
def draw_figures(machine: str, directory: FilePath, parameters: Parameters | None = None) -> list[Path]:
    """Draw a machine's published figures; return the files, an SVG and a PNG each.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    directory : path
        Output directory; created if missing.
    parameters : Parameters, optional
        Configuration of the machine; the installed one if absent.
    """
    Path(directory).mkdir(parents=True, exist_ok=True)
    pictures = machine_pictures(machine, parameters)
    return [file for picture in pictures for file in written(picture, Path(directory))]


def machine_rows(machine: str, parameters: Parameters | None = None) -> tuple[PublishedRow, ...]:
    """Return the rows of one machine, in its own order: the problematic ones first."""
    entry = catalogue_entry(machine)
    rows = entry.capabilities.published
    if rows is None:
        raise StudyError(f"{machine}: no published values to compare with")
    return tuple(rows(parameters or machine_parameters(entry.name)))


def machines_with_published_values() -> tuple[str, ...]:
    """Return the machines of the catalogue that have published values."""
    return tuple(name for name, entry in CATALOGUE.items() if entry.capabilities.published is not None)


@refusing()
def reproduce(machine: str | None = None, parameters: Parameters | None = None) -> tuple[PublishedRow, ...]:
    """Return every published number with the computed one.

    Parameters
    ----------
    machine : str, optional
        Machine of the catalogue; all of them if absent, rows of sources that contradict themselves first.
    parameters : Parameters, optional
        Configuration of that one machine; the installed one if absent.
    """
    if machine is not None:
        return machine_rows(machine, parameters)
    rows = [row for name in machines_with_published_values() for row in machine_rows(name)]
    return tuple(sorted(rows, key=lambda row: row.verdict != CONTRADICTS))


def all_hold(rows: Iterable[PublishedRow]) -> bool:
    """Return whether every row with a tolerance is within it."""
    return all(row.holds for row in rows)


def size(
    machine: str,
    parameters: Parameters | None = None,
    *,
    limits: Mapping[str, float] | None = None,
    objective: str | None = None,
    tolerance: float | None = None,
) -> Sizing:
    """Return the sizes of a machine's parts, the resulting configuration, and the active constraint.

    Breaker: spring and preload.  Press: flywheel.  Vibration crank: counterweight and balancing fraction.  Roller
    former: motor, stiffness and damping.

    Parameters
    ----------
    machine : str
        Machine of the catalogue.
    parameters : Parameters, optional
        The rest of the configuration; the installed one if absent.
    limits : mapping, optional
        Limits that differ from the usual ones, by name, which an unknown one lists.
    objective : str, optional
        Objective to minimise; the first of the machine's ``OBJECTIVES`` if absent.
    tolerance : float, optional
        Relative tolerance of the assumed values for which the limits must hold in the worst case; the machine's usual
        one if absent, 0 for the machine exactly as configured.
    """
    question: SizingQuestion = asked_of(machine, "sizing", "nothing to size")
    given = {}
    for limit, value in by_name("limits", limits, f"limits by name: {', '.join(question.limits)}").items():
        if limit not in question.limits:
            raise StudyError(unknown_name(limit, question.limits, "limit "))
        given[limit] = real_number(f"limit {limit}", value, "a finite number")
    wanted = objective or question.objectives[0]
    if wanted not in question.objectives:
        raise StudyError(unknown_name(wanted, question.objectives, "objective "))
    allowed = allowed_tolerance(machine, question, tolerance)
    asked = parameters or machine_parameters(machine)
    try:
        found = question.answer(asked, {**question.limits, **given}, wanted, table, allowed)
    except ValidationError as error:
        off = f", numbers off by up to {100.0 * allowed:g} %" if allowed > 0.0 else ""
        raise refusal(f"this study{off}", error) from error
    broken = [constraint.text for constraint in found.constraints if constraint.name in given and not constraint.holds]
    if broken:
        raise StudyError(f"{machine}: no sizes keep {'; '.join(broken)}")
    return found


def allowed_tolerance(machine: str, question: SizingQuestion, tolerance: float | None) -> float:
    """Return the tolerance for sizing; raise a StudyError for one that the machine does not support."""
    if tolerance is None:
        return question.usual_tolerance or 0.0
    expected = f"0 to {MOST_TOLERANCE:g}, a part of each assumed value"
    allowed = real_number("tolerance", tolerance, expected, 0.0, MOST_TOLERANCE)
    if allowed > 0.0 and question.usual_tolerance is None:
        raise StudyError(f"{machine}: no sizes with a tolerance, only of the machine as configured; leave it out or 0")
    return allowed


@refusing()
def synthesise(
    machine: str,
    impact_speed_m_per_s: float,
    *,
    parameters: Parameters | None = None,
    options: Mapping[str, float | int] | None = None,
    periods: int = 1_000_000,
) -> SynthesisAnswer:
    """Return the published cycle of a machine and a robust one for the same impact speed, side by side.

    Parameters
    ----------
    machine : str
        Machine of the catalogue whose cycle can be synthesised.
    impact_speed_m_per_s : float
        Required impact speed.
    parameters : Parameters, optional
        Configuration for all values that the synthesis does not choose; the installed one if absent.
    options : mapping, optional
        Requirements for the robust cycle that differ from the usual ones.
    periods : int
        Length of the endurance runs, in periods.

    Raises
    ------
    StudyError
        If the number of periods or of starts is out of range, or there is no such cycle.
    """
    question: SynthesisQuestion = asked_of(machine, "synthesis", "no cycle to synthesise")
    periods = whole_number("periods", periods, 1, MOST_ENDURANCE_PERIODS)
    speed = real_number("impact_speed_m_per_s", impact_speed_m_per_s, "a finite number above 0, m/s")
    known = ", ".join(question.options)
    wanted = by_name("options", options, f"numbers by name: {known}")
    for name, value in wanted.items():
        if name not in question.options:
            raise StudyError(f"no option '{name}'; expected one of {known}")
        wanted[name] = real_number(f"option {name}", value, "a finite number")
    for name, least, most in (("starts", 1, MOST_STARTS), ("inside", 0, MOST_STARTS), ("seed", 0, GREATEST_SEED)):
        if name in wanted:
            wanted[name] = whole_number(name, wanted[name], least, most)
    return question.answer(parameters or machine_parameters(machine), speed, wanted, periods)


@refusing()
def regimes(
    machine: str,
    values: Sequence[float],
    key: str | None = None,
    *,
    parameters: Parameters | None = None,
    settling_periods: int = 1000,
    progress: Callable[[int, int], None] | None = None,
) -> RegimeAnswer:
    """Return the steady-state regimes of a machine over the values of one configuration key.

    Parameters
    ----------
    machine : str
        Machine of the catalogue whose regimes can be mapped.
    values : sequence of float
        Values of the key.
    key : str, optional
        Configuration key; the machine's usual one if absent.
    parameters : Parameters, optional
        The rest of the configuration; the installed one if absent.
    settling_periods : int
        Periods simulated before a regime is determined.
    progress : callable, optional
        ``progress(done, all)``.

    Raises
    ------
    StudyError
        If the number of periods is out of range.
    """
    question: RegimeQuestion = asked_of(machine, "regimes", "no regimes to map")
    settling_periods = whole_number("settling", settling_periods, 1, MOST_SETTLING_PERIODS)
    values = sequence_items("values", values, "a list of numbers")
    if not values:
        raise StudyError("values: expected at least one")
    known = parameters or machine_parameters(machine)
    if key is not None:
        require_key(type(known), key)
    key = key or question.usual_key
    values = [real_number(f"value of {key}", value, "a finite number") for value in values]
    return question.answer(known, values, key, settling_periods, progress)

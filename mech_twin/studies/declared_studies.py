# SPDX-License-Identifier: Apache-2.0
"""Studies that a machine declares: sizing, one turn as columns, published numbers and figures.

Sizing gives a configuration, the constraints it satisfies and which of them is active.  Every published number of the
machines' sources is compared with the computed one, and their figures are reproduced.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from mech_twin.capabilities.arguments import by_name, real_number
from mech_twin.capabilities.published import CONTRADICTS, PublishedRow
from mech_twin.capabilities.sizing import Sizing, SizingQuestion
from mech_twin.declarations.captions import unknown_name
from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import StudyError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import catalogue_entry, machine_parameters, table
from mech_twin.roles import Machine

if TYPE_CHECKING:
    from mech_twin.capabilities.plots import Picture

MOST_TOLERANCE = 0.5  # a wider box of tolerances does not describe one machine


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
        raise StudyError(f"{entry.name}: {lack}; there is an answer for {', '.join(others)}")
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
    from mech_twin.capabilities.plots import house_style  # matplotlib is an extra

    entry = catalogue_entry(machine)
    pictures = entry.capabilities.pictures
    if pictures is None:
        raise StudyError(f"{entry.name}: no published figures to draw")
    with house_style():
        return tuple(pictures(parameters or machine_parameters(entry.name)))


def machine_figures(machine: str, directory: Path, parameters: Parameters | None = None) -> list[Path]:
    """Write the figures of one machine; return the files, an SVG and a PNG each."""
    from mech_twin.capabilities.plots import written

    directory.mkdir(parents=True, exist_ok=True)
    return [file for picture in machine_pictures(machine, parameters) for file in written(picture, directory)]


def machine_rows(machine: str, parameters: Parameters | None = None) -> tuple[PublishedRow, ...]:
    """Return the rows of one machine, in its own order: the problematic ones first."""
    entry = catalogue_entry(machine)
    rows = entry.capabilities.published
    if rows is None:
        raise StudyError(f"{entry.name}: no published values to compare with")
    return tuple(rows(parameters or machine_parameters(entry.name)))


def machines_with_published_values() -> tuple[str, ...]:
    """Return the machines of the catalogue that have published values."""
    return tuple(name for name, entry in CATALOGUE.items() if entry.capabilities.published is not None)


def all_rows() -> tuple[PublishedRow, ...]:
    """Return the rows of every machine, those of sources that contradict themselves first."""
    rows = [row for machine in machines_with_published_values() for row in machine_rows(machine)]
    return tuple(sorted(rows, key=lambda row: row.verdict != CONTRADICTS))


def all_hold(rows: Iterable[PublishedRow]) -> bool:
    """Return whether every row with a tolerance is within it."""
    return all(row.holds for row in rows)


def sized(
    machine: str,
    parameters: Parameters | None = None,
    limits: Mapping[str, float] | None = None,
    objective: str | None = None,
    tolerance: float | None = None,
) -> Sizing:
    """Return the sizes of a machine's parts; see `mech_twin.studies.size`."""
    question: SizingQuestion = asked_of(machine, "sizing", "nothing to size")
    given = by_name("limits", limits, f"limits by name: {', '.join(question.limits)}")
    for limit, value in given.items():
        if limit not in question.limits:
            raise StudyError(unknown_name(limit, question.limits, "limit "))
        real_number(f"limit {limit}", value, "a finite number")
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
    real_number("tolerance", tolerance, f"0 to {MOST_TOLERANCE:g}, a part of each assumed value", 0.0, MOST_TOLERANCE)
    if tolerance > 0.0 and question.usual_tolerance is None:
        raise StudyError(f"{machine}: no sizes with a tolerance, only of the machine as configured; leave it out or 0")
    return tolerance

"""Sizes of a machine's parts: each gives a configuration, the constraints it meets and which of them binds."""

from __future__ import annotations

from collections.abc import Mapping

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.sizing import Sizing, SizingQuestion
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import catalogue_entry, machine_parameters, table
from mech_twin.quantity import Parameters

MOST_TOLERANCE = 0.5  # beyond it a box of tolerances is no longer one machine


def sized(
    machine: str,
    parameters: Parameters | None = None,
    limits: Mapping[str, float] | None = None,
    objective: str | None = None,
    tolerance: float | None = None,
) -> Sizing:
    """Return the sizes of a machine's parts; see `mech_twin.studies.size`."""
    entry = catalogue_entry(machine)
    question = entry.capabilities.sizing
    if question is None:
        others = ", ".join(name for name, other in CATALOGUE.items() if other.capabilities.sizing is not None)
        raise StudyError(f"{entry.name}: nothing to size; there is an answer for {others}")
    given = dict(limits or {})
    for limit in given:
        if limit not in question.limits:
            raise StudyError(f"no limit '{limit}'; expected one of {', '.join(question.limits)}")
    wanted = objective or question.objectives[0]
    if wanted not in question.objectives:
        raise StudyError(f"no objective '{wanted}'; expected one of {', '.join(question.objectives)}")
    allowed = allowed_tolerance(entry.name, question, tolerance)
    return question.answer(
        parameters or machine_parameters(entry.name), {**question.limits, **given}, wanted, table, allowed
    )


def allowed_tolerance(machine: str, question: SizingQuestion, tolerance: float | None) -> float:
    """Return the tolerance to size with; refuse one that the machine has no answer for."""
    if tolerance is None:
        return question.usual_tolerance or 0.0
    if not 0.0 <= tolerance <= MOST_TOLERANCE:
        raise StudyError(f"tolerance {tolerance:g}: expected 0 to {MOST_TOLERANCE:g}, a part of each assumed value")
    if tolerance > 0.0 and question.usual_tolerance is None:
        raise StudyError(f"{machine}: no sizes with a tolerance, only of the machine as configured; leave it out or 0")
    return tolerance

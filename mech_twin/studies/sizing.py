# SPDX-License-Identifier: Apache-2.0
"""Sizing of a machine's parts: a configuration, the constraints it satisfies and which of them is active."""

from __future__ import annotations

from collections.abc import Mapping

from mech_twin.capabilities.arguments import by_name, real_number
from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.sizing import Sizing, SizingQuestion
from mech_twin.declarations.captions import unknown_name
from mech_twin.declarations.quantity import Parameters
from mech_twin.parameters.load import machine_parameters, table
from mech_twin.studies.asking import asked_of

MOST_TOLERANCE = 0.5  # a wider box of tolerances does not describe one machine


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
    return question.answer(
        parameters or machine_parameters(machine), {**question.limits, **given}, wanted, table, allowed
    )


def allowed_tolerance(machine: str, question: SizingQuestion, tolerance: float | None) -> float:
    """Return the tolerance for sizing; raise a StudyError for one that the machine does not support."""
    if tolerance is None:
        return question.usual_tolerance or 0.0
    real_number("tolerance", tolerance, f"0 to {MOST_TOLERANCE:g}, a part of each assumed value", 0.0, MOST_TOLERANCE)
    if tolerance > 0.0 and question.usual_tolerance is None:
        raise StudyError(f"{machine}: no sizes with a tolerance, only of the machine as configured; leave it out or 0")
    return tolerance

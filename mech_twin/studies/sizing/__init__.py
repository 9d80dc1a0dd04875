"""Sizes of a machine's parts: each gives a configuration, the constraints it meets and which of them binds."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from mech_twin.parameters.load import catalogue_entry, description_text, machine_parameters
from mech_twin.quantity import Parameters
from mech_twin.studies.errors import StudyError
from mech_twin.studies.sizing.answer import Sizing

MACHINES = ("mb10_breaker", "compaction_press", "vibration_crank", "roller_former")


def sized(
    machine: str,
    parameters: Parameters | None = None,
    limits: Mapping[str, float] | None = None,
    objective: str | None = None,
) -> Sizing:
    """Return the sizes of a machine's parts; see `mech_twin.studies.size`."""
    name = catalogue_entry(machine).name
    if name not in MACHINES:
        raise StudyError(f"{name}: nothing to size; there is an answer for {', '.join(MACHINES)}")
    room = import_module(f"mech_twin.studies.sizing.{name}")
    known: dict[str, float] = room.LIMITS
    given = dict(limits or {})
    for limit in given:
        if limit not in known:
            raise StudyError(f"no limit '{limit}'; expected one of {', '.join(known)}")
    objectives: tuple[str, ...] = room.OBJECTIVES
    wanted = objective or objectives[0]
    if wanted not in objectives:
        raise StudyError(f"no objective '{wanted}'; expected one of {', '.join(objectives)}")
    answer: Sizing = room.sizing(parameters or machine_parameters(name), {**known, **given}, wanted)
    return answer


def write_configuration(answer: Sizing, path: Path) -> None:
    """Write the parameter file of the sized machine, which ``run`` and ``simulate`` take."""
    path.write_text(description_text(answer.machine, answer.parameters), encoding="utf-8")

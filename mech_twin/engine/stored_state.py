# SPDX-License-Identifier: Apache-2.0
"""The state of a machine as text, to be stored and restored at another step of this or another run.

All state is in the samples of linkage and body.  Instants of the run in them (names that begin with ``origin_``)
are shifted with the step.
"""

import json
import math
from collections.abc import Mapping
from typing import Any, NamedTuple, TypeVar

from mech_twin.engine.coupling import GIVEN_STATE, RESET, next_frame
from mech_twin.engine.sample_vectors import BODILY
from mech_twin.errors import StateError
from mech_twin.roles import Machine
from mech_twin.samples import BodySample, Event, Frame, LinkageSample, Named

ORIGIN_STEP, ORIGIN_TIME = "origin_step_1", "origin_s"
SAMPLE = ("regime", *BODILY, "memory")
LAST_STEP = 2**53  # the last whole number that a float tells from the next
Moving = TypeVar("Moving", LinkageSample, BodySample)


class StoredState(NamedTuple):
    """Linkage and body at one step."""

    linkage: LinkageSample
    body: BodySample | None


def check_storable(machine: Machine) -> None:
    """Raise for a machine whose state cannot be moved to another step.

    Raises
    ------
    StateError
        If one of its drives is a function of the time of the run.
    """
    timed = getattr(machine.linkage, "timed_drives", ())
    if timed:
        raise StateError(f"{machine.name}: drive {timed[0]} follows the time of the run, so no state is offered")


def begins_with_state(sample: LinkageSample) -> bool:
    """Return whether a stored state was restored at this sample."""
    return any(event.kind == RESET and event.contact == GIVEN_STATE for event in sample.events)


def state_text(machine: Machine, state: StoredState) -> str:
    """Return a state as JSON; its numbers are read back exactly.

    Raises
    ------
    StateError
        If a drive is a function of time, or the step that ends here had an event.
    """
    check_storable(machine)
    samples = [sample for sample in state if sample is not None]
    if any(sample.events for sample in samples):
        raise StateError(f"step {state.linkage.step} ends with an event, which a state does not hold: take one more")
    document: dict[str, Any] = {"machine": machine.name, "step": state.linkage.step, "command": state.linkage.command}
    for name, sample in zip(("linkage", "body"), samples, strict=False):
        document[name] = {
            "regime": sample.regime,
            **{key: dict(zip(sample.joints, getattr(sample, key), strict=True)) for key in BODILY},
            "memory": sample.memory.as_dict(),
        }
    if state.body is not None:
        document["body"]["pressing_force_n"] = state.body.pressing_force_n
    return json.dumps(document)


def stored_state(machine: Machine, text: str, like: StoredState, step: int) -> StoredState:
    """Return the state restored from a text at a step, with a reset event.

    Parameters
    ----------
    machine : Machine
        The machine, with the configuration in force.
    text : str
        What `state_text` returned.
    like : StoredState
        Samples of this machine, whose names of joints and memory the state must have.
    step : int
        Step at which it is restored.

    Raises
    ------
    StateError
        If it is no state of this machine.
    """
    check_storable(machine)
    document = _object(_parsed(text), "state")
    if document.get("machine") != machine.name:
        raise StateError(f"state: machine {document.get('machine')!r}: expected {machine.name!r}")
    _only(document, "state", ("machine", "step", "command", "linkage") + (() if machine.body is None else ("body",)))
    stored = document.get("step")
    if type(stored) is not int or not 0 <= stored <= LAST_STEP:
        raise StateError(f"state: step {stored!r:.40}: expected a whole number, 0 to {LAST_STEP}")
    step_s = machine.coupling_step_s
    linkage = _moved(_sample(document, "linkage", like.linkage, machine.linkage.regimes), stored, step, step_s)
    command = _number(document.get("command"), "command")
    linkage = linkage._replace(command=command, events=(Event(step * step_s, RESET, GIVEN_STATE),))
    if like.body is None or machine.body is None:
        return _going_on(machine, StoredState(linkage, None))
    body = _moved(_sample(document, "body", like.body, machine.body.regimes), stored, step, step_s)
    force = _number(document["body"].get("pressing_force_n"), "body.pressing_force_n")
    return _going_on(machine, StoredState(linkage, body._replace(pressing_force_n=force, events=())))


def _going_on(machine: Machine, state: StoredState) -> StoredState:
    """Return a state from which the machine can take a step."""
    try:
        motor = machine.motor.respond(state.linkage, state.linkage.command)
        frame = Frame(state.linkage, motor, machine.forces.analyse(state.linkage), state.body)
        after = next_frame(machine, frame, state.linkage.command)
    except (ArithmeticError, ValueError) as error:
        raise StateError(f"state: {machine.name} cannot go on from it: {error}") from error
    moved = (after.linkage,) if after.body is None else (after.linkage, after.body)
    for sample in moved:
        for joint, *values in zip(sample.joints, sample.position, sample.velocity, strict=True):
            if not all(map(math.isfinite, values)):
                raise StateError(f"state: {machine.name} cannot go on from it: {joint} has {values} a step later")
    return state


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StateError(f"state: {str(error)[:100]}: expected the text that get_state returned") from error


def _sample(document: Mapping[str, Any], name: str, like: Moving, regimes: tuple[str, ...]) -> Moving:
    part = _object(document.get(name), name)
    _only(part, name, SAMPLE if name == "linkage" else (*SAMPLE, "pressing_force_n"))
    regime = part.get("regime")
    if type(regime) is not int or not 0 <= regime < max(1, len(regimes)):
        raise StateError(f"state: {name}.regime {regime!r}: expected 0 to {max(0, len(regimes) - 1)}")
    return like._replace(
        regime=regime,
        position=_numbers(part, name, "position", like.joints),
        velocity=_numbers(part, name, "velocity", like.joints),
        effort=_numbers(part, name, "effort", like.joints),
        memory=Named(like.memory.names, _numbers(part, name, "memory", like.memory.names)),
    )


def _only(found: Mapping[str, Any], where: str, known: tuple[str, ...]) -> None:
    for key in found:
        if key not in known:
            raise StateError(f"state: {where} has '{key:.40}': expected {', '.join(known)}")


def _numbers(part: Mapping[str, Any], of: str, key: str, names: tuple[str, ...]) -> tuple[float, ...]:
    found = _object(part.get(key), f"{of}.{key}")
    if set(found) != set(names):
        other = sorted(set(found) ^ set(names))[0]
        raise StateError(f"state: {of}.{key}.{other}: expected {', '.join(names) or 'nothing'}")
    return tuple(_number(found[name], f"{of}.{key}.{name}") for name in names)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise StateError(f"state: {where} {value!r}: expected a finite number")
    return float(value)


def _object(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise StateError(f"state: {where}: expected the text that get_state returned")
    return value


def _moved(sample: Moving, stored: int, step: int, step_s: float) -> Moving:
    """Return a stored sample moved to another step."""
    by = {ORIGIN_STEP: float(step - stored), ORIGIN_TIME: (step - stored) * step_s}
    pairs = zip(sample.memory.names, sample.memory.values, strict=True)
    memory = Named(sample.memory.names, tuple(value + by.get(name, 0.0) for name, value in pairs))
    return sample._replace(step=step, time_s=step * step_s, memory=memory)

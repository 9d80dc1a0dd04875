# SPDX-License-Identifier: Apache-2.0
"""The coupling scheme: the order in which the roles are computed at a step, in one process and over topics alike.

At step n::

    linkage(n) -> motor(n)
    linkage(n) -> forces(n) -> body(n)          body(n) from body(n-1)
    linkage(n), motor(n), body(n) -> linkage(n+1)

The linkage leads each step and locates its own events; the body follows under the loads of that step.  The nodes
call the same three functions, step index by step index, so a run over topics is bit for bit this one.

Whether a machine starts when it is switched on is forecast by the same functions.  What is asked of the motor, a
fraction of rated supply or an effort, becomes one value a step here (`command_profile`).
"""

from collections.abc import Callable, Sequence
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.arguments import is_number, real_number, sequence_items
from mech_twin.declarations.quantity import Parameters, quantity
from mech_twin.errors import StudyError
from mech_twin.roles import BodyRole, EffortMotor, Machine
from mech_twin.samples import BodySample, EffortCommand, Event, ForceSample, Frame, LinkageSample, MotorSample

Target = float | EffortCommand  # asked fraction of rated supply frequency, or an effort in its place
Profile = Target | Callable[[int], Target] | Sequence[tuple[float, Target]] | NDArray[np.float64]
Targets = NDArray[np.float64] | list[Target]  # one a step; an array where no effort is among them
ON_STEP = 1e-9  # of a step: a time this little after a step counts as on it
A_PROFILE = "a number, pairs of time (s) and value, an array with one number a step, or a function of the step"
RESET = "reset"
GIVEN_STATE = "state"  # contact of a reset to a stored state; that of one to the initial state is the linkage
LARGEST = 1e12  # position, stiffness or damping of an effort command: their products stay finite
SHORTEST_STEP_S, LONGEST_STEP_S = 1e-6, 1.0
LOOK_AHEAD_S = 3.0
STANDING_S = 1.0
STANDING_REACH = 1e-3  # rad or m of the drive within the standing time


def coupling_step(longest_s: float = LONGEST_STEP_S) -> Any:
    """Return the field of a coupling step (s), for a machine whose longest step is ``longest_s``."""
    return quantity("s", "coupling step: the roles exchange samples once per step", ge=SHORTEST_STEP_S, le=longest_s)


class Coupling(Parameters):
    """How the roles exchange samples; a machine with a shorter longest step narrows ``step_s`` alone."""

    step_s: float = coupling_step()


def restarted(machine: Machine, step: int) -> LinkageSample:
    """Return the linkage reset to its initial state at a later step; simulation time continues."""
    sample = machine.linkage.start(step)
    return sample._replace(events=(Event(sample.time_s, RESET, "linkage"), *sample.events))


def is_reset(sample: LinkageSample) -> bool:
    """Return whether the run returns at this sample to its initial state, or to a stored one."""
    return any(event.kind == RESET for event in sample.events)


def next_body(role: BodyRole, body: BodySample | None, forces: ForceSample) -> BodySample:
    """Return the body at the step of these forces; at the first step and after a reset it is in its initial state."""
    if body is None or any(load.kind == RESET for load in forces.loads):
        return role.start(forces)
    return role.follow(body, forces)


def effort_limit(machine: Machine) -> float:
    """Return the greatest effort that the motor can be asked for (N m or N).

    Raises
    ------
    StudyError
        The machine's motor takes no effort.
    """
    limit = _limit(machine)
    if limit == 0.0:
        raise StudyError(
            f"{machine.name}: takes no effort command: expected one motor that gives an effort; a drive at a given "
            "speed takes what effort that needs, a program or table follows its own times"
        )
    return limit


def check_effort(machine: Machine, asked: EffortCommand) -> None:
    """Refuse an effort command out of range.

    Raises
    ------
    StudyError
        The machine's motor takes no effort, or a number is not finite, beyond its limit, or of the wrong sign.
    """
    limit, numbers = effort_limit(machine), ", ".join(f"{name} {x:g}" for name, x in asked._asdict().items())
    small = all(abs(number) <= LARGEST for number in asked[1:])
    if not (abs(asked.effort) <= limit and small and asked.stiffness >= 0.0 and asked.damping >= 0.0):
        raise StudyError(
            f"{numbers}: expected an effort within {limit:g}, a position within {LARGEST:g}, stiffness and damping 0 "
            f"to {LARGEST:g}"
        )


def _limit(machine: Machine) -> float:
    return machine.motor.effort_limit if isinstance(machine.motor, EffortMotor) else 0.0


def driven(machine: Machine, linkage: LinkageSample, target: Target) -> MotorSample:
    """Return the motor at the linkage's step: as its supply gives, or at the commanded effort, clipped to its limit.

    Commands are checked with `check_effort` on arrival; if a live parameter has set the limit to 0, the effort is 0.
    """
    if not isinstance(target, EffortCommand):
        return machine.motor.respond(linkage, target)
    limit, off = _limit(machine), machine.motor.respond(linkage, 0.0)
    asked = target.effort + target.stiffness * (target.position - off.position[0]) - target.damping * off.velocity[0]
    effort = min(max(asked, -limit), limit)
    return off._replace(effort=(effort,) * len(off.joints), command=0.0, asked=target)


def complete_frame(machine: Machine, linkage: LinkageSample, body: BodySample | None, target: Target) -> Frame:
    """Return the frame that belongs to this linkage sample; ``body`` is the one of the step before."""
    motor = driven(machine, linkage, target)
    forces = machine.forces.analyse(linkage)
    followed = None if machine.body is None else next_body(machine.body, body, forces)
    return Frame(linkage, motor, forces, followed)


def next_frame(machine: Machine, frame: Frame, target: Target) -> Frame:
    """Return the frame one coupling step later."""
    linkage = machine.linkage.advance(frame.linkage, frame.motor, frame.body)
    return complete_frame(machine, linkage, frame.body, target)


class StartForecast(NamedTuple):
    """Whether the drive turns at the end of the look-ahead, and its position then (rad or m)."""

    turns: bool
    position: float


def start_forecast(machine: Machine, linkage: LinkageSample, target: float) -> StartForecast:
    """Return whether a machine switched on at a sample starts.

    A drive that stays within `STANDING_REACH` for the last `STANDING_S` of `LOOK_AHEAD_S` does not turn.  One that
    rests at times in normal operation (`Machine.rests_when_supplied`) always counts as turning.

    Parameters
    ----------
    machine : Machine
        The machine; its body starts at rest on its stop.
    linkage : LinkageSample
        State of the linkage at switching on.
    target : float
        Required fraction of rated supply frequency.
    """
    frame = complete_frame(machine, linkage, None, target)
    steps = round(LOOK_AHEAD_S / machine.coupling_step_s)
    judged_from = steps - round(STANDING_S / machine.coupling_step_s)
    lowest = highest = frame.motor.position[0]
    for step in range(1, steps + 1):
        frame = next_frame(machine, frame, target)
        position = frame.motor.position[0]
        if step <= judged_from:
            lowest = highest = position
        lowest, highest = min(lowest, position), max(highest, position)
    return StartForecast(machine.rests_when_supplied or highest - lowest > STANDING_REACH, position)


def command_profile(command: Profile, first: int, count: int, step_s: float) -> Targets:
    """Return the asked fraction of rated supply frequency, or effort, at ``first`` and the ``count`` steps after it.

    Raises
    ------
    StudyError
        If an array has another length, or a number is not a fraction from 0 to 1.
    """
    if isinstance(command, np.ndarray):
        if command.shape != (count + 1,):
            raise StudyError(f"command has shape {command.shape}; expected one number a step, ({count + 1},)")
        if command.dtype.kind not in "fiub":
            raise StudyError(f"command has numbers of kind {command.dtype}; expected one number a step")
        return _shares(np.ascontiguousarray(command, dtype=np.float64))
    if isinstance(command, int | float | np.integer | np.floating):
        return _shares(np.full(count + 1, float(command)))
    if isinstance(command, EffortCommand):
        profile: list[Target] = [command] * (count + 1)
    elif callable(command):
        profile = [_target(command(step)) for step in range(first, first + count + 1)]
    else:
        pairs = _pairs(command)
        times = [time_s for time_s, _ in pairs]
        if times != sorted(times):
            raise StudyError(f"command has times {times}; expected them in ascending order")
        profile = [1.0] * (count + 1)
        for time_s, value in pairs:
            begin = min(max(step_at(time_s, step_s) - first, 0), count + 1)
            profile[begin:] = [value] * (count + 1 - begin)
    numbers = _shares(np.array([t for t in profile if not isinstance(t, EffortCommand)], dtype=np.float64))
    return numbers if len(numbers) == len(profile) else [plain(target) for target in profile]


def plain(target: Target) -> Target:
    """Return a target with a number of Python, not of NumPy."""
    return target if isinstance(target, EffortCommand) else float(target)


def step_at(time_s: float, step_s: float) -> int:
    """Return the first step at or after a time."""
    return ceil(time_s / step_s - ON_STEP)


def _shares(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the numbers of a command, all fractions of rated supply frequency but for rounding."""
    beyond = numbers[~((numbers >= -ON_STEP) & (numbers <= 1.0 + ON_STEP))]
    if len(beyond):
        raise StudyError(f"command {float(beyond[0])}: expected 0 to 1, a fraction of rated supply frequency")
    return numbers


def _target(value: Any) -> Target:
    if isinstance(value, EffortCommand) or is_number(value):
        return value
    raise StudyError(f"command's value {value!r:.80}: expected a number, or an effort command")


def _pairs(command: Sequence[tuple[float, Target]]) -> list[tuple[float, Target]]:
    """Return pairs of time and value."""
    found = []
    for pair in sequence_items("command", command, A_PROFILE):
        if len(both := sequence_items("command", pair, A_PROFILE)) != 2:
            raise StudyError(f"command {command!r}: expected {A_PROFILE}")
        found.append((real_number("command's time", both[0], "seconds"), _target(both[1])))
    return found

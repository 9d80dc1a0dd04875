# SPDX-License-Identifier: Apache-2.0
"""The one-process run: frames one after the other, no ROS, no wall clock."""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from mech_twin.engine.compiled_machine import compiled_machine
from mech_twin.engine.coupling import Target, check_effort, complete_frame, next_frame
from mech_twin.roles import Machine
from mech_twin.samples import EffortCommand, Frame

TIMES_AS_MANY = math.sqrt(5.0)  # refinement for comparison runs: less than half the step, samples do not coincide
FEW_FRAMES, MANY_FRAMES = 32, 512  # computed at a time: few at first, as the caller may stop early


def steps_for(machine: Machine, duration_s: float) -> int:
    """Return how many coupling steps make up a duration (rounded to the nearest)."""
    return round(duration_s / machine.coupling_step_s)


def shorter_step_s(machine: Machine, duration_s: float) -> float:
    """Return a coupling step (s) shorter by about sqrt(5), of which the run has a whole number."""
    steps = steps_for(machine, duration_s)
    return machine.coupling_step_s * (steps / round(steps * TIMES_AS_MANY) if steps else 1.0 / TIMES_AS_MANY)


def rated(step: int) -> float:
    """Return the constant command 1: rated supply frequency."""
    return 1.0


def frames(
    machine: Machine,
    duration_s: float,
    target: Callable[[int], Target] = rated,
    machine_at: Callable[[int], Machine] | None = None,
) -> Iterator[Frame]:
    """Yield the frames of a run from step 0 to the last within ``duration_s``.

    Parameters
    ----------
    machine : Machine
        What to run.
    duration_s : float
        Simulated time.
    target : callable
        ``target(step)``: required fraction of rated supply frequency at a step, or an effort in its place.
    machine_at : callable, optional
        ``machine_at(step)``: the machine with the parameters in force at a step, where they change during the run.
    """
    frame = complete_frame(machine, machine.linkage.start(), None, target(0))
    yield frame
    last, count = steps_for(machine, duration_s), FEW_FRAMES
    while frame.linkage.step < last:
        first = frame.linkage.step + 1
        steps = range(first, min(first + count, last + 1))
        if machine_at is not None:
            machine = machine_at(first)
            steps = range(first, next((step for step in steps if machine_at(step) is not machine), steps.stop))
        for following in _frames_after(machine, frame, [target(step) for step in steps]):
            frame = following
            yield frame
        count = MANY_FRAMES


def continued(machine: Machine, frame: Frame, duration_s: float, target: Target) -> Iterator[Frame]:
    """Yield the frames that follow a given one at a constant target."""
    yield from _frames_after(machine, frame, [target] * steps_for(machine, duration_s))


def _frames_after(machine: Machine, frame: Frame, targets: Sequence[Target]) -> Iterator[Frame]:
    """Yield the frames that follow a given one; compiled roles compute all of them in one call."""
    compiled = compiled_machine(machine)
    if compiled is not None and not any(isinstance(target, EffortCommand) for target in targets):
        yield from compiled.frames_after(frame, np.array(targets, dtype=np.float64))
        return
    for target in targets:
        if isinstance(target, EffortCommand):
            check_effort(machine, target)
        frame = next_frame(machine, frame, target)
        yield frame


def warm_up(machine: Machine) -> None:
    """Compile (or load) every kernel of a step, so that the first step is not delayed."""
    frame = complete_frame(machine, machine.linkage.start(), None, 1.0)
    next_frame(machine, frame, 1.0)


def warm_up_run(machine: Machine) -> None:
    """Compile (or load) every kernel that `frames` needs."""
    for _ in frames(machine, machine.coupling_step_s):
        pass

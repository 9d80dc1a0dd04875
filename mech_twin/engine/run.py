"""The one-process run: frames one after the other, no ROS, no wall clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.roles import Machine
from mech_twin.samples import Frame


def steps_for(machine: Machine, duration_s: float) -> int:
    """Return how many coupling steps make up a duration (rounded to the nearest)."""
    return round(duration_s / machine.coupling_step_s)


def rated(step: int) -> float:
    """Return the command that never changes: rated supply frequency."""
    return 1.0


def frames(
    machine: Machine,
    duration_s: float,
    target: Callable[[int], float] = rated,
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
        ``target(step)``: asked fraction of rated supply frequency at a step.
    machine_at : callable, optional
        ``machine_at(step)``: the machine with the parameters in force at a step, where they change during the run.
    """
    frame = complete_frame(machine, machine.linkage.start(), None, target(0))
    yield frame
    for step in range(1, steps_for(machine, duration_s) + 1):
        frame = next_frame(machine if machine_at is None else machine_at(step), frame, target(step))
        yield frame


def warm_up(machine: Machine) -> None:
    """Compile (or load) every kernel a step needs, so that the first step is not late."""
    frame = complete_frame(machine, machine.linkage.start(), None, 1.0)
    next_frame(machine, frame, 1.0)

# SPDX-License-Identifier: Apache-2.0
"""Recomputes a recorded run, or its forces from its motion, and compares the results.

The roles are pure maps between samples, so the recorded configuration, commands and resets determine every sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from mech_twin.engine.coupling import RESET, driven, next_body, restarted
from mech_twin.engine.step_samples import StepSamples
from mech_twin.engine.stored_state import begins_with_state
from mech_twin.roles import Machine
from mech_twin.samples import Frame, LinkageSample
from mech_twin.studies.first_difference import Difference, Sample, first_difference

MachineAt = Callable[[int], Machine]


@dataclass
class Verdict:
    """Result of a comparison.

    Attributes
    ----------
    steps, samples : int
        Numbers of steps and samples compared.
    missing_steps : int
        Steps that are incomplete in the recording and were not compared.
    taken_up : list of int
        Steps whose recorded state was the initial state: the first if it is not 0, and the first after a gap.
    resets : int
        Number of resets that were repeated.
    first : Difference, optional
        First difference of recorded and computed samples.
    """

    steps: int = 0
    samples: int = 0
    missing_steps: int = 0
    taken_up: list[int] = field(default_factory=list)
    resets: int = 0
    first: Difference | None = None

    @property
    def identical(self) -> bool:
        """Whether something was compared and no difference was found, in any bit or beyond the tolerance."""
        return self.samples > 0 and self.first is None


def analysed(steps: Iterable[StepSamples], machine_at: MachineAt, tolerance: float = 0.0) -> Verdict:
    """Return whether the recorded forces follow from the recorded motion; stops at the first difference.

    Parameters
    ----------
    steps : iterable of StepSamples
        The recording.
    machine_at : callable
        ``machine_at(step)``: the machine with the parameters in force at a step.
    tolerance : float
        See `first_difference`; 0 compares every bit.
    """
    verdict = Verdict()
    for known in steps:
        if known.linkage is None or known.forces is None:
            verdict.missing_steps += 1
            continue
        verdict.steps += 1
        verdict.samples += 1
        forces = machine_at(known.step).forces.analyse(known.linkage)
        verdict.first = first_difference("forces", known.forces, forces, tolerance)
        if verdict.first is not None:
            break
    return verdict


def resimulated(steps: Iterable[StepSamples], machine_at: MachineAt) -> Verdict:
    """Return whether recomputing the run gives the recorded samples; stops at the first difference.

    Each step is computed from the previously computed one.  The recording provides the command (the motor's, after rate
    limiting, or the requested effort), the resets with their states, and the parameters.
    See `analysed` for the arguments.
    """
    verdict = Verdict()
    before: Frame | None = None
    last_step = -1
    for known in steps:
        machine = machine_at(known.step)
        verdict.missing_steps += known.step - last_step - 1 if last_step >= 0 else 0
        given = known.linkage is not None and begins_with_state(known.linkage)
        if given or (before is not None and known.step != before.linkage.step + 1):
            before = None
        last_step = known.step
        frame = _next(machine, before, known, verdict)
        if frame is None:
            verdict.missing_steps += 1
            before = None
            continue
        verdict.steps += 1
        for role, recorded, computed in _pairs(known, frame):
            verdict.samples += 1
            verdict.first = first_difference(role, recorded, computed)
            if verdict.first is not None:
                return verdict
        before = frame
    return verdict


def _next(machine: Machine, before: Frame | None, known: StepSamples, verdict: Verdict) -> Frame | None:
    """Return the frame computed for a step; None if the recording lacks a required sample."""
    if known.motor is None:
        return None
    target = known.motor.command if known.motor.asked is None else known.motor.asked
    linkage = _linkage(machine, before, known, verdict)
    if linkage is None:
        return None
    motor = driven(machine, linkage, target)
    forces = machine.forces.analyse(linkage)
    body = None
    if machine.body is not None:
        if before is None and known.step > 0:
            body = known.body
            if body is None:
                return None
        else:
            body = next_body(machine.body, None if before is None else before.body, forces)
    if before is None and known.step > 0:
        verdict.taken_up.append(known.step)
    return Frame(linkage, motor, forces, body)


def _linkage(machine: Machine, before: Frame | None, known: StepSamples, verdict: Verdict) -> LinkageSample | None:
    if before is None:
        return machine.linkage.start() if known.step == 0 else known.linkage
    if known.linkage is not None and any(event.kind == RESET for event in known.linkage.events):
        verdict.resets += 1
        return restarted(machine, known.step)
    return machine.linkage.advance(before.linkage, before.motor, before.body)


def _pairs(known: StepSamples, frame: Frame) -> Iterator[tuple[str, Sample, Sample]]:
    """Yield recorded and computed samples; a state that was taken from the recording is left out."""
    for role in ("linkage", "motor", "forces", "body"):
        recorded, computed = getattr(known, role), getattr(frame, role)
        if recorded is not None and computed is not None and recorded is not computed:
            yield role, recorded, computed

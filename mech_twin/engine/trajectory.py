# SPDX-License-Identifier: Apache-2.0
"""A run as columns (one array for each number of a frame), samples of one step, and the worst residuals.

Samples arrive one by one, from a recording or topics, and are assembled to steps: frames in which some may be missing.
A residual has its largest magnitude over a window, and a limit, as shown by diagnostics and ``simulate``.
"""

import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from mech_twin.roles import RESIDUALS, Invariant, Machine
from mech_twin.samples import BodySample, Event, ForceSample, Frame, LinkageSample, MotorSample, Named, Sample

NO_LIMIT = math.nan  # nothing is within it: a residual whose limit nobody declared counts as broken
ROUND_STEPS = (5.0, 2.0, 1.0)
UNKNOWN = Invariant("", "")


class Residual(NamedTuple):
    """Largest magnitude of a residual, and its limit, both in the residual's unit."""

    worst: float
    limit: float

    @property
    def broken(self) -> bool:
        """Whether the limit is exceeded; NaN, in the value or in the limit, is."""
        return not self.worst <= self.limit


class ResidualWindow:
    """Greatest magnitude of each residual since the window began.

    Parameters
    ----------
    limits : mapping of str to float
        Limit of each residual by name.
    """

    def __init__(self, limits: Mapping[str, float]) -> None:
        self.limits = dict(limits)
        self._worst: dict[str, float] = {}

    def observe(self, residuals: Named) -> None:
        """Update with the residuals of one sample; once a residual was NaN, its worst is NaN."""
        for name, value in zip(residuals.names, residuals.values, strict=True):
            size = abs(value)
            if size > self._worst.get(name, -1.0) or math.isnan(size):
                self._worst[name] = size

    def residuals(self) -> dict[str, Residual]:
        """Return the worst of each residual observed, with its limit."""
        return {name: Residual(worst, self.limits.get(name, NO_LIMIT)) for name, worst in self._worst.items()}

    def close(self) -> dict[str, Residual]:
        """Return the largest magnitude of each residual, and start a new window."""
        closed = self.residuals()
        self._worst.clear()
        return closed


class RunInvariants:
    """The worst residuals of a whole run, of all roles of a machine.

    Residuals are known by their names; where two roles give a residual the same name, by ``role.name``.
    """

    def __init__(self, machine: Machine) -> None:
        self._windows = {role: ResidualWindow(limits) for role, limits in role_limits(machine).items()}

    def observe(self, frame: Frame) -> None:
        """Update with one frame."""
        self._windows["linkage"].observe(frame.linkage.residuals)
        self._windows["forces"].observe(frame.forces.residuals)
        if frame.body is not None:
            self._windows["body"].observe(frame.body.residuals)

    def residuals(self) -> dict[str, Residual]:
        """Return the worst of each residual so far, with its limit."""
        return by_plain_name(
            (role, name, found) for role, window in self._windows.items() for name, found in window.residuals().items()
        )


def role_limits(machine: Machine) -> dict[str, Mapping[str, float]]:
    """Return the limits of the residuals of each role that has samples with residuals."""
    limits = {"linkage": machine.linkage.residual_limits, "forces": machine.forces.residual_limits}
    if machine.body is not None:
        limits["body"] = machine.body.residual_limits
    return limits


def residuals_of_run(machine: Machine, worst: Iterable[tuple[str, float]]) -> dict[str, Residual]:
    """Return residuals, known by columns ``role.residual.name`` and their worst magnitudes, with their limits."""
    limits = role_limits(machine)
    split = [(column.split(".residual.", 1), size) for column, size in worst]
    return by_plain_name((role, name, Residual(size, limits[role].get(name, NO_LIMIT))) for (role, name), size in split)


def by_plain_name(found: Iterable[tuple[str, str, Residual]]) -> dict[str, Residual]:
    """Return residuals by name; where two roles give one the same name, by ``role.name``."""
    residuals = list(found)
    names = [name for _, name, _ in residuals]
    return {name if names.count(name) == 1 else f"{role}.{name}": residual for role, name, residual in residuals}


def broken_lines(residuals: Mapping[str, Residual], step_s: float | None = None) -> list[str]:
    """Return one line per residual that exceeds its limit.

    Where a shorter coupling step lowers the residual the line names the key and a step to try; ``step_s`` is the
    present one (s).
    """
    return [
        f"{name} {r.worst:.3g} exceeds {r.limit:.3g}{_remedy(name, r, step_s)}"
        for name, r in residuals.items()
        if r.broken
    ]


def step_within_limit_s(residual: Residual, step_s: float, least_limit: float = math.inf) -> float | None:
    """Return a coupling step (s), rounded down, that brings a residual of second order within its limit.

    A limit that shrinks with the step as fast as the residual would never be met, so its lower bound ``least_limit``
    is used.  None where the residual is not finite.
    """
    limit = min(residual.limit, least_limit)
    over = residual.worst / limit if limit > 0.0 else math.inf
    if not over < math.inf:
        return None
    wanted = step_s / math.sqrt(max(over, 1.0))
    decade = 10.0 ** math.floor(math.log10(wanted))
    fitting = (digit * decade for digit in ROUND_STEPS if digit * decade < min(wanted * (1.0 + 1e-9), step_s))
    return float(f"{next(fitting, 0.5 * decade):.1g}")


def _remedy(name: str, residual: Residual, step_s: float | None) -> str:
    invariant = RESIDUALS.get(name.rpartition(".")[2], UNKNOWN)
    if step_s is None or not invariant.of_the_step:
        return ""
    shorter = step_within_limit_s(residual, step_s, invariant.least_limit)
    return "" if shorter is None else f": coupling.step_s {step_s:g} is too long for this machine, try {shorter:g}"


def frame_numbers(frame: Frame) -> Iterator[tuple[str, float]]:
    """Yield every number of a frame under the name of its column."""
    yield "time_s", frame.linkage.time_s
    for role, sample in (("linkage", frame.linkage), ("motor", frame.motor), ("body", frame.body)):
        if sample is not None:
            yield from joint_numbers(role, sample)
    yield "linkage.regime", float(frame.linkage.regime)
    yield "motor.command", frame.motor.command
    yield from force_numbers(frame.forces)
    if frame.body is not None:
        yield "forces.body_moment_nm", frame.forces.body_moment_nm
        yield "body.pressing_force_n", frame.body.pressing_force_n
        yield "body.regime", float(frame.body.regime)


def joint_numbers(role: str, sample: LinkageSample | MotorSample | BodySample) -> Iterator[tuple[str, float]]:
    """Yield position, velocity and effort of each joint of a role under the names of their columns."""
    for i, joint in enumerate(sample.joints):
        yield f"{role}.{joint}.position", sample.position[i]
        yield f"{role}.{joint}.velocity", sample.velocity[i]
        yield f"{role}.{joint}.effort", sample.effort[i]


def force_numbers(forces: ForceSample) -> Iterator[tuple[str, float]]:
    """Yield every pin reaction and derived quantity under the names of their columns."""
    for pin, wrench in zip(forces.pins, forces.wrenches, strict=True):
        for name, value in zip(wrench._fields, wrench, strict=True):
            yield f"forces.{pin}.{name}", value
    for name, value in forces.quantities.as_dict().items():
        yield f"forces.{name}", value


def frame_events(frame: Frame) -> tuple[Event, ...]:
    """Return the events of the step that ends with this frame, in time order."""
    return step_events(frame.linkage, frame.body)


def step_events(linkage: LinkageSample | None, body: BodySample | None) -> tuple[Event, ...]:
    """Return the events of a step in time order, those of a missing sample left out."""
    own = () if linkage is None else linkage.events
    others = () if body is None else body.events
    return tuple(sorted((*own, *others), key=lambda event: event.time_s)) if own or others else ()


class Trajectory:
    """Columns of samples, growing frame by frame."""

    def __init__(self) -> None:
        self._names: list[str] = []
        self._columns: list[array[float]] = []

    def append(self, frame: Frame) -> None:
        """Add one frame."""
        row = dict(frame_numbers(frame))
        if not self._names:
            self._names = list(row)
            self._columns = [array("d") for _ in row]
        for column, value in zip(self._columns, row.values(), strict=True):
            column.append(value)

    def columns(self) -> dict[str, list[float]]:
        """Return every column by name."""
        return {name: column.tolist() for name, column in zip(self._names, self._columns, strict=True)}


class StepSamples(NamedTuple):
    """The samples of one step, None where there is none."""

    step: int
    linkage: LinkageSample | None = None
    motor: MotorSample | None = None
    forces: ForceSample | None = None
    body: BodySample | None = None

    @property
    def events(self) -> tuple[Event, ...]:
        """The events of the step, in time order."""
        return step_events(self.linkage, self.body)

    def frame(self, has_body: bool) -> Frame | None:
        """Return the whole frame, or None if a sample of it is missing."""
        if self.linkage is None or self.motor is None or self.forces is None or (has_body and self.body is None):
            return None
        return Frame(self.linkage, self.motor, self.forces, self.body)


OPEN_STEPS = 64
FIELDS: dict[type, str] = {
    LinkageSample: "linkage",
    MotorSample: "motor",
    ForceSample: "forces",
    BodySample: "body",
}


class StepAssembler:
    """Joins samples to steps and gives the steps back in ascending order, each once.

    A step is given back as soon as it has every expected sample.  Each source sends its samples in order, so the
    steps still open below a complete one have lost a sample and are given back, incomplete, before it.  At most
    `OPEN_STEPS` steps wait at a time; then the lowest is given back as it is.

    Parameters
    ----------
    fields : frozenset of str
        The fields of `StepSamples` that make a step complete.
    unused : Counter, optional
        Counts the samples not used, by reason: ``repeated`` (equal to the first of its step), ``contradicting``
        (differs from it; the first one counts), ``late`` (its step has been given back already).

    Attributes
    ----------
    incomplete : int
        Steps given back with a sample missing.
    contradicted_from : int or None
        The lowest step with two different samples of one role: a second publisher must have sent one of them.
    """

    def __init__(self, fields: frozenset[str], unused: Counter[str] | None = None) -> None:
        self.unused: Counter[str] = Counter() if unused is None else unused
        self.incomplete = 0
        self.contradicted_from: int | None = None
        self._fields = fields
        self._open: dict[int, dict[str, Any]] = {}
        self._newest: StepSamples | None = None
        self._given: dict[int, StepSamples] = {}  # the newest ones

    def add(self, sample: Sample) -> list[StepSamples]:
        """Return the steps that this sample completes or forces out, lowest first."""
        field = FIELDS[type(sample)]
        if self._newest is not None and sample.step <= self._newest.step:
            given = self._given.get(sample.step)
            self._count_unused(sample, None if given is None else getattr(given, field))
            return []
        known = self._open.get(sample.step)
        if known is None:
            known = self._open[sample.step] = {}
        if field in known:
            self._count_unused(sample, known[field])
            return []
        known[field] = sample
        if len(known) == len(self._fields) and known.keys() == self._fields:
            if len(self._open) == 1:
                return [self._given_back(sample.step)]
            return [self._given_back(step) for step in sorted(self._open) if step <= sample.step]
        return [self._given_back(min(self._open))] if len(self._open) > OPEN_STEPS else []

    def rest(self) -> list[StepSamples]:
        """Return the steps still open, lowest first."""
        return [self._given_back(step) for step in sorted(self._open)]

    def _count_unused(self, sample: Sample, first: Sample | None) -> None:
        self.unused["late" if first is None else "repeated" if first == sample else "contradicting"] += 1
        if first is not None and first != sample:
            known = self.contradicted_from
            self.contradicted_from = sample.step if known is None else min(known, sample.step)

    def _given_back(self, step: int) -> StepSamples:
        known = self._open.pop(step)
        self.incomplete += known.keys() != self._fields
        self._newest = self._given[step] = StepSamples(step, **known)
        if len(self._given) > OPEN_STEPS:
            del self._given[next(iter(self._given))]
        return self._newest


class FrameAssembler:
    """Joins samples to whole frames; steps with a sample missing are counted and left out.

    Parameters
    ----------
    has_body : bool
        Whether a frame needs a body sample to be whole.
    """

    def __init__(self, has_body: bool) -> None:
        self._has_body = has_body
        self._steps = StepAssembler(frozenset(FIELDS.values()) - (set() if has_body else {"body"}))

    @property
    def incomplete(self) -> int:
        """How many steps were left out."""
        return self._steps.incomplete

    def add(self, sample: Sample) -> Frame | None:
        """Return the frame that this sample completes, if it does."""
        frames = [step.frame(self._has_body) for step in self._steps.add(sample)]
        return frames[-1] if frames else None

# SPDX-License-Identifier: Apache-2.0
"""Recomputes a recorded run, or its forces from its motion, and compares the results.

The roles are pure maps between samples, so the recorded configuration, commands and resets determine every sample.

Samples are compared to the bit, or within a tolerance; the first field that differs is named.

The parameters in force at each step are those of the recorded changes.
"""

import struct
from array import array
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from mech_twin.declarations.captions import unit_of
from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.coupling import driven, is_reset, next_body, restarted
from mech_twin.engine.stored_state import begins_with_state
from mech_twin.engine.trajectory import StepSamples
from mech_twin.parameters.description import Description, description
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import Machine, own_name
from mech_twin.samples import BodySample, ForceSample, Frame, LinkageSample, MotorSample, Named
from mech_twin.studies.run_comparison import changed_settings

Sample = LinkageSample | MotorSample | ForceSample | BodySample
RESIDUALS = "residuals."
Value = float | str | None
MachineAt = Callable[[int], Machine]


class ConfigurationHistory:
    """Configurations of a run, each valid from its step on.

    Parameters
    ----------
    texts : iterable of str
        Descriptions in the recording; a revision that is described again (after a node restart) counts once.

    Raises
    ------
    ConfigurationError
        If there is none, one is invalid, or they describe different machines.
    """

    def __init__(self, texts: Iterable[str], source: str) -> None:
        found: dict[int, Description] = {}
        for text in texts:
            described = description(text, source)
            found.setdefault(described.revision, described)
        if not found:
            raise ConfigurationError(f"{source}: holds no configuration; expected a description of the machine")
        names = {described.machine for described in found.values()}
        if len(names) > 1:
            raise ConfigurationError(f"{source}: describes more than one machine: {', '.join(sorted(names))}")
        self._described = sorted(found.values(), key=lambda item: (item.from_step, item.revision))
        self._from = [described.from_step for described in self._described]
        self._built: tuple[int, Machine] | None = None

    @property
    def name(self) -> str:
        """Name of the machine."""
        return self._described[0].machine

    @property
    def versions(self) -> tuple[str, ...]:
        """Versions of this package that made the recording."""
        return tuple(dict.fromkeys(described.version for described in self._described))

    @property
    def own_roles(self) -> tuple[tuple[str, str], ...]:
        """The roles whose place a class of the user's own took, and that class."""
        return self._described[0].own_roles

    @property
    def parameters(self) -> Parameters:
        """Parameters at the start of the run."""
        return self._described[0].parameters

    @property
    def last(self) -> Parameters:
        """Parameters at the end of the run."""
        return self._described[-1].parameters

    @property
    def changes(self) -> int:
        """Number of changes of parameters during the run."""
        return len(self._described) - 1

    def machine_at(self, step: int) -> Machine:
        """Return the machine with the parameters in force at a step."""
        place = max(0, bisect_right(self._from, step) - 1)
        if self._built is None or self._built[0] != place:
            self._built = place, catalogue_entry(self.name).build(self._described[place].parameters)
        return self._built[1]


def recorded_settings(texts: Iterable[str]) -> tuple[str, list[list[str]]]:
    """Return the name of a recorded machine, of a page its own, and its settings that are not as installed.

    One that was changed during the run has both its values, at the start and at the end.  Both results are empty if
    the recording has no valid configuration.
    """
    try:
        history = ConfigurationHistory(texts, "the recording")
    except ConfigurationError:
        return "", []
    begin, end = (
        {key: (installed, here) for key, installed, here in changed_settings(history.name, configuration_tree(each))}
        for each in (history.parameters, history.last)
    )
    settings = []
    for key, (installed, _) in (begin | end).items():
        first, last = (rows.get(key, (installed, installed))[1] for rows in (begin, end))
        settings.append([key, installed, first if first == last else f"{first}, at the end {last}"])
    return own_name(history.name, history.parameters), settings


def recorded_step_s(texts: Iterable[str]) -> float | None:
    """Return the coupling step (s) of a recording, for messages without step number; None without configuration."""
    try:
        parameters = ConfigurationHistory(texts, "the recording").parameters
    except ConfigurationError:
        return None
    step_s: float = configuration_tree(parameters)["coupling"]["step_s"]
    return step_s


class Difference(NamedTuple):
    """First difference of two samples of one step: ``role`` is linkage, motor, forces or body; None: absent entry."""

    step: int
    time_s: float
    role: str
    field: str
    recorded: Value
    computed: Value


def first_difference(role: str, recorded: Sample, computed: Sample, tolerance: float = 0.0) -> Difference | None:
    """Return the first field in which two samples of one step differ, or None.

    Parameters
    ----------
    recorded, computed
        The samples; names of joints, pins, memory and residuals are compared too.
    tolerance : float
        0 compares every bit.  Else a number may differ by this share of the largest recorded number of the sample in
        the same unit, and residuals, which are rounding errors, are ignored.
    """
    if _content(recorded) == _content(computed):
        return None
    computed_by_name, recorded_by_name = dict(fields(computed)), dict(fields(recorded))
    sizes = _sizes(recorded_by_name)
    for name in {**recorded_by_name, **computed_by_name}:
        there, here = recorded_by_name.get(name), computed_by_name.get(name)
        missing = name not in recorded_by_name or name not in computed_by_name
        near = tolerance > 0.0 and _near(name, there, here, tolerance * sizes.get(unit_of(name), 0.0))
        if missing or not (near or _bits(there) == _bits(here)):
            return Difference(recorded.step, recorded.time_s, role, name, there, here)
    if tolerance > 0.0:
        return None
    return Difference(recorded.step, recorded.time_s, role, "order of the entries", None, None)


def _sizes(numbers: dict[str, Value]) -> dict[str, float]:
    """Return the largest magnitude in each unit."""
    sizes: dict[str, float] = {}
    for name, value in numbers.items():
        if isinstance(value, float) and not name.startswith(RESIDUALS):
            sizes[unit_of(name)] = max(sizes.get(unit_of(name), 0.0), abs(value))
    return sizes


def _near(name: str, there: Value, here: Value, allowed: float) -> bool:
    if not isinstance(there, float) or not isinstance(here, float):
        return False
    return name.startswith(RESIDUALS) or abs(there - here) <= allowed


def fields(sample: object, path: str = "") -> Iterator[tuple[str, Value]]:
    """Yield every number and string of a sample under its name, such as ``velocity[crank]`` or ``memory.energy_j``."""
    if isinstance(sample, Named):
        yield from ((f"{path}.{name}", value) for name, value in zip(sample.names, sample.values, strict=True))
    elif hasattr(sample, "_fields"):
        yield from _record_fields(sample, path)
    elif isinstance(sample, tuple):
        for i, item in enumerate(sample):
            yield from fields(item, f"{path}[{i}]")
    elif isinstance(sample, str):
        yield path, sample
    elif sample is not None:
        yield path, float(sample)  # type: ignore[arg-type]


def _record_fields(sample: object, path: str) -> Iterator[tuple[str, Value]]:
    labels = tuple(getattr(sample, "joints", ()) or getattr(sample, "pins", ()))
    named = {"position", "velocity", "effort", "wrenches"} if labels else set()
    for name in sample._fields:  # type: ignore[attr-defined]
        value = getattr(sample, name)
        here = f"{path}.{name}" if path else name
        if name in named:
            for label, item in zip(labels, value, strict=True):
                yield from fields(item, f"{here}[{label}]")
        else:
            yield from fields(value, here)


def _content(sample: Sample) -> tuple[bytes, list[str]]:
    """Return the bits of all numbers and all strings of a sample, without their names."""
    flat: list[float | str] = []
    _flatten(sample, flat)
    numbers = array("d", [item for item in flat if not isinstance(item, str)])
    return numbers.tobytes(), [item for item in flat if isinstance(item, str)]


def _flatten(item: object, flat: list[float | str]) -> None:
    if isinstance(item, tuple):
        for part in item:
            _flatten(part, flat)
    elif item is not None:
        flat.append(item)  # type: ignore[arg-type]


def _bits(value: Value) -> bytes | str | None:
    return struct.pack("<d", value) if isinstance(value, float) else value


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
    if known.linkage is not None and is_reset(known.linkage):
        verdict.resets += 1
        return restarted(machine, known.step)
    return machine.linkage.advance(before.linkage, before.motor, before.body)


def _pairs(known: StepSamples, frame: Frame) -> Iterator[tuple[str, Sample, Sample]]:
    """Yield recorded and computed samples; a state that was taken from the recording is left out."""
    for role in ("linkage", "motor", "forces", "body"):
        recorded, computed = getattr(known, role), getattr(frame, role)
        if recorded is not None and computed is not None and recorded is not computed:
            yield role, recorded, computed

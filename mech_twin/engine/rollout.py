# SPDX-License-Identifier: Apache-2.0
"""Roll-out of a machine: a run as arrays, computed without samples or Python calls between steps.

A machine whose roles are backed by kernels runs through `compiled_steps`; any other through its roles, with the same
result.  The numbers are bit for bit those of `engine.run.frames`.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mech_twin.capabilities.arguments import real_number, sequence_items
from mech_twin.capabilities.blow_gauge import GAUGE_UNITS
from mech_twin.declarations.captions import unknown_name
from mech_twin.declarations.quantity import LONGEST_RUN_S
from mech_twin.engine.compiled_machine import CompiledMachine, compiled_machine
from mech_twin.engine.compiled_steps import RunEnd
from mech_twin.engine.coupling import (
    Profile,
    Target,
    Targets,
    check_effort,
    command_profile,
    complete_frame,
    next_frame,
    plain,
    step_at,
)
from mech_twin.engine.sample_vectors import LAYOUTS, Array, EventNumbers, FrameLayout
from mech_twin.engine.trajectory import Residual, RunInvariants, frame_events, residuals_of_run
from mech_twin.errors import MotionError, StudyError, UnknownNameError
from mech_twin.roles import Machine
from mech_twin.samples import EffortCommand, Event, Frame


@dataclass(frozen=True)
class RollOut:
    """A run as arrays.

    Attributes
    ----------
    columns : dict of str to ndarray
        ``time_s`` and the chosen columns, one number a step, the first that of the start.  After a failure: nan.
    final : Frame
        The last frame; a further roll-out starts from it.
    residuals : dict of str to Residual
        The worst of each residual of the run, with its limit.
    error : MotionError or None
        The error that ended the run early.
    machines : tuple of pairs
        The machine that ran, and the step up to which it did; one pair for each change.
    """

    columns: dict[str, Array]
    final: Frame
    residuals: dict[str, Residual]
    error: MotionError | None
    _listed_events: Callable[[], list[tuple[int, Event]]]
    _numbers: Callable[[], EventNumbers] | None = None
    machines: tuple[tuple[int, Machine], ...] = ()

    @cached_property
    def event_numbers(self) -> EventNumbers:
        """Every event as arrays in time order, without a sample for each; those of the start are left out."""
        if self._numbers is not None:
            return self._numbers()
        steps, events = [step for step, _ in self.stepped_events], self.events
        speeds = np.array([[e.pre_velocity_m_per_s, e.post_velocity_m_per_s, e.impulse_ns] for e in events])
        return EventNumbers(
            np.array(steps, dtype=np.int64),
            np.array([event.time_s for event in events]),
            np.array([event.kind for event in events], dtype=np.str_),
            *speeds.reshape(-1, 3).T,
        )

    @cached_property
    def stepped_events(self) -> tuple[tuple[int, Event], ...]:
        """Every event with the step it happened in, in time order; those of the start are left out."""
        return tuple(self._listed_events())

    @property
    def events(self) -> tuple[Event, ...]:
        """Every event in time order."""
        return tuple(event for _, event in self.stepped_events)

    def gauge_numbers(self, kind: str, name: str) -> Array:
        """Return a quantity of `GAUGE_UNITS` of the machine's gauge for each event of a kind, in time order.

        It is nan for an event that the gauge does not measure.

        Raises
        ------
        StudyError
            The machine has no gauge.
        """
        if any(machine.gauge is None for _, machine in self.machines):
            raise StudyError(f"event.{kind}.{name}: no gauge on this machine; expected a blow told as a wave")
        place = tuple(GAUGE_UNITS).index(name)
        return np.array([numbers[place] for event, numbers in self._gauged if event.kind == kind])

    @cached_property
    def _gauged(self) -> list[tuple[Event, tuple[float, ...]]]:
        """Every event and the gauge's numbers for it; the wave of each blow is computed once."""
        found, none = [], (np.nan,) * len(GAUGE_UNITS)
        for step, event in self.stepped_events:
            gauge = next((one for last, one in self.machines if step <= last), self.machines[-1][1]).gauge
            if gauge is not None:
                found.append((event, gauge.numbers(event) if gauge.has_reading(event) else none))
        return found

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to pickle, with the events in place of the function that lists them."""
        return {**vars(self), "_listed_events": partial(list, self.stepped_events), "_numbers": None}

    def __getitem__(self, column: str) -> Array:
        if column not in self.columns:
            raise UnknownNameError(unknown_name(column, self.columns, "column "))
        return self.columns[column]


class RunPiece(NamedTuple):
    """A stretch of a run under one set of parameters: the machine, and how many steps it takes."""

    machine: Machine
    steps: int


@dataclass(frozen=True)
class RunPlan:
    """A run that is ready to be computed: its stretches, first frame, commands, and the columns asked for."""

    pieces: tuple[RunPiece, ...]
    start: Frame
    targets: Targets
    columns: Sequence[str] | None

    @cached_property
    def compiled(self) -> tuple[CompiledMachine, ...]:
        """The machine of each stretch as the kernels use it; empty if one of them, or a command, is not for kernels."""
        found = [compiled_machine(piece.machine) for piece in self.pieces]
        compiled = tuple(machine for machine in found if machine is not None)
        return compiled if len(compiled) == len(found) and isinstance(self.targets, np.ndarray) else ()

    def computed(self, between: Callable[[], None]) -> RollOut:
        """Return the run; ``between`` as for `roll_out`."""
        if self.compiled:
            run = CompiledRun(self)
            for here, view in zip(run.stretches, self.compiled, strict=True):
                if run.error is None:
                    end, error = view.run_interruptibly(
                        run.step, run.row, here.targets, run.picked, here.columns, run.worst, between
                    )
                    run.take(view, end, error)
            return run.result()
        asked = self.targets.tolist() if isinstance(self.targets, np.ndarray) else self.targets
        for effort in {target for target in asked if isinstance(target, EffortCommand)}:
            check_effort(self.pieces[0].machine, effort)
        return replace(_run_by_roles(self.pieces, self.start, asked[1:], self.columns, between), machines=self.machines)

    @property
    def machines(self) -> tuple[tuple[int, Machine], ...]:
        """The machine that runs, and the step up to which it does."""
        lasts = np.cumsum([self.start.linkage.step, *(piece.steps for piece in self.pieces)])[1:].tolist()
        return tuple((last, piece.machine) for last, piece in zip(lasts, self.pieces, strict=True))


class Stretch(NamedTuple):
    """The commands of a stretch of a run, and its part of the table of columns."""

    targets: Array
    columns: Array


class CompiledRun:
    """A run by kernels: its frame as a row, its columns, and what it did so far."""

    def __init__(self, plan: RunPlan) -> None:
        first, self.plan, self.layout = plan.compiled[0], plan, plan.compiled[0].layout
        self.row, self.step = self.layout.row(plan.start), plan.start.linkage.step
        self.names = _picked(self.layout, plan.columns)
        self.picked = np.array([self.layout.columns[name] for name in self.names], dtype=np.int64)
        self.columns = np.full((len(plan.targets), len(self.names)), np.nan)
        self.columns[0] = self.row[self.picked]
        self.worst = np.abs(self.row[first.residual_places])
        self.error: MotionError | None = None
        self._view, self._tables = first, [np.empty((0, first.widths.table))]

    @property
    def stretches(self) -> list[Stretch]:
        """The commands and columns of each stretch."""
        ends = np.cumsum([1, *(piece.steps for piece in self.plan.pieces)]).tolist()
        targets: Any = self.plan.targets
        return [Stretch(targets[a:b], self.columns[a:b]) for a, b in pairwise(ends)]

    def take(self, view: CompiledMachine, end: RunEnd, error: MotionError | None) -> None:
        """Add a stretch of the run; row and columns are filled."""
        self._tables.append(end.events[: end.event_count])
        self.step, self._view, self.error = self.step + end.steps, view, error

    def result(self) -> RollOut:
        """Return the run."""
        view, table, plan = self._view, np.concatenate(self._tables), self.plan
        columns = {name: self.columns[:, i] for i, name in enumerate(self.names)}
        final = view.frame(self.step, self.row, table) if self.step > plan.start.linkage.step else plan.start
        worst = zip(plan.compiled[0].residuals, self.worst.tolist(), strict=True)
        return RollOut(
            columns, final, residuals_of_run(view.machine, worst), self.error, lambda: view.events_in_order(table),
            lambda: view.event_numbers(table), plan.machines,
        )  # fmt: skip


def roll_out(
    machine: Machine,
    duration_s: float,
    columns: Sequence[str] | None = None,
    start: Frame | None = None,
    command: Profile = 1.0,
    changes: Iterable[tuple[float, Machine]] = (),
    between: Callable[[], None] = lambda: None,
) -> RollOut:
    """Return a run of a machine.

    Parameters
    ----------
    machine : Machine
        What to run.
    duration_s : float
        Simulated time, rounded to whole steps.
    columns : sequence of str, optional
        Names of the columns wanted (`column_names`); all if absent.
    start : Frame, optional
        Frame to go on from; the machine's own start if absent.
    command : float, EffortCommand, callable, sequence of pairs or ndarray
        Asked fraction of rated supply frequency, or an effort in its place.  One for the run; ``command(step)``; pairs
        of time (s) and the command from then on, 1 before the first; or one number a step, the first that of the start.
    changes : iterable of (float, Machine)
        The machine with other parameters, and the time (s) from which on it is the one that runs.
    between : callable
        Called every now and then; what it raises ends the run.

    Returns
    -------
    RollOut
        With ``error`` set if the motion could not be followed to the end.
    """
    return planned(machine, duration_s, columns, start, command, changes).computed(between)


def planned(
    machine: Machine,
    duration_s: float,
    columns: Sequence[str] | None,
    start: Frame | None,
    command: Profile,
    changes: Iterable[tuple[float, Machine]],
) -> RunPlan:
    """Return a run that is ready to be computed; parameters as for `roll_out`."""
    count = _count(machine, duration_s)
    if start is not None and not isinstance(start, Frame):
        raise StudyError(f"start {start!r:.80}: expected a frame, such as `final` of a roll-out")
    first = 0 if start is None else start.linkage.step
    if start is not None:
        _require_columns("start: a frame", layout_of(start).columns, machine)
    targets = command_profile(command, first, count, machine.coupling_step_s)
    if start is None:
        start = complete_frame(machine, machine.linkage.start(), None, plain(targets[0]))
    return RunPlan(tuple(_pieces(machine, first, count, changes)), start, targets, columns)


def column_names(machine: Machine) -> tuple[str, ...]:
    """Return the names of all columns of a machine's roll-out."""
    compiled = compiled_machine(machine)
    if compiled is not None:
        return tuple(compiled.layout.columns)
    return tuple(layout_of(complete_frame(machine, machine.linkage.start(), None, 1.0)).columns)


def _count(machine: Machine, duration_s: float) -> int:
    whole_s = real_number("duration_s", duration_s, f"seconds, 0 to {LONGEST_RUN_S}", 0.0, LONGEST_RUN_S)
    return round(whole_s / machine.coupling_step_s)


def _pieces(machine: Machine, first: int, count: int, changes: Iterable[tuple[float, Machine]]) -> list[RunPiece]:
    """Return the stretches of a run of ``count`` steps after step ``first``."""
    bounds, machines = [first + 1], [machine]
    for time_s, changed in changes:
        real_number("change at", time_s, "a finite number of seconds")
        if changed.name != machine.name or changed.coupling_step_s != machine.coupling_step_s:
            raise StudyError(f"change at {time_s} s: machine and coupling.step_s cannot change during a run")
        _require_columns(f"change at {time_s} s: a machine", column_names(changed), machine)
        begin = max(step_at(time_s, machine.coupling_step_s), first + 1)
        if begin > first + count:
            end_s = (first + count) * machine.coupling_step_s
            raise StudyError(f"change at {time_s} s: expected up to the end of the run at {end_s:g} s")
        if begin < bounds[-1]:
            raise StudyError(f"change at {time_s} s: expected changes in ascending order of time")
        bounds.append(begin)
        machines.append(changed)
    ends = (*bounds[1:], first + count + 1)
    return [RunPiece(m, end - begin) for m, begin, end in zip(machines, bounds, ends, strict=True)]


def _require_columns(what: str, columns: Iterable[str], machine: Machine) -> None:
    """Raise if a frame or a machine does not have the columns of a machine, in their order."""
    found, known = tuple(columns), column_names(machine)
    if found != known:
        more = next(iter(sorted({*found} - {*known})), None)
        lacks = next(iter(sorted({*known} - {*found})), None)
        named = f"with {more}" if more else f"without {lacks}" if lacks else "with other columns"
        raise StudyError(f"{what} {named}; expected one of {machine.name} with the same joints and elements")


def _picked(layout: FrameLayout, columns: Sequence[str] | None) -> list[str]:
    names = layout.columns
    asked = names if columns is None else sequence_items("columns", columns, "a list of names")
    wanted = list(names) if columns is None else ["time_s", *(name for name in asked if name != "time_s")]
    for name in wanted:
        if not isinstance(name, str) or name not in names:
            raise UnknownNameError(unknown_name(name, names, "column "))
    return wanted


def _run_by_roles(
    pieces: Sequence[RunPiece],
    start: Frame,
    targets: list[Target],
    columns: Sequence[str] | None,
    between: Callable[[], None],
) -> RollOut:
    layout, frame, error = layout_of(start), start, None
    names = _picked(layout, columns)
    picked = [layout.columns[name] for name in names]
    found = np.full((len(targets) + 1, len(names)), np.nan)
    found[0] = layout.row(start)[picked]
    invariants, events = RunInvariants(pieces[0].machine), []
    invariants.observe(start)
    machines = [piece.machine for piece in pieces for _ in range(piece.steps)]
    for done, (machine, target) in enumerate(zip(machines, targets, strict=True), 1):
        between()
        try:
            frame = next_frame(machine, frame, target)
        except MotionError as failure:
            error = failure
            break
        found[done] = layout.row(frame)[picked]
        invariants.observe(frame)
        events += [(frame.linkage.step, event) for event in frame_events(frame)]
    columns_found = {name: found[:, i] for i, name in enumerate(names)}
    return RollOut(columns_found, frame, invariants.residuals(), error, lambda: events)


def layout_of(frame: Frame) -> FrameLayout:
    """Return the indices of a frame's numbers in a row, by their names."""
    roles = [(LAYOUTS[type(sample)], sample) for sample in frame if sample is not None]
    return FrameLayout(*[layout(*layout.of(sample)) for layout, sample in roles])

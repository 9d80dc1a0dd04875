# SPDX-License-Identifier: Apache-2.0
"""Runs of many machines on a graphics processor (CUDA, numba-cuda): one thread for each.

The steps are those of the processor (`compiled_steps.advance_frame`), compiled for the graphics processor.  Sines and
cosines are those of its library, so numbers differ in the last digits.  Runs with the same constants but for their
numbers, and the same steps, share a kernel and go side by side; the kernel is compiled once a process.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.addresses import view_as
from mech_twin.engine.compiled_machine import CompiledMachine, PackedModels, packed_models
from mech_twin.engine.compiled_roles import failed
from mech_twin.engine.compiled_steps import (
    ALL_EVENTS,
    BODY_FAILED,
    DONE,
    TOO_SHORT,
    Indices,
    RunEnd,
    RunRoom,
    Work,
    advance_frame,
    work_room,
)
from mech_twin.engine.rollout import CompiledRun, RollOut, RunPlan, Stretch
from mech_twin.engine.sample_vectors import LOAD_WIDTH, Array, Places
from mech_twin.errors import MotionError, StudyError

NEEDS = "device 'cuda' needs the package numba-cuda: pip install 'mech_twin[cuda]'"
NONE_HERE = "device 'cuda': no graphics processor with CUDA was found; expected one, or device 'cpu'"
EXPECTED = "expected a machine that a graphics processor can run, or device 'cpu'"
STEP_EVENTS = 32  # rows of the table of events of a step
RUN_EVENTS = 2 * STEP_EVENTS  # rows of the table of events of a run, emptied when it is full: those of linkage and body
BLOCK = 256  # steps of a launch
MOST_MEMBERS = 16_384  # at once: their tables of events and columns are in the memory of the graphics processor
THREADS = 64  # that share a processor, each with the constants of a machine
TOO_MANY = f"more than {STEP_EVENTS} events in a step; expected fewer, or device 'cpu'"

_SOURCE = """
def run_members(
    real, whole, flag, first, begun, target, row, picked, column, residuals, worst, number, mark, table, end
):
    i = cuda.grid(1)
    if i < len(begun):
        reals, wholes, flags, numbers, marks, at = real[i], whole[i], flag[i], number[i], mark[i], begun[i]
        end[i, 0], end[i, 1], end[i, 2], end[i, 3] = advance_frame(
            {models}, Places({places}), first[i] + at, {step_s!r}, target[i, at:], row[i], picked, column[i, at:],
            residuals, worst[i], RunRoom({room})
        )
"""


class MemberKernel(NamedTuple):
    """The kernel of a machine: its source, the named tuples in it, and the lengths of its work arrays."""

    source: str
    names: tuple[tuple[str, type], ...]
    numbers: int
    marks: int


class Member(NamedTuple):
    """A run, the machine of its present stretch with its constants packed, and that stretch."""

    run: CompiledRun
    view: CompiledMachine
    packed: PackedModels
    stretch: Stretch


def cuda() -> Any:
    """Return `numba.cuda`.

    Raises
    ------
    StudyError
        The package, or a graphics processor, is not here.
    """
    try:
        import numba_cuda  # noqa: F401  it takes the place of numba.cuda
    except ModuleNotFoundError as error:
        raise StudyError(NEEDS) from error
    card = import_module("numba.cuda")
    if not card.is_available():
        raise StudyError(NONE_HERE)
    return card


def run_on_graphics_processor(plans: Sequence[RunPlan]) -> list[RollOut]:
    """Return runs computed side by side; their changes are at the same times.

    Raises
    ------
    StudyError
        There is no graphics processor, or a machine cannot run on one.
    """
    card = cuda()
    for plan in plans:
        name = plan.pieces[0].machine.name
        if not plan.compiled:
            raise StudyError(f"device 'cuda': {name} has a role in Python, or an effort for a command; {EXPECTED}")
        for view in plan.compiled:
            if why := getattr(view.machine.linkage, "processor_only", ""):
                raise StudyError(f"device 'cuda': {name}: {why}; {EXPECTED}")
    runs = [CompiledRun(plan) for plan in plans]
    for which in range(max((len(plan.pieces) for plan in plans), default=0)):
        groups: dict[tuple[MemberKernel, int], list[Member]] = {}
        for run in runs:
            if run.error is None:
                view = run.plan.compiled[which]
                member = Member(run, view, packed_models(view.models), run.stretches[which])
                key = kernel_of(view, member.packed), len(member.stretch.targets)
                groups.setdefault(key, []).append(member)
        for (kernel, steps), members in groups.items():
            for begin in range(0, len(members), MOST_MEMBERS):
                group = MemberGroup(card, kernel, members[begin : begin + MOST_MEMBERS])
                for first in range(0, steps, BLOCK):
                    group.advance(first, min(BLOCK, steps - first))
                group.finish()
    return [run.result() for run in runs]


def kernel_of(machine: CompiledMachine, packed: PackedModels) -> MemberKernel:
    """Return the kernel of a machine; it is that of all machines whose constants differ in their numbers alone."""
    models, at, widths, begin, marks = machine.models, machine.layout.places, machine.widths, 0, 0
    views, works = [], []
    for shape in (
        (at.motor - at.linkage,), (at.end - at.body,), (at.end,), (STEP_EVENTS, widths.linkage),
        (STEP_EVENTS, widths.body), (STEP_EVENTS, LOAD_WIDTH),
    ):  # fmt: skip
        views.append(f"view_as(numbers[{begin}:], {', '.join(map(str, shape))})")
        begin += math.prod(shape)
    for numbers_needed, marks_needed in (work_room(models.linkage), work_room(models.forces)):
        works.append(f"Work(numbers[{begin}:{begin + numbers_needed}], marks[{marks}:{marks + marks_needed}])")
        begin, marks = begin + numbers_needed, marks + marks_needed
    source = _SOURCE.format(
        room=", ".join([*views, "table[i]", *works]), models=packed.expression, places=", ".join(map(str, at)),
        step_s=float(machine.machine.coupling_step_s),
    )  # fmt: skip
    return MemberKernel(source, tuple(packed.names.items()), begin, marks)


def kernel_function(card: Any, kernel: MemberKernel) -> Callable[..., None]:
    """Return a kernel as a function of Python."""
    named: dict[str, Any] = {
        "cuda": card, "view_as": view_as, "advance_frame": advance_frame, "RunRoom": RunRoom, "Work": Work,
        "Places": Places, **dict(kernel.names),
    }  # fmt: skip
    exec(compile(kernel.source, "<kernel of a machine>", "exec"), named)  # only numbers and names of this package
    found: Callable[..., None] = named["run_members"]
    return found


@cache
def _compiled(card: Any, kernel: MemberKernel) -> Any:
    return card.jit(kernel_function(card, kernel))


class MemberGroup:
    """Members with the same kernel in a stretch, and their numbers on the graphics processor."""

    def __init__(self, card: Any, kernel: MemberKernel, members: Sequence[Member]) -> None:
        count, run, view = len(members), members[0].run, members[0].view
        packs, send = [member.packed for member in members], card.to_device
        self._card, self._members = card, members
        self._constants = [  # one number more, for none would be no array
            send(np.array([[*numbers, 0] for numbers in kind], dtype=dtype))
            for kind, dtype in (
                ([p.reals for p in packs], np.float64), ([p.wholes for p in packs], np.int64),
                ([p.flags for p in packs], np.bool_),
            )
        ]  # fmt: skip
        self._rows = send(np.stack([member.run.row for member in members]))
        self._worst = send(np.stack([member.run.worst for member in members]))
        self._work = send(np.zeros((count, kernel.numbers))), send(np.zeros((count, kernel.marks), dtype=np.int64))
        self._picked, self._residuals = send(run.picked), send(view.residual_places)
        self._table = np.zeros((count, RUN_EVENTS, view.widths.table))
        self._launch = _compiled(card, kernel)[-(-count // THREADS), THREADS]
        self._first = np.array([member.run.step for member in members])
        self._done = np.zeros(count, dtype=np.int64)
        self._ends = [(DONE, 0)] * count  # what failed, and its status
        self._events: list[list[Array]] = [[self._table[0, :0]] for _ in members]

    def advance(self, first: int, size: int) -> None:
        """Advance the members that have not failed by some steps, the first ``first`` steps after the stretch began."""
        members, send = self._members, self._card.to_device
        targets = send(np.stack([m.stretch.targets[first : first + size] for m in members]))
        columns = send(np.zeros((len(members), size, len(members[0].run.picked))))
        begun: Indices = np.array([0 if failed == DONE else size for failed, _ in self._ends])
        while (begun < size).any():  # again, where a table of events was full
            tables, ends = send(self._table), send(np.zeros((len(members), 4), dtype=np.int64))
            self._launch(
                *self._constants, send(self._first + first), send(begun), targets, self._rows, self._picked, columns,
                self._residuals, self._worst, *self._work, tables, ends,
            )  # fmt: skip
            rows, numbers = tables.copy_to_host(), ends.copy_to_host().tolist()
            for i in np.flatnonzero(begun < size).tolist():
                count, steps, failed, status = numbers[i]
                self._events[i].append(rows[i, :count].copy())
                self._done[i] += steps
                begun[i] += steps
                if failed != DONE and (failed, status) != (TOO_SHORT, ALL_EVENTS):
                    self._ends[i], begun[i] = (failed, status), size
        found = columns.copy_to_host()
        for member, done, values in zip(members, self._done.tolist(), found, strict=True):
            count = min(max(done - first, 0), size)
            member.stretch.columns[first : first + count] = values[:count]

    def finish(self) -> None:
        """Give each run its row, its worst residuals, its events and its error."""
        rows, worst = self._rows.copy_to_host(), self._worst.copy_to_host()
        for i, member in enumerate(self._members):
            member.run.row[:], member.run.worst[:] = rows[i], worst[i]
            events = np.concatenate(self._events[i])
            end = RunEnd(events, len(events), int(self._done[i]), *self._ends[i])
            member.run.take(member.view, end, _error(member, end))


def _error(member: Member, end: RunEnd) -> MotionError | None:
    """Return the error that ended a run."""
    machine, begin_s = member.view.machine, (member.run.step + end.steps) * member.view.machine.coupling_step_s
    if end.failed == DONE:
        return None
    if end.failed == TOO_SHORT:
        return failed((f"{machine.name}: {TOO_MANY}",), -1, begin_s)
    if end.failed == BODY_FAILED:
        return failed(getattr(machine.body, "failures", ()), end.status, begin_s)
    log = np.empty((0, member.view.widths.linkage))
    error: MotionError = getattr(machine.linkage, "failure")(end.status, begin_s, log)  # noqa: B009
    return error

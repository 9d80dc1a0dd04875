# SPDX-License-Identifier: Apache-2.0
"""Runs of many machines on a graphics processor (CUDA, numba-cuda): one thread for each.

The steps are those of the processor (`compiled_steps.advance_frame`), compiled for the graphics processor.  Sines and
cosines are those of its library, so numbers differ in the last digits.  Runs with the same constants but for their
numbers, and the same steps, share a kernel and go side by side; the kernel is compiled once a process.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.addresses import view_as
from mech_twin.engine.compiled_machine import CompiledMachine, packed_models
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
    """A run, the machine of its present stretch, and that stretch."""

    run: CompiledRun
    view: CompiledMachine
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
                member = Member(run, run.plan.compiled[which], run.stretches[which])
                key = kernel_of(member.view), len(member.stretch.targets)
                groups.setdefault(key, []).append(member)
        for (kernel, steps), members in groups.items():
            for begin in range(0, len(members), MOST_MEMBERS):
                _run_stretch(card, kernel, steps, members[begin : begin + MOST_MEMBERS])
    return [run.told() for run in runs]


def kernel_of(machine: CompiledMachine) -> MemberKernel:
    """Return the kernel of a machine; it is that of all machines whose constants differ in their numbers alone."""
    models, at, widths, begin, marks = machine.models, machine.layout.places, machine.widths, 0, 0
    packed, views, works = packed_models(models), [], []
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


def _run_stretch(card: Any, kernel: MemberKernel, steps: int, members: Sequence[Member]) -> None:
    """Advance runs through a stretch of some steps."""
    runs, first = [member.run for member in members], members[0]
    packs = [packed_models(member.view.models) for member in members]
    constants = [
        card.to_device(np.array([[*numbers, 0] for numbers in kind], dtype=dtype))
        for kind, dtype in (
            ([p.reals for p in packs], np.float64), ([p.wholes for p in packs], np.int64),
            ([p.flags for p in packs], np.bool_),
        )
    ]  # fmt: skip
    rows, worst = (card.to_device(np.stack(arrays)) for arrays in ([r.row for r in runs], [r.worst for r in runs]))
    work = [
        card.to_device(np.zeros((len(runs), size), dtype=dtype))
        for size, dtype in ((kernel.numbers, np.float64), (kernel.marks, np.int64))
    ]
    table = np.zeros((len(runs), RUN_EVENTS, first.view.widths.table))
    places = [card.to_device(array) for array in (first.run.picked, first.view.residual_places)]
    launch = _compiled(card, kernel)[-(-len(runs) // THREADS), THREADS]
    began, state = np.array([run.step for run in runs]), np.zeros((len(runs), 4), dtype=np.int64)
    kept: list[list[Array]] = [[np.empty((0, table.shape[2]))] for _ in runs]
    done = np.zeros(len(runs), dtype=np.int64)
    for begin in range(0, steps, BLOCK):
        size = min(BLOCK, steps - begin)
        targets = card.to_device(np.stack([m.stretch.targets[begin : begin + size] for m in members]))
        columns = card.to_device(np.zeros((len(runs), size, len(first.run.picked))))
        begun: Indices = np.where(state[:, 2] == DONE, 0, size)
        while (begun < size).any():
            ends, tables, asked = card.to_device(state), card.to_device(table), begun < size
            launch(
                *constants, card.to_device(began + begin), card.to_device(begun), targets, rows, places[0], columns,
                places[1], worst, *work, tables, ends,
            )  # fmt: skip
            told, rows_told = ends.copy_to_host(), tables.copy_to_host()
            for i in np.flatnonzero(asked).tolist():
                kept[i].append(rows_told[i, : told[i, 0]].copy())
                done[i] += told[i, 1]
                full = told[i, 2] == TOO_SHORT and told[i, 3] == ALL_EVENTS
                begun[i] = begun[i] + told[i, 1] if full or told[i, 2] == DONE else size
                state[i, 2:] = (DONE, 0) if full else told[i, 2:]
        found = columns.copy_to_host()
        for i, member in enumerate(members):
            whole = min(size, int(done[i]) - begin)
            if whole > 0:
                member.stretch.columns[begin : begin + whole] = found[i, :whole]
    for i, (member, row, most) in enumerate(zip(members, rows.copy_to_host(), worst.copy_to_host(), strict=True)):
        member.run.row[:], member.run.worst[:], events = row, most, np.concatenate(kept[i])
        end = RunEnd(events, len(events), int(done[i]), int(state[i, 2]), int(state[i, 3]))
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

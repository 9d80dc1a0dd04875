# SPDX-License-Identifier: Apache-2.0
"""Kernels of the roles' steps: declared for the type of a role's constants, dispatched by that type.

A role's author declares its constants as a `NamedTuple` and, with `step_of`, the kernel of its step::

    class Torque(NamedTuple):
        torque_nm: float

    @step_of(motor_step, Torque)
    def torque_motor(model, linkage, target, out): ...

The role calls that kernel (`compiled_roles`), and the compiled run calls the same one (`rollout`).
Rows are those of `sample_vectors`.  A kernel fills every number of ``out``, and returns the number of events that it
wrote into the table ``log``; negative if the step failed.  It makes no array: ``work`` has the room that it declares
(`work_room`), and one that returns `LOG_FULL` is asked again with a longer table.

`advance_frame` is the coupling scheme of `coupling`, compiled: many steps without samples or Python calls.  At step n::

    linkage(n) -> motor(n)
    linkage(n) -> forces(n) -> body(n)          body(n) from body(n-1)
    linkage(n), motor(n), body(n) -> linkage(n+1)
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.integration import declared_kernel
from mech_twin.engine.sample_vectors import FEW_ROWS, LOAD_WIDTH, SIDES, Places
from mech_twin.kernels.dispatcher import generic, set_kernel
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, kernel, released_kernel

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., Any])

LOG_FULL = -100  # the table of events is too short
Indices = NDArray[np.int64]
STEP, SOURCE = 0, 1  # columns before those of an event in the table of a run
FROM_LINKAGE, FROM_BODY = 0, 1
TABLE_EXTRA = 2
DONE, LINKAGE_FAILED, BODY_FAILED, TOO_SHORT = 0, 1, 2, 3
EVENTS, BODY_EVENTS, ALL_EVENTS = 0, 1, 2  # the table that is too short


@generic()
def motor_step(model: Any, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` with the motor at a linkage row; ``target`` is the asked fraction of rated supply frequency."""


class Work(NamedTuple):
    """Work arrays of a step, zeros at its begin: floats and integers."""

    numbers: Array
    marks: Indices


@generic(kernel)
def work_room(model: Any) -> Any:
    """Return the lengths of the work arrays of a linkage or a force analysis; none where no function is declared."""
    return 0, 0


@generic()
def linkage_step(
    model: Any, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the linkage one step after ``step``; return the number of events in between."""
    raise NotImplementedError


@generic()
def force_step(
    model: Any, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with the forces at the step of a linkage row and its events; return the number of loads.

    ``loads`` has a row for each event.
    """
    raise NotImplementedError


@generic()
def body_step(
    model: Any, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> int:
    """Fill ``out`` with the body at ``step``, one after that of ``body``; return the number of its events."""
    raise NotImplementedError


def step_of(
    of: Callable[..., Any], model_type: type, compiler: Callable[[Any], Any] = kernel
) -> Callable[[Function], Function]:
    """Declare a kernel as the implementation of a generic step for one type of first argument.

    Parameters
    ----------
    of : callable
        `motor_step`, `linkage_step`, ... or another `generic` function.
    model_type : type
        A `NamedTuple` of the same module as the kernel.
    compiler : callable
        One of `mech_twin.kernels.kernel`.
    """

    def declare(function: Function) -> Function:
        compiled = declared_kernel(model_type, function, compiler)
        set_kernel(of, model_type, compiled)
        return compiled

    return declare


class NoBody(NamedTuple):
    """Constants of a machine in which nothing moves but the linkage."""

    unused: float


@step_of(body_step, NoBody)
def no_body(
    model: NoBody, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> int:
    """Return no events: the machine has no body."""
    return 0


@kernel
def work_for(model: Any) -> Work:
    """Return new work arrays for the steps of a role."""
    numbers, marks = work_room(model)
    return Work(np.zeros(numbers), np.zeros(marks, dtype=np.int64))


@kernel
def longer(table: Array) -> Array:
    """Return a table of zeros with more than twice as many rows."""
    return np.zeros((2 * len(table) + FEW_ROWS, table.shape[1]))


@embedded_kernel
def clear_work(work: Work) -> None:
    """Fill work arrays with zeros."""
    for i in range(len(work.numbers)):
        work.numbers[i] = 0.0
    for i in range(len(work.marks)):
        work.marks[i] = 0


@kernel
def whole_linkage_step(
    model: Any, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> tuple[Array, int]:
    """Fill ``out`` as `linkage_step` does; return a table that is long enough, and the number of events."""
    while True:
        clear_work(work)
        count = linkage_step(model, step, linkage, motor, body, out, log, work)
        if count != LOG_FULL:
            return log, count
        log = longer(log)


@kernel
def whole_body_step(
    model: Any, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill ``out`` as `body_step` does; return a table that is long enough, and the number of events."""
    while True:
        found = body_step(model, step, body, forces, loads, count, out, log)
        if found != LOG_FULL:
            return log, found
        log = longer(log)


@borrowing_kernel
def copy_rows(rows: Array, count: int, out: Array, row: int, column: int) -> None:
    """Copy the first rows of a table to a place in another; numba takes seconds to compile an assignment of slices."""
    for i in range(count):
        for j in range(rows.shape[1]):
            out[row + i, column + j] = rows[i, j]


@embedded_kernel
def copy_numbers(numbers: Array | tuple[float, ...], out: Array) -> None:
    """Copy an array, or a tuple, to an array of at least its length."""
    for i in range(len(numbers)):
        out[i] = numbers[i]


@borrowing_kernel
def fill_event(
    log: Array, row: int, time_s: float, kind: int, contact: int, before_m_per_s: float, after_m_per_s: float,
    impulse_ns: float, period: float,
) -> None:  # fmt: skip
    """Write an event without coordinates into a row, if the table has it."""
    if row >= len(log):
        return
    log[row, 0], log[row, 1], log[row, 2] = time_s, kind, contact
    log[row, 3], log[row, 4], log[row, 5], log[row, 6] = before_m_per_s, after_m_per_s, impulse_ns, period
    log[row, SIDES] = 0.0


class Models(NamedTuple):
    """Constants of the four roles."""

    motor: Any
    linkage: Any
    forces: Any
    body: Any


class Widths(NamedTuple):
    """Columns of the tables of linkage and body events, and of the table of a run."""

    linkage: int
    body: int
    table: int


class RunRoom(NamedTuple):
    """Work arrays of a run.

    Rows: linkage and body at the end of a step, the frame at its begin.  Tables: events of linkage and body in a step,
    loads on the body (as many as events of the linkage), events of the run.  Work of linkage and forces.
    """

    later: Array
    followed: Array
    before: Array
    log: Array
    body_log: Array
    loads: Array
    table: Array
    work: Work
    force_work: Work


class RunEnd(NamedTuple):
    """End of a run: table and number of its events, steps done, failed role if any, and its status."""

    events: Array
    event_count: int
    steps: int
    failed: int
    status: int


@borrowing_kernel
def keep_events(table: Array, filled: int, step: int, source: int, log: Array, count: int) -> None:
    """Append the first ``count`` events of a step to the table of the run."""
    for i in range(count):
        table[filled + i, STEP], table[filled + i, SOURCE] = step, source
    copy_rows(log, count, table, filled, TABLE_EXTRA)


@borrowing_kernel
def keep_worst(row: Array, residuals: Indices, worst: Array) -> None:
    """Update the largest magnitude of each residual; once a residual was NaN, its worst is NaN."""
    for i in range(len(residuals)):
        size = abs(row[residuals[i]])
        if size > worst[i] or math.isnan(size):
            worst[i] = size


@borrowing_kernel
def advance_frame(
    models: Models, at: Places, first: int, step_s: float, targets: Array, row: Array, picked: Indices, columns: Array,
    residuals: Indices, worst: Array, room: RunRoom,
) -> tuple[int, int, int, int]:  # fmt: skip
    """Advance a frame by one step for each target; return numbers of events and steps, what failed, and its status.

    With `TOO_SHORT` the frame is that of the last whole step, and the status names the table.

    Parameters
    ----------
    models, at, first, step_s, targets, row, picked, columns, residuals, worst
        As for `run_steps`.
    room : RunRoom
        Work arrays; the table of the run is filled from its start.
    """
    linkage, motor = row[at.linkage : at.motor], row[at.motor : at.forces]
    forces, body, filled = row[at.forces : at.body], row[at.body : at.end], 0
    for n in range(len(targets)):
        step = first + n + 1
        clear_work(room.work)
        count = linkage_step(models.linkage, step - 1, linkage, motor, body, room.later, room.log, room.work)
        if count == LOG_FULL:
            return filled, n, TOO_SHORT, EVENTS
        if count < 0:
            return filled, n, LINKAGE_FAILED, count
        if filled + count > len(room.table):
            return filled, n, TOO_SHORT, ALL_EVENTS
        copy_numbers(row, room.before)
        copy_numbers(room.later, linkage)
        motor_step(models.motor, linkage, targets[n], motor)
        loads = force_step(models.forces, step, linkage, room.log, count, forces, room.loads, room.force_work)
        keep_events(room.table, filled, step, FROM_LINKAGE, room.log, count)
        if len(body) > 0:
            found = body_step(models.body, step, body, forces, room.loads, loads, room.followed, room.body_log)
            if found == LOG_FULL or (found >= 0 and filled + count + found > len(room.table)):
                copy_numbers(room.before, row)
                return filled, n, TOO_SHORT, BODY_EVENTS if found == LOG_FULL else ALL_EVENTS
            filled += count
            if found < 0:
                return filled, n, BODY_FAILED, found
            copy_numbers(room.followed, body)
            keep_events(room.table, filled, step, FROM_BODY, room.body_log, found)
            count = found
        filled += count
        row[0] = step * step_s
        for k in range(len(picked)):
            columns[n, k] = row[picked[k]]
        keep_worst(row, residuals, worst)
    return filled, len(targets), DONE, 0


@released_kernel
def run_steps(
    models: Models, at: Places, widths: Widths, first: int, step_s: float, targets: Array, row: Array, picked: Indices,
    columns: Array, residuals: Indices, worst: Array,
) -> tuple[Array, int, int, int, int]:  # fmt: skip
    """Advance a frame by one step for each target; return the fields of `RunEnd`.

    A plain tuple is returned: numba's wrapper crashes if a signal raises while it builds a named tuple.

    Parameters
    ----------
    models : Models
        Constants of the roles.
    at : Places
        Where the row of each role begins in the row of a frame.
    widths : Widths
        Columns of the tables of events.
    first : int
        Step of the frame that is carried on.
    step_s : float
        Coupling step (s).
    targets : (n,) array
        Asked fraction of rated supply frequency at each of the next steps.
    row : array
        The frame, changed in place.
    picked : (m,) array
        Places in the row that are kept.
    columns : (n, m) array
        Filled with them.
    residuals : (r,) array
        Places of the residuals.
    worst : (r,) array
        Greatest magnitude of each so far, changed in place.
    """
    later, followed, before = np.empty(at.motor - at.linkage), np.empty(at.end - at.body), np.empty(len(row))
    log, body_log = np.empty((FEW_ROWS, widths.linkage)), np.empty((FEW_ROWS, widths.body))
    loads, table = np.empty((FEW_ROWS, LOAD_WIDTH)), np.zeros((FEW_ROWS, widths.table))
    work, force_work, filled, done = work_for(models.linkage), work_for(models.forces), 0, 0
    while True:
        room = RunRoom(later, followed, before, log, body_log, loads, table[filled:], work, force_work)
        events, steps, failed, status = advance_frame(
            models, at, first + done, step_s, targets[done:], row, picked, columns[done:], residuals, worst, room
        )
        filled, done = filled + events, done + steps
        if failed != TOO_SHORT:
            return table, filled, done, failed, status
        if status == EVENTS:
            log, loads = longer(log), longer(loads)
        elif status == BODY_EVENTS:
            body_log = longer(body_log)
        else:
            more = longer(table)
            copy_rows(table, filled, more, 0, 0)
            table = more

# SPDX-License-Identifier: Apache-2.0
"""The coupling scheme of `coupling`, compiled: many steps of a machine's kernels without samples or Python calls.

At step n::

    linkage(n) -> motor(n)
    linkage(n) -> forces(n) -> body(n)          body(n) from body(n-1)
    linkage(n), motor(n), body(n) -> linkage(n+1)
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.compiled_steps import (
    body_step,
    copy_numbers,
    copy_rows,
    force_step,
    motor_step,
    whole_linkage_step,
)
from mech_twin.engine.sample_vectors import FEW_ROWS, LOAD_WIDTH, Array, Places
from mech_twin.kernels.kernel import kernel, released_kernel

Indices = NDArray[np.int64]
STEP, SOURCE = 0, 1  # columns before those of an event in the table of a run
FROM_LINKAGE, FROM_BODY = 0, 1
TABLE_EXTRA = 2
DONE, LINKAGE_FAILED, BODY_FAILED = 0, 1, 2


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


class RunEnd(NamedTuple):
    """End of a run: table and number of its events, steps done, failed role if any, and its status."""

    events: Array
    event_count: int
    steps: int
    failed: int
    status: int


@kernel
def keep_events(table: Array, filled: int, step: int, source: int, log: Array, count: int) -> Array:
    """Append the first ``count`` events of a step to the table of the run; return the table, enlarged if needed."""
    while filled + count > len(table):
        longer = np.zeros((2 * len(table), table.shape[1]))
        copy_rows(table, filled, longer, 0, 0)
        table = longer
    for i in range(count):
        table[filled + i, STEP], table[filled + i, SOURCE] = step, source
    copy_rows(log, count, table, filled, TABLE_EXTRA)
    return table


@kernel
def keep_worst(row: Array, residuals: Indices, worst: Array) -> None:
    """Update the largest magnitude of each residual; once a residual was NaN, its worst is NaN."""
    for i in range(len(residuals)):
        size = abs(row[residuals[i]])
        if size > worst[i] or np.isnan(size):
            worst[i] = size


@released_kernel
def run_steps(
    models: Models,
    at: Places,
    widths: Widths,
    first: int,
    step_s: float,
    targets: Array,
    row: Array,
    picked: Indices,
    columns: Array,
    residuals: Indices,
    worst: Array,
) -> tuple[Array, int, int, int, int]:
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
    linkage, motor = row[at.linkage : at.motor], row[at.motor : at.forces]
    forces, body = row[at.forces : at.body], row[at.body : at.end]
    later, followed = np.empty(len(linkage)), np.empty(len(body))
    log, body_log = np.empty((FEW_ROWS, widths.linkage)), np.empty((FEW_ROWS, widths.body))
    loads = np.empty((FEW_ROWS, LOAD_WIDTH))
    table, filled = np.zeros((FEW_ROWS, widths.table)), 0
    for n in range(len(targets)):
        step = first + n + 1
        log, count = whole_linkage_step(models.linkage, step - 1, linkage, motor, body, later, log)
        if count < 0:
            return table, filled, n, LINKAGE_FAILED, count
        copy_numbers(later, linkage)
        motor_step(models.motor, linkage, targets[n], motor)
        loads, loaded = force_step(models.forces, step, linkage, log, count, forces, loads)
        table = keep_events(table, filled, step, FROM_LINKAGE, log, count)
        filled += count
        if len(body) > 0:
            body_log, count = body_step(models.body, step, body, forces, loads, loaded, followed, body_log)
            if count < 0:
                return table, filled, n, BODY_FAILED, count
            copy_numbers(followed, body)
            table = keep_events(table, filled, step, FROM_BODY, body_log, count)
            filled += count
        row[0] = step * step_s
        for k in range(len(picked)):
            columns[n, k] = row[picked[k]]
        keep_worst(row, residuals, worst)
    return table, filled, len(targets), DONE, 0

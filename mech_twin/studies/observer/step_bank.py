# SPDX-License-Identifier: Apache-2.0
"""Advances several frames together by one coupling step, each with the machine's own compiled roles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.compiled_machine import CompiledMachine, compiled_machine
from mech_twin.engine.compiled_run import DONE, Indices, Models, Widths, run_steps
from mech_twin.engine.sample_vectors import Array, Places
from mech_twin.kernels.kernel import released_kernel
from mech_twin.roles import Machine
from mech_twin.samples import Event


class BankStep(NamedTuple):
    """Frames one step later: rows (m, w), number of events of each (m,), failure codes, events of the first."""

    rows: Array
    event_counts: Indices
    failed: Indices
    events: Array


@released_kernel
def step_rows(
    models: Models, at: Places, widths: Widths, first: int, step_s: float, target: float, rows: Array
) -> tuple[Indices, Indices, Array]:
    """Advance each row by one step, in place; return numbers of events, failure codes, and the first row's events.

    Parameters
    ----------
    models, at, widths, first, step_s
        As in `engine.compiled_run.run_steps`.
    target : float
        Requested fraction of rated supply frequency.
    rows : (m, w) array
        Frames at step ``first``.
    """
    count = len(rows)
    event_counts, failed = np.zeros(count, np.int64), np.zeros(count, np.int64)
    targets, picked, columns = np.full(1, target), np.zeros(0, np.int64), np.zeros((1, 0))
    events = np.zeros((0, widths.table))
    for i in range(count):
        table, event_counts[i], _, failed[i], _ = run_steps(
            models, at, widths, first, step_s, targets, rows[i], picked, columns, picked, np.zeros(0)
        )
        if i == 0:
            events = table[: event_counts[i]].copy()
    return event_counts, failed, events


class StepBank:
    """The machine as a map from rows at one step to rows at the next.

    Parameters
    ----------
    machine : Machine
        Machine whose roles are all compiled.

    Raises
    ------
    ConfigurationError
        A role of the machine is not compiled.
    """

    def __init__(self, machine: Machine) -> None:
        compiled = compiled_machine(machine)
        if compiled is None:
            raise ConfigurationError(f"{machine.name}: expected a machine whose roles are compiled")
        self.compiled: CompiledMachine = compiled
        self.columns = compiled.layout.columns
        self.step_s = float(machine.coupling_step_s)

    def advanced(self, step: int, rows: Array, target: float) -> BankStep:
        """Return rows (m, w) of frames advanced by one step."""
        compiled, later = self.compiled, np.array(rows, dtype=np.float64, order="C")
        event_counts, failed, events = step_rows(
            compiled.models, compiled.layout.places, compiled.widths, step, self.step_s, float(target), later
        )
        return BankStep(later, event_counts, failed, events)

    def events(self, table: Array) -> tuple[Event, ...]:
        """Return the events in the event table of one step, in order of time."""
        return tuple(event for _, event in self.compiled.events_in_order(table)) if len(table) else ()


def all_went_on(step: BankStep) -> bool:
    """Return whether every row could be advanced."""
    return bool((step.failed == DONE).all())

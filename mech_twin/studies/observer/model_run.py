# SPDX-License-Identifier: Apache-2.0
"""Simulated run of the model, with all columns: for locking on, and for the scales of the columns.

A bank advances several frames together by one coupling step.  The time origin of a closed-form motion, normally its
last event, can be moved to the current frame.

The load of some machines changes at fixed crank angles.  If a correction moves the crank past such an angle, the event
there never occurs in the model.  So the regime is set to that of the model's own run at this angle, if it is unique in
the neighbourhood.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.compiled_machine import CompiledMachine, compiled_machine
from mech_twin.engine.compiled_roles import held
from mech_twin.engine.compiled_steps import Indices, Models, Widths, run_steps
from mech_twin.engine.rollout import roll_out
from mech_twin.engine.sample_vectors import Array, Places
from mech_twin.kernels.kernel import released_kernel
from mech_twin.measurements.units import TURN, is_angle
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import Machine
from mech_twin.samples import Event

SETTLED_SHARE = 0.4  # of the run, at its end, from which scales are computed
SMALLEST = 1e-9  # lower bound of a scale, against division by 0
AROUND = 3  # frames on either side that must have the same regime


class BankStep(NamedTuple):
    """Frames one step later: rows (m, w), number of events of each (m,), failure codes, events of the first."""

    rows: Array
    event_counts: Indices
    failed: Indices
    events: Array


class BankModel(NamedTuple):
    """What `step_rows` needs of a machine: the arguments of `engine.compiled_steps.run_steps` of these names."""

    models: Models
    at: Places
    widths: Widths
    step_s: float


@released_kernel
def step_rows(bank: Any, first: int, target: float, rows: Array) -> tuple[Indices, Indices, Array]:
    """Advance each row by one step, in place; return numbers of events, failure codes, and the first row's events.

    Parameters
    ----------
    bank : Held
        The `BankModel`, in compiled memory: converting it at each call took longer than the step.
    target : float
        Requested fraction of rated supply frequency.
    rows : (m, w) array
        Frames at step ``first``.
    """
    models, at, widths, step_s = bank.model
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
        self._held = held(BankModel(compiled.models, compiled.layout.places, compiled.widths, self.step_s))

    def advanced(self, step: int, rows: Array, target: float) -> BankStep:
        """Return rows (m, w) of frames advanced by one step."""
        later = np.array(rows, dtype=np.float64, order="C")
        event_counts, failed, events = step_rows(self._held, step, float(target), later)
        return BankStep(later, event_counts, failed, events)

    def events(self, table: Array) -> tuple[Event, ...]:
        """Return the events in the event table of one step, in order of time."""
        return tuple(event for _, event in self.compiled.events_in_order(table)) if len(table) else ()


@dataclass(frozen=True)
class ModelRun:
    """Rows (steps + 1, w) of a simulated run: all columns of the frame at each coupling step from step 0."""

    bank: StepBank
    rows: Array

    @cached_property
    def settled(self) -> Array:
        """The rows at the end of the run."""
        return self.rows[-max(2, round(SETTLED_SHARE * len(self.rows))) :]

    @cached_property
    def spread(self) -> Array:
        """Range of each column in the settled rows, shape (w,); at least a thousandth of its largest magnitude."""
        rows = self.settled
        range_ = rows.max(axis=0) - rows.min(axis=0)
        spread: Array = np.maximum(range_, np.maximum(1e-3 * np.abs(rows).max(axis=0), SMALLEST))
        spread[self.angles] = np.minimum(spread[self.angles], TURN)
        return spread

    @cached_property
    def steepest(self) -> Array:
        """Largest rate of change of each column in the settled rows (per s), shape (w,); angles are unwrapped."""
        rises = np.diff(self.settled, axis=0)
        rises[:, self.angles] = without_turns(rises[:, self.angles])
        return np.asarray(np.abs(rises).max(axis=0) / self.bank.step_s)

    @cached_property
    def angles(self) -> Indices:
        """Indices of the columns that are angles."""
        return np.array([place for name, place in self.bank.columns.items() if is_angle(name)], dtype=np.int64)


def model_run(machine: Machine, duration_s: float) -> ModelRun:
    """Return a simulated run from the machine's own start at rated command."""
    bank = StepBank(machine)
    run = roll_out(machine, duration_s)
    rows = np.column_stack([run[name] for name in bank.columns])
    return ModelRun(bank, np.ascontiguousarray(rows[np.isfinite(rows).all(axis=1)]))


def without_turns(difference: Array) -> Array:
    """Return differences of angles (rad) wrapped to the range -pi to pi."""
    return difference - TURN * np.round(difference / TURN)


def held_sigma(run: ModelRun, sigma: Array, silent_s: float) -> Array:
    """Return the standard deviation (w,) of an estimate, whose own is ``sigma``, held for ``silent_s`` (s).

    The error grows with the largest rate of change of a column, up to its range: the variance is
    ``sigma^2 + min(rate silence, range)^2``.  The range of an angle is at most a turn.
    """
    way = np.minimum(run.steepest * max(silent_s, 0.0), run.spread)
    return np.hypot(sigma, way)


class AnchorNow:
    """Re-anchors frames at their own instant, if the machine's motion is given from an anchor; else leaves them."""

    def __init__(self, run: ModelRun, machine_name: str) -> None:
        self._motion = catalogue_entry(machine_name).capabilities.anchored_motion
        self._linkage = run.bank.compiled.layout.places.linkage
        self._model: Any = run.bank.compiled.models.linkage

    def restated(self, row: Array, step: int) -> Array:
        """Return a frame of the same motion, with its anchor at this step."""
        if self._motion is None:
            return row
        found: Array = row.copy()
        self._motion.anchor_at(self._model, found[self._linkage :], step)
        return found


class RegimeByAngle:
    """Regimes of the settled run as a function of the angle.

    Parameters
    ----------
    angle : int or None
        Index of the crank angle; None without one.
    has_body : bool
        Whether the regimes come from the contact of a body, which is not a function of the angle.
    """

    def __init__(self, run: ModelRun, angle: int | None, *, has_body: bool) -> None:
        self._place = run.bank.columns["linkage.regime"]
        self._angle = angle
        rows = run.settled
        self.in_use = angle is not None and not has_body and bool(np.ptp(rows[:, self._place]) > 0.0)
        if not self.in_use:
            return
        phases = np.mod(rows[:, angle], TURN)
        order = np.argsort(phases)
        self._phases, self._regimes = phases[order], rows[order, self._place]

    def repaired(self, row: Array) -> Array:
        """Return a frame with the regime of its angle; unchanged if that is not unique."""
        if not self.in_use:
            return row
        at = int(np.searchsorted(self._phases, row[self._angle] % TURN))
        around = self._regimes[np.arange(at - AROUND, at + AROUND) % len(self._regimes)]
        if np.ptp(around) > 0.0 or around[0] == row[self._place]:
            return row
        repaired: Array = row.copy()
        repaired[self._place] = around[0]
        return repaired

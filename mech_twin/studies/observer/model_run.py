# SPDX-License-Identifier: Apache-2.0
"""Simulated run of the model, with all columns: for locking on, and for the scales of the columns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mech_twin.engine.compiled_run import Indices
from mech_twin.engine.rollout import roll_out
from mech_twin.engine.sample_vectors import Array
from mech_twin.measurements.machine_columns import is_angle
from mech_twin.roles import Machine
from mech_twin.studies.observer.step_bank import StepBank

SETTLED_SHARE = 0.4  # of the run, at its end, from which scales are computed
SMALLEST = 1e-9  # lower bound of a scale, against division by 0


@dataclass(frozen=True)
class ModelRun:
    """Rows of a simulated run, one for each coupling step from step 0.

    Attributes
    ----------
    bank : StepBank
        The compiled machine.
    rows : ndarray, shape (steps + 1, w)
        All columns of each frame.
    """

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
        spread[self.angles] = np.minimum(spread[self.angles], 2.0 * np.pi)
        return spread

    @cached_property
    def steepest(self) -> Array:
        """Largest rate of change of each column in the settled rows (per s), shape (w,); angles are unwrapped."""
        rises = np.diff(self.settled, axis=0)
        rises[:, self.angles] = without_turns(rises[:, self.angles])
        steepest: Array = np.abs(rises).max(axis=0) / self.bank.step_s
        return steepest

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
    wrapped: Array = difference - 2.0 * np.pi * np.round(difference / (2.0 * np.pi))
    return wrapped


def held_sigma(run: ModelRun, sigma: Array, silent_s: float) -> Array:
    """Return the standard deviation of a held estimate, shape (w,).

    The error grows with the largest rate of change of a column, up to its range: the variance is
    ``sigma^2 + min(rate silence, range)^2``.  The range of an angle is at most a turn.

    Parameters
    ----------
    run : ModelRun
        Simulated run of the model, for ranges and rates.
    sigma : ndarray, shape (w,)
        Standard deviation at the last sample.
    silent_s : float
        Time since the last sample.
    """
    way = np.minimum(run.steepest * max(silent_s, 0.0), run.spread)
    held: Array = np.hypot(sigma, way)
    return held

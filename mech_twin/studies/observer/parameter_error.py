# SPDX-License-Identifier: Apache-2.0
"""Effect of wrong parameters on the columns of a frame: standard deviation by phase, from perturbed models.

For each uncertain key, a model with that key changed by its standard deviation takes one step from frames of the
unchanged model's run; the differences of the resulting frames are the effect of the key.  Keys are independent, so
their variances add.  The filter propagates the signed effect of one step over many steps, with its cross-covariance
with the state (`filter_state`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mech_twin.capabilities.faults import value_at
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.compiled_steps import DONE, Indices
from mech_twin.engine.sample_vectors import Array
from mech_twin.parameters.errors import keys
from mech_twin.roles import Machine
from mech_twin.studies.observer.model_run import ModelRun, StepBank, without_turns

BINS = 64  # of the crank angle over a turn
FRAMES = 256  # of the model's run that are evaluated
OF_FORCES = ("kg", "kg m2", "kg/m3", "N", "N/m", "N m", "N m/rad", "N m s", "N m s/rad")  # units of uncertain keys


@dataclass(frozen=True)
class ParameterError:
    """Variance and effect of uncertain keys on each column, by phase.

    Attributes
    ----------
    variance : ndarray, shape (bins, w)
        Variance in each bin of the angle; one bin without an angle.
    effect : ndarray, shape (bins, w, q)
        Effect of one standard deviation of each key on each column in a step, averaged over the bin; steps with an
        event are left out, since the event may fall into another step with the changed key.
    angle : int or None
        Index of the angle in a row.
    keys : tuple of str
        The q uncertain keys.
    """

    variance: Array
    effect: Array
    angle: int | None
    keys: tuple[str, ...]

    def at(self, row: Array) -> Array:
        """Return the variance of each column of a frame, shape (w,)."""
        return np.asarray(self.variance[self._bin(row)])

    def effect_at(self, row: Array) -> Array:
        """Return the effect of one standard deviation of each key on each column in a step, shape (w, q)."""
        return np.asarray(self.effect[self._bin(row)])

    def _bin(self, row: Array) -> int:
        return int(_bins(row[None, :], self.angle, len(self.variance))[0])


def uncertain_keys(parameters: Parameters, share: float) -> dict[str, float]:
    """Return the standard deviation of every key of a mass, force, stiffness or friction: this share of its value."""
    numbers = {
        key.name: key.value for key in keys(parameters) if key.unit in OF_FORCES and isinstance(key.value, float)
    }
    return {name: share * abs(value) for name, value in numbers.items() if value != 0.0 and np.isfinite(value)}


def parameter_error(
    run: ModelRun,
    parameters: Parameters,
    build: Callable[[Parameters], Machine],
    deviations: Mapping[str, float],
    angle: int | None,
) -> ParameterError:
    """Return the variance and effect of wrong parameters on each column.

    Parameters
    ----------
    deviations : mapping
        Standard deviation of each uncertain key, in its unit; keys whose changed value is rejected are left out.
    """
    first = len(run.rows) - len(run.settled)
    steps = np.unique(np.linspace(first, len(run.rows) - 2, FRAMES).astype(int))
    plain, plain_events = _stepped(run.bank, run, steps)
    count = BINS if angle is not None else 1
    bins = _bins(run.rows[steps + 1], angle, count)
    total, kept_keys, effects = np.zeros_like(plain), [], []
    for key, deviation in deviations.items():
        changed = _changed(parameters, build, key, deviation)
        if changed is None:
            continue
        later, events = _stepped(StepBank(changed), run, steps)
        difference = later - plain
        difference[:, run.angles] = without_turns(difference[:, run.angles])
        difference = np.nan_to_num(difference)
        total += difference**2
        effects.append(_mean_by_bin(difference, bins, count, (events == 0) & (plain_events == 0)))
        kept_keys.append(key)
    effect = np.stack(effects, axis=-1) if effects else np.zeros((count, plain.shape[1], 0))
    return ParameterError(_largest_by_bin(total, bins, count), effect, angle, tuple(kept_keys))


def _changed(
    parameters: Parameters, build: Callable[[Parameters], Machine], key: str, deviation: float
) -> Machine | None:
    """Return the machine with a key raised, or lowered if that is rejected; None if both are."""
    changed = changed_parameters(parameters, key, deviation)
    try:
        return None if changed is None else build(changed)
    except ValueError:
        return None


def changed_parameters(parameters: Parameters, key: str, deviation: float) -> Parameters | None:
    """Return the parameters with a key raised, or lowered if that is rejected; None if both are."""
    for sign in (1.0, -1.0):
        try:
            return varied(parameters, {key: value_at(parameters, key) + sign * deviation})
        except ValueError:
            continue
    return None


def _stepped(bank: StepBank, run: ModelRun, steps: Indices) -> tuple[Array, Indices]:
    """Return the rows (steps, w) that these steps of the run lead to, nan for a failed one; and numbers of events."""
    command = bank.columns["motor.command"]
    found, events = np.full((len(steps), run.rows.shape[1]), np.nan), np.zeros(len(steps), dtype=np.int64)
    for i, step in enumerate(steps.tolist()):
        later = bank.advanced(step, run.rows[step : step + 1], float(run.rows[step + 1, command]))
        events[i] = later.event_counts[0]
        if later.failed[0] == DONE:
            found[i] = later.rows[0]
    return found, events


def _bins(rows: Array, angle: int | None, count: int) -> Indices:
    if angle is None:
        return np.zeros(len(rows), dtype=np.int64)
    turns: Array = np.mod(rows[:, angle] / (2.0 * np.pi), 1.0)
    return np.minimum((turns * count).astype(np.int64), count - 1)


def _largest_by_bin(squares: Array, bins: Indices, count: int) -> Array:
    """Return the largest square in each bin; a bin without a frame has the largest of all."""
    found = np.tile(squares.max(axis=0), (count, 1))
    for i in np.unique(bins).tolist():
        found[i] = squares[bins == i].max(axis=0)
    return found


def _mean_by_bin(differences: Array, bins: Indices, count: int, used: Array) -> Array:
    """Return the mean of the used differences in each bin; 0 in a bin without any."""
    found = np.zeros((count, differences.shape[1]))
    for i in np.unique(bins[used]).tolist():
        found[i] = differences[used & (bins == i)].mean(axis=0)
    return found

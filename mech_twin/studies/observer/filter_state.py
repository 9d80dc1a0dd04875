# SPDX-License-Identifier: Apache-2.0
"""Extended Kalman filter on the machine's own steps: state and covariance in sizes of the state, one step at a time.

The filter stands at the frame *before* the sample, with the process noise of the step already in its covariance. A
sample is compared with the frame the machine's roles arrive at from there, corrects the state before, and the roles
take the step anew.  So an estimated frame is always one that the roles computed: forces, dependent joints and contacts
fit each other, and nothing is put together afterwards.

Keys of the configuration that are wrong stay so: they are no noise.  What each does to a step is added to the state
together with what it did before, as the covariance of state and keys, which the correction takes into account without
correcting the keys (SchmidtApplication1966).

Jacobians are differences of neighbouring roll-outs of one step.  Neighbours of a step with an impact have the impact
too, at their own instants, so their differences hold the jump of the covariance at an impact (the saltation matrix)
without it being written down. A neighbour that misses an event of the step is replaced by the one on the other side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_run import DONE, Indices
from mech_twin.engine.errors import MotionError
from mech_twin.engine.sample_vectors import Array
from mech_twin.samples import Event
from mech_twin.studies.observer.model_run import without_turns
from mech_twin.studies.observer.state_space import StateSpace
from mech_twin.studies.observer.step_bank import StepBank

CHANGE = 1e-6  # of a state's size, for differences
GATE = 25.0  # squared innovation over its variance from which a sample is not used


class FilterState(NamedTuple):
    """Frame at ``step``, offsets of the drive, covariance (in sizes of the state) with the next step's noise in it.

    ``with_keys`` (n + k, q) is the covariance of the state and the uncertain keys, each in its standard deviation.
    """

    step: int
    row: Array
    offsets: Array
    covariance: Array
    with_keys: Array


class Prediction(NamedTuple):
    """The frame one step later, its derivatives by the state before (w, n + k), and the events on the way."""

    row: Array
    slopes: Array
    events: tuple[Event, ...]


class Observation(NamedTuple):
    """Channels that came together: places in a row, values, variances, and time after the predicted frame (s).

    The variances are those of everything but the state, the effect (w, q) of the uncertain keys included.
    """

    places: Indices
    values: Array
    variances: Array
    after_s: Array


class Correction(NamedTuple):
    """Filter after a sample: state before the step, the frame again, innovations, and which channels were used."""

    state: FilterState
    prediction: Prediction
    innovations: Array
    used: Array


class SaltedFilter:
    """The filter's two maps, prediction and correction; what they return is all there is.

    Parameters
    ----------
    bank : StepBank
        The machine.
    space : StateSpace
        Its state.
    angles : ndarray of int
        Places of columns that are angles.
    """

    def __init__(self, bank: StepBank, space: StateSpace, angles: Indices) -> None:
        self._bank, self._space, self._angles = bank, space, angles
        self._led = np.flatnonzero(np.isfinite(space.led))
        self._unit = np.eye(len(space.places))
        self._is_angle = np.zeros(len(bank.columns), dtype=bool)
        self._is_angle[angles] = True

    def predicted(self, state: FilterState, target: float) -> Prediction:
        """Return the frame one step after a state.

        Raises
        ------
        MotionError
            The roles cannot follow the motion.
        """
        size = len(self._space.places)
        bank = np.repeat(self._begun(state)[None, :], size + 1, axis=0)
        change = CHANGE * self._space.scales
        bank[1:] += change[:, None] * self._space.directions
        later = self._bank.advanced(state.step, bank, target)
        if later.failed[0] != DONE:
            raise MotionError(f"the estimated motion cannot be followed at step {state.step}")
        rows = self._with_offsets(later.rows, state.offsets, CHANGE)
        slopes = self._differences(rows) / CHANGE
        beside = np.flatnonzero((later.told[1:] != later.told[0]) | (later.failed[1:] != DONE))
        for i in beside.tolist():
            slopes[:, i] = self._other_side(state, target, i, rows[0], int(later.told[0]))
        return Prediction(rows[0], slopes, self._bank.events(later.events))

    def again(self, state: FilterState, target: float, slopes: Array) -> Prediction:
        """Return the frame one step after a state, with derivatives that are known."""
        later = self._bank.advanced(state.step, self._begun(state)[None, :], target)
        if later.failed[0] != DONE:
            raise MotionError(f"the estimated motion cannot be followed at step {state.step}")
        rows = self._with_offsets(later.rows, state.offsets, 0.0)
        return Prediction(rows[0], slopes, self._bank.events(later.events))

    def corrected(
        self, state: FilterState, prediction: Prediction, seen: Observation, effect: Array, rates: Array, target: float
    ) -> Correction:
        """Return the state that agrees better with a sample, and the step from there.

        Parameters
        ----------
        effect : ndarray, shape (w, q)
            Of the uncertain keys on the columns in this step.
        rates : ndarray, shape (w,)
            Rates of change of the columns (per s), which carry the frame to the sample's own instant.
        """
        expected = prediction.row[seen.places] + rates[seen.places] * seen.after_s
        innovations = seen.values - expected
        wrapped = self._is_angle[seen.places]
        innovations[wrapped] = without_turns(innovations[wrapped])
        slopes, by_keys = prediction.slopes[seen.places], effect[seen.places]
        crossed = ((slopes @ state.with_keys) * by_keys).sum(axis=1)
        own = ((slopes @ state.covariance) * slopes).sum(axis=1) + 2.0 * crossed + seen.variances
        with np.errstate(over="ignore"):  # what is too far off to be squared is beyond the gate
            used = innovations**2 <= GATE * own
        if not used.any():
            return Correction(state, prediction, innovations, used)
        h, d = slopes[used], by_keys[used]
        alone = np.diag(np.maximum(seen.variances[used] - (d * d).sum(axis=1), 0.0)) + d @ d.T
        common = state.covariance @ h.T + state.with_keys @ d.T
        mixed = h @ state.with_keys @ d.T
        whole = h @ state.covariance @ h.T + mixed + mixed.T + alone
        gain = np.linalg.solve(whole, common.T).T
        rest = self._unit - gain @ h
        crossing = rest @ state.with_keys @ (gain @ d).T
        covariance = rest @ state.covariance @ rest.T - crossing - crossing.T + gain @ alone @ gain.T
        with_keys = rest @ state.with_keys - gain @ d
        moved = self._moved(state, gain @ innovations[used], 0.5 * (covariance + covariance.T), with_keys)
        return Correction(moved, self.again(moved, target, prediction.slopes), innovations, used)

    def committed(self, state: FilterState, prediction: Prediction, noise: Array, effect: Array) -> FilterState:
        """Return the filter at the predicted frame, the process noise of the next step (n + k, n + k) added.

        The uncertain keys act on the step by ``effect`` (w, q).
        """
        size, scales = self._space.states, self._space.scales
        transition = self._unit.copy()
        transition[:size] = self._space.signs[:, None] * prediction.slopes[self._space.later] / scales[:size, None]
        pushed = np.zeros_like(state.with_keys)
        pushed[:size] = self._space.signs[:, None] * effect[self._space.later] / scales[:size, None]
        carried = transition @ state.with_keys
        crossed = carried @ pushed.T
        covariance = transition @ state.covariance @ transition.T + crossed + crossed.T + pushed @ pushed.T + noise
        row = prediction.row.copy()
        row[self._space.input_places] -= state.offsets
        return FilterState(state.step + 1, row, state.offsets, 0.5 * (covariance + covariance.T), carried + pushed)

    def _begun(self, state: FilterState) -> Array:
        row = state.row.copy()
        self._put_in_drive(row[None, :], state.offsets)
        return row

    def _put_in_drive(self, rows: Array, offsets: Array) -> None:
        """Put the drive as it is, offsets included, in place of the model's.

        A prescribed speed is that of the command: the model's own approaches it from the speed the machine has, which
        would bring the machine back to rated speed in one step.
        """
        space, led = self._space, self._led
        if len(led):
            rows[:, space.input_places[led]] = rows[:, space.command, None] * space.led[led]
        if len(offsets):
            rows[:, space.input_places] += offsets

    def _with_offsets(self, rows: Array, offsets: Array, change: float) -> Array:
        """Return frames whose motors tell what the drive does, offsets included; row 1 + i has input i changed."""
        places, states = self._space.input_places, self._space.states
        self._put_in_drive(rows, offsets)
        for i, place in enumerate(places.tolist()):
            if len(rows) > 1:
                rows[1 + states + i, place] += change * self._space.scales[states + i]
        return rows

    def _differences(self, rows: Array) -> Array:
        difference: Array = rows[1:] - rows[0]
        difference[:, self._angles] = without_turns(difference[:, self._angles])
        return difference.transpose()

    def _other_side(self, state: FilterState, target: float, i: int, row: Array, told: int) -> Array:
        """Return derivatives by the difference to the other side; those of no change where that fails too."""
        bank = self._begun(state)[None, :]
        bank[0] -= CHANGE * self._space.scales[i] * self._space.directions[i]
        later = self._bank.advanced(state.step, bank, target)
        rows = self._with_offsets(later.rows, state.offsets, 0.0)
        if i >= self._space.states:
            rows[0, self._space.places[i]] -= CHANGE * self._space.scales[i]
        if later.failed[0] == DONE and int(later.told[0]) == told:
            beside: Array = self._differences(np.vstack([rows[0], row]))[:, 0] / CHANGE
            return beside
        slopes = np.zeros(len(row))
        slopes[self._space.places[i]] = self._space.scales[i]
        if i < self._space.states:
            slopes[self._space.later[i]] = self._space.signs[i] * self._space.scales[i]
        return slopes

    def _moved(self, state: FilterState, by: Array, covariance: Array, with_keys: Array) -> FilterState:
        states, scales = self._space.states, self._space.scales
        row = state.row.copy()
        row += (by[:states] * scales[:states]) @ self._space.directions[:states]
        row[self._space.state_places] = np.maximum(row[self._space.state_places], self._space.least)
        return FilterState(state.step, row, state.offsets + by[states:] * scales[states:], covariance, with_keys)


def output_variance(prediction: Prediction, state: FilterState, effect: Array, by_keys: Array) -> Array:
    """Return the variance of each column of a predicted frame.

    Parameters
    ----------
    prediction : Prediction
        The frame.
    state : FilterState
        The filter before the step.
    effect : ndarray, shape (w, q)
        Of the uncertain keys on the columns in this step.
    by_keys : ndarray, shape (w,)
        Variance of the columns by the uncertain keys in this step alone, at least the sum of the squared effects.
    """
    spread = ((prediction.slopes @ state.covariance) * prediction.slopes).sum(axis=1)
    crossed = ((prediction.slopes @ state.with_keys) * effect).sum(axis=1)
    found: Array = np.maximum(spread + 2.0 * crossed + by_keys, 0.0)
    return found


def observation(
    places: Sequence[int], values: Sequence[float], variances: Sequence[float], after_s: Sequence[float]
) -> Observation:
    """Return channels as arrays."""
    return Observation(
        np.array(places, dtype=np.int64), np.array(values, float), np.array(variances, float), np.array(after_s, float)
    )

# SPDX-License-Identifier: Apache-2.0
"""Extended Kalman filter on the machine's own coupling steps; state and covariance are in scales of the state.

The filter holds the frame one step *before* the sample, with the process noise of the step in its covariance.  The
sample is compared with the frame that the machine's roles compute from it, and corrects the state before the step,
which is then computed again.  So every estimated frame is one that the roles computed: its forces, dependent joints and
contacts are consistent.

Errors of configuration keys are constant, not noise.  Their effects accumulate over the steps as the cross-covariance
of state and keys, which the correction includes without correcting the keys (SchmidtApplication1966).

Jacobians are differences of perturbed simulations of one step.  The perturbed simulations of a step with an impact have
the impact too, at their own instants, so their differences contain the saltation matrix of the impact.  A perturbation
with another number of events is replaced by the one in the opposite direction.

The state of a machine is found numerically: the columns of a frame whose change affects the next frame's motion.
Dependent joints are computed anew in each step, so changing them has no effect.  The motor's speed or torque affects
the next step; an unknown offset of the drive is added to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.compiled_steps import DONE, Indices
from mech_twin.engine.sample_vectors import Array
from mech_twin.errors import MotionError
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import AnchoredMotion
from mech_twin.samples import Event
from mech_twin.studies.observer.model_run import BankStep, ModelRun, StepBank, without_turns

PROBES = 12  # rows of the settled run in which columns are perturbed
CHANGE = 1e-6  # perturbation, in scales of the column
EFFECT = 1e-5  # least effect on the motion, relative to the perturbation, for a column to be a state
NO_ANCHOR = AnchoredMotion({}, "", "", (), lambda model, row, step: None)
WHOLE = 1e-2  # tolerance for a gear ratio to be an integer, with the twist of couplings


@dataclass(frozen=True)
class StateSpace:
    """State and unknown inputs of the drive, with the scale of each.

    Attributes
    ----------
    names : tuple of str
        Names of the n state columns, then of the k inputs.
    places : ndarray, shape (n + k,)
        Their indices in a row.
    states : int
        Number n of states, which come first.
    scales : ndarray, shape (n + k,)
        Their scales; 1 rad for angles.
    led : ndarray, shape (k,)
        Speed of each input at full command if the drive prescribes the speed; nan for a torque.
    command : int
        Index of the command in force.
    later : ndarray, shape (n,)
        Indices of the columns that hold the states one step later.
    signs : ndarray, shape (n,)
        Signs of the states in these columns.
    directions : ndarray, shape (n + k, w)
        Change of a row for a change of each by 1.
    least : ndarray, shape (n,)
        Lower bound of each state.
    of_time : ndarray of bool, shape (n + k,)
        Marks the step number from which an anchor's time counts.
    """

    names: tuple[str, ...]
    places: Indices
    states: int
    scales: Array
    led: Array
    command: int
    later: Indices
    signs: Array
    directions: Array
    least: Array
    of_time: Array

    @property
    def state_places(self) -> Indices:
        """Indices of the state columns in a row."""
        return self.places[: self.states]

    @property
    def input_places(self) -> Indices:
        """Indices of the motor columns that an offset is added to."""
        return self.places[self.states :]


def state_space(run: ModelRun, machine_name: str) -> StateSpace:
    """Return the state space of a machine.

    Raises
    ------
    ConfigurationError
        No column of a frame affects the next frame.
    """
    columns = run.bank.columns
    joints = [name for name in columns if name.endswith((".position", ".velocity"))]
    mechanism_joints = [name for name in joints if not name.startswith("motor.")]
    anchored = catalogue_entry(machine_name).capabilities.anchored_motion or NO_ANCHOR
    states = _acting(run, [*mechanism_joints, *anchored.later])
    if not states:
        raise ConfigurationError(
            f"{machine_name}: no number of a frame changes the next frame; expected a running machine"
        )
    drive = [name for name in columns if name.startswith("motor.") and name.endswith((".velocity", ".effort"))]
    inputs = [name for name in _acting(run, drive) if name.endswith(".velocity") or not _carried(run, [name])]
    names = (*states, *inputs)
    places = np.array([columns[name] for name in names], dtype=np.int64)
    led = np.array([_speed_at_full_command(run, name) for name in inputs])
    later = [anchored.later.get(name, (name, 1.0)) for name in states]
    return StateSpace(
        names,
        places,
        len(states),
        _sizes(run)[places],
        led,
        columns["motor.command"],
        np.array([columns[name] for name, _ in later], dtype=np.int64),
        np.array([sign for _, sign in later]),
        _directions(run, names, anchored),
        np.array([0.0 if name in anchored.not_below_zero else -np.inf for name in states]),
        np.array([name == anchored.origin for name in names]),
    )


def _directions(run: ModelRun, names: Sequence[str], anchored: AnchoredMotion) -> Array:
    """Return the change of a row for a change of each state by 1; moving the origin of time also shifts the time."""
    columns = run.bank.columns
    found = np.zeros((len(names), len(columns)))
    for i, name in enumerate(names):
        found[i, columns[name]] = 1.0
        if name == anchored.origin:
            found[i, columns[anchored.tau]] = -run.bank.step_s
    return found


def _speed_at_full_command(run: ModelRun, name: str) -> float:
    """Return the prescribed speed at full command; nan for a torque."""
    if not name.endswith(".velocity"):
        return float("nan")
    row = run.settled[-1]
    return float(row[run.bank.columns[name]] / row[run.bank.columns["motor.command"]])


def undetermined(run: ModelRun, space: StateSpace) -> Indices:
    """Return the indices of columns that cannot be estimated for a machine with an unknown past.

    These are accumulated quantities such as sums, which are not states, and angles geared to the crank by a non-integer
    ratio, which depend on the number of its turns.
    """
    states = set(space.places.tolist())
    names = [name for name, place in run.bank.columns.items() if name != "time_s" and place not in states]
    places = {run.bank.columns[name] for name in _carried(run, names)} | _geared(run, space)
    return np.array(sorted(places), dtype=np.int64)


def leading_angle(run: ModelRun, space: StateSpace) -> int | None:
    """Return the index of the angle that defines the phase, the first of the state; None without one."""
    return next((place for place in space.state_places.tolist() if place in run.angles), None)


def _geared(run: ModelRun, space: StateSpace) -> set[int]:
    """Return the indices of angles geared to the first angle of the state by a non-integer ratio."""
    angles = run.angles.tolist()
    leading = leading_angle(run, space)
    if leading is None:
        return set()
    way = without_turns(np.diff(run.settled[:, angles], axis=0)).sum(axis=0)
    ratio = way / way[angles.index(leading)]
    turning = np.abs(way) > 2.0 * np.pi
    return set(run.angles[turning & (np.abs(ratio - np.round(ratio)) > WHOLE)].tolist())


def _carried(run: ModelRun, names: list[str]) -> list[str]:
    """Return the columns that keep a change of their own value over a step."""
    columns, sizes = run.bank.columns, _sizes(run)
    step = len(run.rows) - 2
    bank = np.tile(run.rows[step], (len(names) + 1, 1))
    places = np.array([columns[name] for name in names])
    changes = CHANGE * sizes[places]
    bank[np.arange(1, len(names) + 1), places] += changes
    later = run.bank.advanced(step, bank, float(run.rows[step + 1, columns["motor.command"]]))
    kept = np.abs(later.rows[np.arange(1, len(names) + 1), places] - later.rows[0, places]) > 0.5 * changes
    return [name for name, held in zip(names, kept.tolist(), strict=True) if held]


def _sizes(run: ModelRun) -> Array:
    """Return the scale of each column: its largest magnitude, 1 rad for an angle."""
    sizes: Array = np.maximum(np.abs(run.settled).max(axis=0), run.spread)
    sizes[run.angles] = 1.0
    sizes[[place for name, place in run.bank.columns.items() if name.endswith(".origin_step_1")]] = 1.0
    return sizes


def _acting(run: ModelRun, names: list[str]) -> list[str]:
    columns, sizes = run.bank.columns, _sizes(run)
    motion = np.array(
        [i for name, i in columns.items() if name.endswith((".position", ".velocity")) and name[:6] != "motor."]
    )
    moving = motion[np.ptp(run.settled[:, motion], axis=0) > 0.0]
    first = len(run.rows) - len(run.settled)
    effect = np.zeros(len(names))
    for step in np.linspace(first, len(run.rows) - 2, PROBES).astype(int).tolist():
        bank = np.tile(run.rows[step], (len(names) + 1, 1))
        for i, name in enumerate(names):
            bank[i + 1, columns[name]] += CHANGE * sizes[columns[name]]
        later = run.bank.advanced(step, bank, float(run.rows[step + 1, columns["motor.command"]]))
        difference = later.rows[1:] - later.rows[0]
        difference[:, run.angles] = without_turns(difference[:, run.angles])
        usable = (later.failed[1:] == DONE) & (later.event_counts[1:] == later.event_counts[0])
        size = np.abs(difference[:, moving] / sizes[moving]).max(axis=1, initial=0.0)
        effect = np.maximum(effect, np.where(usable, size, 0.0))
    return [name for name, size in zip(names, effect.tolist(), strict=True) if size > EFFECT * CHANGE]


GATE = 25.0  # squared innovation over its variance above which a sample is rejected


class FilterState(NamedTuple):
    """Frame at ``step``, offsets of the drive, and the scaled covariance, with the next step's noise included.

    ``with_keys`` (n + k, q) is the cross-covariance of state and uncertain keys, keys in standard deviations.
    """

    step: int
    row: Array
    offsets: Array
    covariance: Array
    with_keys: Array


class Prediction(NamedTuple):
    """The frame one step later, its derivatives by the scaled state before (w, n + k), and the events in the step."""

    row: Array
    slopes: Array
    events: tuple[Event, ...]


class Observation(NamedTuple):
    """Channels of one sample: indices in a row, values, variances, and time after the predicted frame (s).

    The variances include sensor noise and the effect (w, q) of the uncertain keys, but not the state.
    """

    places: Indices
    values: Array
    variances: Array
    after_s: Array


class Correction(NamedTuple):
    """Filter after a sample: state before the step, corrected prediction, innovations with sigma, mask of used ones.

    Used are those within the gate.  A correction after which no step can begin is left out.
    """

    state: FilterState
    prediction: Prediction
    innovations: Array
    sigma: Array
    used: Array


class SaltedFilter:
    """Prediction and correction of the filter, as functions without internal state."""

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
            The roles cannot compute the step.
        """
        size = len(self._space.places)
        bank = np.repeat(self._begun(state)[None, :], size + 1, axis=0)
        change = CHANGE * self._space.scales
        bank[1:] += change[:, None] * self._space.directions
        later, rows = self._stepped(state, target, bank, CHANGE)
        slopes = self._differences(rows) / CHANGE
        beside = np.flatnonzero((later.event_counts[1:] != later.event_counts[0]) | (later.failed[1:] != DONE))
        for i in beside.tolist():
            slopes[:, i] = self._other_side(state, target, i, rows[0], int(later.event_counts[0]))
        return Prediction(rows[0], slopes, self._bank.events(later.events))

    def _stepped(self, state: FilterState, target: float, bank: Array, change: float) -> tuple[BankStep, Array]:
        """Return frames advanced by a step, and their rows with the offsets of the drive."""
        later = self._bank.advanced(state.step, bank, target)
        if later.failed[0] != DONE:
            raise MotionError(f"the estimated motion cannot be computed at step {state.step}")
        return later, self._with_offsets(later.rows, state.offsets, change)

    def corrected(
        self, state: FilterState, prediction: Prediction, seen: Observation, effect: Array, rates: Array, target: float
    ) -> Correction:
        """Return the state corrected by a sample, and the step computed again from it.

        Parameters
        ----------
        effect : ndarray, shape (w, q)
            Effect of one standard deviation of each uncertain key on the columns in this step.
        rates : ndarray, shape (w,)
            Rates of change of the columns (per s), to extrapolate the frame to the sample's instant.
        """
        expected = prediction.row[seen.places] + rates[seen.places] * seen.after_s
        innovations = seen.values - expected
        wrapped = self._is_angle[seen.places]
        innovations[wrapped] = without_turns(innovations[wrapped])
        slopes, by_keys = prediction.slopes[seen.places], effect[seen.places]
        crossed = ((slopes @ state.with_keys) * by_keys).sum(axis=1)
        own = ((slopes @ state.covariance) * slopes).sum(axis=1) + 2.0 * crossed + seen.variances
        with np.errstate(over="ignore"):  # an innovation whose square overflows is rejected
            used = innovations**2 <= GATE * own
        if not used.any():
            return Correction(state, prediction, innovations, np.sqrt(own), used)
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
        try:
            later, rows = self._stepped(moved, target, self._begun(moved)[None, :], 0.0)
        except MotionError:  # moved away from where a contact or friction holds it: no step of the machine begins there
            return Correction(state, prediction, innovations, np.sqrt(own), used)
        again = Prediction(rows[0], prediction.slopes, self._bank.events(later.events))
        return Correction(moved, again, innovations, np.sqrt(own), used)

    def committed(self, state: FilterState, prediction: Prediction, noise: Array, effect: Array) -> FilterState:
        """Return the filter at the predicted frame, with the process noise (n + k, n + k) of the next step added.

        ``effect`` (w, q) is that of the uncertain keys on the step.
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
        """Replace the model's drive values by the actual ones, offsets included.

        A prescribed speed is set to that of the command: the model's would approach it from the machine's present speed
        and return the machine to rated speed in one step.
        """
        space, led = self._space, self._led
        if len(led):
            rows[:, space.input_places[led]] = rows[:, space.command, None] * space.led[led]
        if len(offsets):
            rows[:, space.input_places] += offsets

    def _with_offsets(self, rows: Array, offsets: Array, change: float) -> Array:
        """Return frames with the actual motor values, offsets included; row 1 + n + i has input i perturbed."""
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

    def _other_side(self, state: FilterState, target: float, i: int, row: Array, event_count: int) -> Array:
        """Return derivatives by a difference in the opposite direction; if that fails, those of a constant state."""
        bank = self._begun(state)[None, :]
        bank[0] -= CHANGE * self._space.scales[i] * self._space.directions[i]
        later = self._bank.advanced(state.step, bank, target)
        rows = self._with_offsets(later.rows, state.offsets, 0.0)
        if i >= self._space.states:
            rows[0, self._space.places[i]] -= CHANGE * self._space.scales[i]
        if later.failed[0] == DONE and int(later.event_counts[0]) == event_count:
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
    """Return the variance of each column of a predicted frame, shape (w,).

    Parameters
    ----------
    by_keys : ndarray, shape (w,)
        Variance of the columns due to uncertain keys in this step alone, at least the sum of the squared effects.
    """
    spread = ((prediction.slopes @ state.covariance) * prediction.slopes).sum(axis=1)
    crossed = ((prediction.slopes @ state.with_keys) * effect).sum(axis=1)
    return np.asarray(np.maximum(spread + 2.0 * crossed + by_keys, 0.0))

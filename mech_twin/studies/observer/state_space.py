# SPDX-License-Identifier: Apache-2.0
"""Finds the state of a machine numerically: the columns of a frame whose change affects the next frame's motion.

Dependent joints are computed anew in each step, so changing them has no effect.  The motor's speed or torque affects
the next step; an unknown offset of the drive is added to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.compiled_steps import DONE, Indices
from mech_twin.engine.sample_vectors import Array
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import AnchoredMotion
from mech_twin.studies.observer.model_run import ModelRun, without_turns

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
            f"{machine_name}: no number of a frame acts on the next one; expected a running machine"
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


def _geared(run: ModelRun, space: StateSpace) -> set[int]:
    """Return the indices of angles geared to the first angle of the state by a non-integer ratio."""
    angles = run.angles.tolist()
    leading = next((int(place) for place in space.state_places if int(place) in angles), None)
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

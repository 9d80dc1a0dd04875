# SPDX-License-Identifier: Apache-2.0
"""Which numbers of a frame are its state, found by asking: a number is one if the next frame's motion follows from it.

The dependent joints of a frame are written anew each step, so changing them changes nothing; the motor's speed or
torque acts on the next step and is where an unknown offset of the drive is put.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mech_twin.capabilities.anchored_motion import AnchoredMotion
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.compiled_run import DONE, Indices
from mech_twin.engine.sample_vectors import Array
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.observer.model_run import ModelRun, without_turns

PROBES = 12  # rows of the settled run in which columns are changed
CHANGE = 1e-6  # of a column's size
EFFECT = 1e-5  # of that change, in the size of the motion it causes, from which on a column counts
NO_ANCHOR = AnchoredMotion({}, "", "", (), lambda model, row, step: None)
WHOLE = 1e-2  # a gear ratio this near to a whole number is one, a coupling's twist included


@dataclass(frozen=True)
class StateSpace:
    """State and unknown inputs of the drive, each with its size.

    Attributes
    ----------
    names : tuple of str
        Columns of the state, then of the inputs.
    places : ndarray, shape (n + k,)
        Their places in a row.
    states : int
        How many of them, the first ones, are state.
    scales : ndarray, shape (n + k,)
        Their sizes; angles have 1 rad.
    led : ndarray, shape (k,)
        Speed of each input at full command where the drive leads the machine at a prescribed speed; nan of a torque.
    command : int
        Place of the command in force.
    later : ndarray, shape (n,)
        Places where the states stand in the frame one step later.
    signs : ndarray, shape (n,)
        With which sign they stand there.
    directions : ndarray, shape (n + k, w)
        What a change of each by 1 does to a row.
    least : ndarray, shape (n,)
        The least value each state can have.
    of_time : ndarray of bool, shape (n + k,)
        Which is the step from which the time of an anchor counts.
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
        """Places of the state."""
        return self.places[: self.states]

    @property
    def input_places(self) -> Indices:
        """Places of the motor's numbers that an offset is added to."""
        return self.places[self.states :]


def state_space(run: ModelRun, machine_name: str) -> StateSpace:
    """Return the state of a machine.

    Raises
    ------
    ConfigurationError
        Nothing of a frame has an effect on the next one.
    """
    columns = run.bank.columns
    joints = [name for name in columns if name.endswith((".position", ".velocity"))]
    told = [name for name in joints if not name.startswith("motor.")]
    anchored = catalogue_entry(machine_name).capabilities.anchored_motion or NO_ANCHOR
    states = _acting(run, [*told, *anchored.later])
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
    """Return what a change of each number does to a row; of the origin of time, that now has another time."""
    columns = run.bank.columns
    found = np.zeros((len(names), len(columns)))
    for i, name in enumerate(names):
        found[i, columns[name]] = 1.0
        if name == anchored.origin:
            found[i, columns[anchored.tau]] = -run.bank.step_s
    return found


def _speed_at_full_command(run: ModelRun, name: str) -> float:
    """Return the prescribed speed per unit of command; nan of a torque."""
    if not name.endswith(".velocity"):
        return float("nan")
    row = run.settled[-1]
    return float(row[run.bank.columns[name]] / row[run.bank.columns["motor.command"]])


def undetermined(run: ModelRun, space: StateSpace) -> Indices:
    """Return the places of numbers that cannot be told of a machine whose past is unknown.

    They go on from their own last value and are no state, such as sums. Or they are angles geared to the crank by a
    ratio that is no whole number, so that they depend on how many turns it has made.
    """
    states = set(space.places.tolist())
    names = [name for name, place in run.bank.columns.items() if name != "time_s" and place not in states]
    places = {run.bank.columns[name] for name in _carried(run, names)} | _geared(run, space)
    return np.array(sorted(places), dtype=np.int64)


def _geared(run: ModelRun, space: StateSpace) -> set[int]:
    """Return the angles that turn with the first angle of the state, at a ratio that is no whole number."""
    angles = run.angles.tolist()
    leading = next((int(place) for place in space.state_places if int(place) in angles), None)
    if leading is None:
        return set()
    way = without_turns(np.diff(run.settled[:, angles], axis=0)).sum(axis=0)
    ratio = way / way[angles.index(leading)]
    turning = np.abs(way) > 2.0 * np.pi
    return set(run.angles[turning & (np.abs(ratio - np.round(ratio)) > WHOLE)].tolist())


def _carried(run: ModelRun, names: list[str]) -> list[str]:
    """Return the numbers that keep a change of themselves over a step."""
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
    """Return the size of each column: its largest magnitude, 1 rad of an angle."""
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
        usable = (later.failed[1:] == DONE) & (later.told[1:] == later.told[0])
        size = np.abs(difference[:, moving] / sizes[moving]).max(axis=1, initial=0.0)
        effect = np.maximum(effect, np.where(usable, size, 0.0))
    return [name for name, size in zip(names, effect.tolist(), strict=True) if size > EFFECT * CHANGE]

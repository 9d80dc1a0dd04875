# SPDX-License-Identifier: Apache-2.0
"""Roll-outs by machine name, configuration and changed keys; one, or many in parallel on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import dataclass, fields
from functools import partial
from threading import Event
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mech_twin.capabilities.arguments import by_name, sequence_items
from mech_twin.declarations.captions import unit_of
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.coupling import Profile
from mech_twin.engine.rollout import RollOut, RunPlan, planned
from mech_twin.engine.sample_vectors import Array
from mech_twin.errors import StudyError
from mech_twin.measurements.columns import Columns
from mech_twin.measurements.units import shown_units
from mech_twin.parameters.live_change import live_numbers
from mech_twin.parameters.load import catalogue_entry, changed_configuration, machine_parameters
from mech_twin.process.dependencies import require_extra
from mech_twin.process.interruption import raising_interrupt
from mech_twin.roles import Machine, own_name
from mech_twin.samples import Frame
from mech_twin.studies.spreading import used_cores

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from matplotlib.figure import Figure

Change = tuple[float, Mapping[str, Any] | Parameters]
CHANGES = "pairs of time (s) and live keys with their values, or a configuration"


@dataclass(frozen=True, repr=False, kw_only=True)
class NamedRollOut(RollOut):
    """A roll-out with the name of its machine and the units of its columns.

    Attributes
    ----------
    units : mapping of str to str
        Unit of each column, empty for dimensionless ones.
    """

    name: str
    units: Mapping[str, str]

    @property
    def samples(self) -> Columns:
        """The columns as a table: ``to_pandas()``, ``to_arrow()``, ``plot()``."""
        name, times = own_name(self.name, self.machines[0][1].parameters), self.columns["time_s"]
        return Columns(f"{name}: {times[-1] - times[0]:g} s", "time_s", self.columns, self.units)

    def plot(self, *names: str) -> Figure:
        """Return a figure of columns over time; see `Columns.plot`."""
        return self.samples.plot(*names)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a DataFrame with the units in its ``attrs``; needs the extra 'pandas'."""
        return self.samples.to_pandas()

    def to_arrow(self) -> pyarrow.Table:
        """Return a table with the unit of each column in its metadata; needs the extra 'tables'."""
        return self.samples.to_arrow()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to pickle: configurations, from which the other process builds the machines."""
        return {**super().__getstate__(), "machines": [(last, one.parameters) for last, one in self.machines]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled state."""
        build = catalogue_entry(state["name"]).build
        vars(self).update(state, machines=tuple((last, build(parameters)) for last, parameters in state["machines"]))

    def __repr__(self) -> str:
        return f"{self.samples!r}\n{len(self.events)} events"


@dataclass(frozen=True, repr=False)
class RollOuts:
    """Roll-outs of one machine, one for each member.

    Attributes
    ----------
    members : tuple of NamedRollOut
        In the requested order.  A member that failed before the end has ``error`` set, and nan afterwards.
    """

    members: tuple[NamedRollOut, ...]

    def __getitem__(self, column: str) -> Array:
        """Return a column of every member, shape (members, steps + 1); shorter members end in nan."""
        if not isinstance(column, str):
            raise StudyError(f"{column!r:.80}: expected the name of a column; a member is one of `members`")
        found = [member[column] for member in self.members]
        stacked = np.full((len(found), max(map(len, found), default=0)), np.nan)
        for row, values in zip(stacked, found, strict=True):
            row[: len(values)] = values
        return stacked

    def __len__(self) -> int:
        return len(self.members)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a DataFrame with the rows of every member, indexed by member and row; needs the extra 'pandas'."""
        require_extra("pandas")
        import pandas as pd

        frames = {number: member.to_pandas() for number, member in enumerate(self.members)}
        return pd.concat(frames, names=["member", "row"]) if frames else pd.DataFrame()

    def __repr__(self) -> str:
        return f"{len(self)} roll-outs, the first {self.members[0]!r}" if self.members else "no roll-outs"

    def __iter__(self) -> Iterator[NamedRollOut]:
        return iter(self.members)


@raising_interrupt()
def rollout(
    machine: str | Machine,
    duration_s: float,
    settings: Parameters | Mapping[str, Any] | None = None,
    *,
    columns: Sequence[str] | None = None,
    start: Frame | None = None,
    command: Profile = 1.0,
    changes: Sequence[Change] = (),
) -> NamedRollOut:
    """Return a run of a machine as arrays, equal to the bit to the roles' results step by step.

    Parameters
    ----------
    machine : str or Machine
        Name of a machine of the catalogue, or a machine object.
    duration_s : float
        Simulated time (s), rounded to whole coupling steps.
    settings : mapping or Parameters, optional
        Values by dotted key that replace those of the configuration, or a whole configuration; unchanged if absent.
    columns : sequence of str, optional
        Requested columns besides ``time_s``: ``role.joint.position`` (m or rad), ``.velocity``, ``.effort``,
        ``forces.pin.force_x_n``, ``forces.QUANTITY``, ``linkage.memory.NAME``, ``linkage.residual.NAME``, ...; or all.
    start : Frame, optional
        Initial frame, such as ``final`` of another roll-out; the machine's own start if absent.
    command : float, EffortCommand, callable, sequence of pairs or ndarray
        Requested fraction of rated supply frequency, or an effort instead.  One value for the run; ``command(step)``;
        pairs of time (s) and the command from then on, 1 before the first; or one number per step, from the start on.
    changes : sequence of pairs
        Start time (s), within the run, and live keys (dotted) with their values, or a whole configuration.

    Raises
    ------
    MotionError
        If the simulation fails before the end.
    KeyboardInterrupt
        At Ctrl-C, within a fraction of a second.
    """
    found = _member(machine, settings, duration_s, columns, start, command, changes).computed(lambda: None)
    if found.error is not None:
        raise found.error
    return found


@raising_interrupt()
def rollouts(
    machine: str | Machine,
    duration_s: float,
    settings: Sequence[Parameters | Mapping[str, Any] | None],
    *,
    columns: Sequence[str] | None = None,
    starts: Sequence[Frame | None] | None = None,
    commands: Sequence[Profile] | None = None,
    changes: Sequence[Change] = (),
    cores: int | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
) -> RollOuts:
    """Return a run for each parameter set, start and command, computed on all cores.

    Each is computed independently: results do not depend on the batch or the number of cores, to the bit.

    Parameters
    ----------
    machine, duration_s, columns, changes
        As for `rollout`.
    settings : sequence of mapping or Parameters
        One for each member, as for `rollout`.
    starts, commands : sequence, optional
        One a member.
    cores : int, optional
        Threads to use; all cores if absent.
    device : str
        'cuda' computes them side by side on a graphics processor; needs the extra 'cuda'.  Sines and cosines are those
        of its library, so numbers differ from those of the processor in the last digits.

    Raises
    ------
    StudyError
        There is no such device, or the machine cannot run on it.
    """
    if device not in ("cpu", "cuda"):
        raise StudyError(f"device {device!r}: expected 'cpu' or 'cuda'")
    settings = sequence_items("settings", settings, "a list of settings, one a member")
    count = len(settings)
    begun = (None,) * count if starts is None else sequence_items("starts", starts, "a list of frames, one a member")
    asked_for = "a list of commands, one a member"
    driven = (1.0,) * count if commands is None else sequence_items("commands", commands, asked_for)
    for name, given in (("starts", begun), ("commands", driven)):
        if len(given) != count:
            raise StudyError(f"{len(given)} {name} for {count} settings; expected one each")
    threads, changes = used_cores(cores), sequence_items("changes", changes, CHANGES)
    asked = [
        _member(machine, each, duration_s, columns, start, command, changes)
        for each, start, command in zip(settings, begun, driven, strict=True)
    ]
    if device == "cuda":
        from mech_twin.engine.graphics_run import run_on_graphics_processor

        found = run_on_graphics_processor([member.plan() for member in asked])
        return RollOuts(tuple(member.named(run) for member, run in zip(asked, found, strict=True)))
    ended = Event()

    def between() -> None:
        if ended.is_set():
            raise CancelledError

    with ThreadPoolExecutor(threads) as pool:
        waiting = [pool.submit(member.computed, between) for member in asked]
        try:
            return RollOuts(tuple(member.result() for member in waiting))
        except BaseException:  # Ctrl-C, or a failed member: stop the others
            ended.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def changed(name: str, parameters: Parameters, keys: Mapping[str, Any], source: str) -> Parameters:
    """Return parameters with changed values of live keys (dotted).

    Raises
    ------
    StudyError
        If a key is not live, that is, cannot change while the machine runs.
    ConfigurationError
        If the changed configuration is invalid.
    """
    live = list(live_numbers(parameters))
    for key in keys:
        if key not in live:
            raise StudyError(f"{source}: key '{key}' cannot change during a run; expected one of {', '.join(live)}")
    return changed_configuration(name, parameters, keys, source)


@dataclass(frozen=True)
class _Member:
    """A roll-out to be computed: its plan, made when it is, the name of its machine, the units of its columns."""

    plan: Callable[[], RunPlan]
    name: str
    units: Mapping[str, str]

    def computed(self, between: Callable[[], None]) -> NamedRollOut:
        return self.named(self.plan().computed(between))

    def named(self, found: RollOut) -> NamedRollOut:
        parts = {part.name: getattr(found, part.name) for part in fields(found)}
        units = {column: unit_of(column) or self.units.get(column, "") for column in found.columns}
        return NamedRollOut(**parts, name=self.name, units=units)


def _member(
    machine: str | Machine,
    parameters: Parameters | Mapping[str, Any] | None,
    duration_s: float,
    columns: Sequence[str] | None,
    start: Frame | None,
    command: Profile,
    changes: Sequence[Change],
) -> _Member:
    """Return one roll-out that is ready to be computed, its machines built."""
    base = _built(machine, parameters)
    units = shown_units(base)
    machines, known = [], base.parameters
    for change in sequence_items("changes", changes, CHANGES):
        pair = sequence_items("changes", change, CHANGES)
        if len(pair) != 2:
            raise StudyError(f"changes {change!r:.80}: expected {CHANGES}")
        source = f"change at {pair[0]} s"
        known = changed(base.name, known, pair[1], source) if isinstance(pair[1], Mapping) else pair[1]
        machines.append((pair[0], _of_configuration(base.name, known, source)))

    return _Member(partial(planned, base, duration_s, columns, start, command, machines), base.name, units)


def _built(machine: str | Machine, parameters: Parameters | Mapping[str, Any] | None) -> Machine:
    name, known = (machine.name, machine.parameters) if isinstance(machine, Machine) else (machine, None)
    if isinstance(machine, Machine) and parameters is None:
        return machine
    if isinstance(parameters, Parameters):
        return _of_configuration(name, parameters, "settings")
    if known is None:
        return catalogue_entry(name).build(machine_parameters(name, None, parameters))
    keys = by_name("settings", parameters, "settings by dotted key, or a configuration")
    return catalogue_entry(name).build(changed_configuration(name, known, keys, "settings"))


def _of_configuration(name: str, parameters: Any, source: str) -> Machine:
    entry = catalogue_entry(name)
    if not isinstance(parameters, entry.parameters):
        kind = type(parameters).__name__ if isinstance(parameters, Parameters) else f"{parameters!r:.80}"
        raise StudyError(f"{source}: {kind}; expected settings by dotted key, or a configuration of {name}")
    return entry.build(parameters)

# SPDX-License-Identifier: Apache-2.0
"""Changes during a run: live parameters, command, supply, operating point; as a step or along a ramp.

::

    body.spring_rate_n_per_m=-20%@12      a live parameter, from 12 s on
    motor.command=0.8@12                  the requested fraction of rated supply frequency
    motor.torque_curve=single_phase@12    a line of an induction motor's supply opens
    supply_frequency=-4%@12..20           a variable of the operating point, along a ramp from 12 s to 20 s
    bearing_friction=2@12                 a fault of the machine by its size, even if its keys are not live

A sag is a change and a second one that reverses it.  Shares refer to the previous value; those of faults and of an
operating point to the healthy value.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from mech_twin.capabilities.arguments import is_number
from mech_twin.capabilities.faults import MachineFault, OperatingVariable
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.machines.catalog import Entry
from mech_twin.parameters.errors import declared_key, did_you_mean, key_units, keys
from mech_twin.parameters.load import assignments, catalogue_entry, changed_configuration
from mech_twin.parts.induction_motor import InductionMotorParameters
from mech_twin.roles import Machine

COMMAND, TORQUE_CURVE = "motor.command", "motor.torque_curve"  # properties of the supply, not live parameters
RAMP_STEP_S = 0.1  # interval of parameter changes along a ramp; a command changes in each step
MOST_RAMP_STEPS = 1000


class LiveChange(NamedTuple):
    """A requested change: a value, or a share of the previous one, from ``time_s`` on, complete at ``until_s``."""

    text: str
    key: str
    value: Any
    share: float | None
    time_s: float
    until_s: float


def live_changes(texts: Iterable[str], duration_s: float = math.inf) -> list[LiveChange]:
    """Return the changes written as ``KEY=VALUE@SECONDS`` or ``KEY=+-PERCENT%@SECONDS``, in order of time.

    ``@BEGIN..END`` instead of ``@SECONDS`` is a ramp.

    Raises
    ------
    ConfigurationError
        A text does not have this form, or its change begins after ``duration_s``.
    """
    changes = sorted(map(_change, texts), key=lambda change: change.time_s)
    if changes and changes[-1].time_s >= duration_s:
        raise ConfigurationError(f"--change {changes[-1].text}: expected before the end at {duration_s:g} s")
    return changes


def _change(text: str) -> LiveChange:
    wanted, at, time = text.rpartition("@")
    key, equals, value = wanted.partition("=")
    refused = ConfigurationError(f"--change {text}: expected KEY=VALUE@SECONDS or KEY=-20%@SECONDS, or @BEGIN..END")
    begin, ramp, end = time.partition("..")
    try:
        time_s = float(begin)
        until_s = float(end) if ramp else time_s
        share = float(value.strip()[:-1]) / 100.0 if value.strip().endswith("%") else None
    except ValueError:
        raise refused from None
    if not (at and equals and key.strip() and value.strip() and math.isfinite(time_s) and time_s >= 0.0):
        raise refused
    if not (math.isfinite(until_s) and until_s >= time_s) or (share is not None and not math.isfinite(share)):
        raise refused
    worth = None if share is not None else assignments([wanted])[key.strip()]
    return LiveChange(text, key.strip(), worth, share, time_s, until_s)


class ChangingMachine:
    """A machine whose live parameters change during the run; the changes are validated before it starts.

    Attributes
    ----------
    revisions : list of (int, Machine)
        The machines with their parameters, each with the step from which it is in force.

    Raises
    ------
    ConfigurationError
        A key is unknown or not live, or a value is rejected.
    """

    def __init__(self, machine: Machine, changes: Sequence[LiveChange]) -> None:
        self.revisions: list[tuple[int, Machine]] = [(0, machine)]
        self._commands: list[tuple[float, float]] = [(0.0, 1.0)]
        self._step_s = machine.coupling_step_s
        self._point: dict[str, float] = {}
        ended_s = {True: 0.0, False: 0.0}
        for change in changes:
            of_command = change.key == COMMAND
            if change.time_s < ended_s[of_command]:
                raise ConfigurationError(f"--change {change.text}: expected a time after the end of the previous ramp")
            ended_s[of_command] = change.until_s
            if of_command:
                self._add_command(change)
            else:
                self._add_parameters(change, machine.name)

    def _add_command(self, change: LiveChange) -> None:
        before = self._commands[-1][1]
        value = before * (1.0 + change.share) if change.share is not None else change.value
        if not is_number(value) or not 0.0 <= value <= 1.0:
            raise ConfigurationError(f"--change {change.text}: expected a fraction of rated frequency, 0 to 1")
        self._commands += [(change.time_s, before), (change.until_s, float(value))]

    def _add_parameters(self, change: LiveChange, name: str) -> None:
        entry, before = catalogue_entry(name), self.revisions[-1][1].parameters
        count = max(1, math.ceil((change.until_s - change.time_s) / RAMP_STEP_S - 1e-9))
        if count > MOST_RAMP_STEPS:
            longest_s = MOST_RAMP_STEPS * RAMP_STEP_S
            raise ConfigurationError(f"--change {change.text}: expected a ramp of at most {longest_s:g} s")
        made = self._named_changes(entry)
        named, at_first = made.get(change.key), self._point.get(change.key, 0.0)
        for i in range(1, count + 1):
            if named is not None:
                self._point[change.key] = at_first + (_size(change, named) - at_first) * i / count
                changes: dict[str, Any] = {}
                healthy = self.revisions[0][1].parameters
                for key, size in self._point.items():
                    changes |= made[key].changes(varied(healthy, changes), size)
                parameters = changed_configuration(name, before, changes, f"--change {change.text}")
            else:
                parameters = _changed(before, change, name, i / count, made)
            time_s = change.until_s if i == count else change.time_s + (change.until_s - change.time_s) * i / count
            step = math.ceil(time_s / self._step_s - 1e-9)
            self.revisions.append((step, entry.build(parameters)))

    def _named_changes(self, entry: Entry) -> dict[str, MachineFault | OperatingVariable]:
        """Return faults and operating variables by name; a live key takes precedence over a fault."""
        healthy, able = self.revisions[0][1].parameters, entry.capabilities
        faults = () if able.faults is None else able.faults(healthy)
        live = live_numbers(healthy)
        found: dict[str, MachineFault | OperatingVariable] = {
            fault.name: fault for fault in faults if fault.name not in live
        }
        return found | {each.name: each for each in (able.operating(healthy) if able.operating else ())}

    def command(self, step: int) -> float:
        """Return the requested fraction of rated supply frequency at a step."""
        now_s = step * self._step_s + 1e-9 * self._step_s
        before = (0.0, 1.0)
        for time_s, value in self._commands:
            if now_s < time_s:
                return before[1] + (value - before[1]) * (now_s - before[0]) / (time_s - before[0])
            before = (time_s, value)
        return before[1]

    def at(self, step: int) -> Machine:
        """Return the machine that computes a step; see `ConfigurationHistory.machine_at`."""
        return next(machine for since, machine in reversed(self.revisions) if since <= step)


def _size(change: LiveChange, named: MachineFault | OperatingVariable) -> float:
    """Return the size of a fault or the share of a variable that a change requests."""
    unit = named.unit if isinstance(named, MachineFault) else "1"
    if unit == "1":
        if change.share is None:
            raise ConfigurationError(f"--change {change.text}: expected a share, such as {change.key}=-2%@12")
        return change.share
    if change.share is not None or not is_number(change.value):
        raise ConfigurationError(f"--change {change.text}: expected a size, a number of unit {unit}")
    return float(change.value)


def _changed(parameters: Parameters, change: LiveChange, machine: str, done: float, named: Iterable[str]) -> Parameters:
    """Return the parameters after the share ``done`` of a change, which is none of the named ones."""
    live = live_numbers(parameters)
    motor = getattr(parameters, "motor", None)
    if isinstance(motor, InductionMotorParameters):
        live[TORQUE_CURVE] = motor.torque_curve
    if change.key not in live:
        raise ConfigurationError(
            f"--change {change.text}: {_not_live(change.key, type(parameters), live, machine, named)}"
        )
    value = change.value
    if change.share is not None:
        if not isinstance(live[change.key], int | float):
            raise ConfigurationError(f"--change {change.text}: {change.key} is no number, expected a value")
        value = live[change.key] * (1.0 + change.share * done)
    elif done < 1.0:
        if not is_number(value):
            raise ConfigurationError(f"--change {change.text}: {change.key} is no number, expected it at once")
        value = live[change.key] + (value - live[change.key]) * done
    return changed_configuration(machine, parameters, {change.key: value}, f"--change {change.text}")


def _not_live(key: str, model: type[Parameters], live: Iterable[str], machine: str, named: Iterable[str]) -> str:
    """Return the error text for a key that is unknown or not live, with a suggestion."""
    units, changing = key_units(model), sorted(live)
    if declared_key(key, units) in units:
        return f"'{key}' is fixed during a run; expected a live key of {machine}, one of {', '.join(changing)}"
    known = [*changing, COMMAND, *sorted(named)]
    meant = did_you_mean(key, {name: units.get(name, "") for name in known})
    return f"unknown key '{key}'" + (meant or f"; expected one of {', '.join(known)}")


def live_numbers(parameters: Parameters) -> dict[str, Any]:
    """Return the value of each live key, which may change during a run."""
    return {key.name: key.value for key in keys(parameters) if key.live and key.value is not None}

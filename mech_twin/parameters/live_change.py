# SPDX-License-Identifier: Apache-2.0
"""Live parameters changed at a time of the run: ``body.spring_rate_n_per_m=-20%@12``, a fault to be found."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, NamedTuple

from mech_twin.configuration_tree import ConfigurationError, configuration_tree, merged_tree, tree_from_flat
from mech_twin.parameters.key_hints import did_you_mean, key_units
from mech_twin.parameters.load import assignments, catalogue_entry, validated
from mech_twin.quantity import Parameters
from mech_twin.roles import Machine


class LiveChange(NamedTuple):
    """A change as it was asked for: a value, or a share of the value before, from a time on."""

    text: str
    key: str
    value: Any
    share: float | None
    time_s: float


def live_changes(texts: Iterable[str]) -> list[LiveChange]:
    """Return the changes written as ``KEY=VALUE@SECONDS`` or ``KEY=+-PERCENT%@SECONDS``, in order of time.

    Raises
    ------
    ConfigurationError
        A text has another form.
    """
    return sorted(map(_change, texts), key=lambda change: change.time_s)


def _change(text: str) -> LiveChange:
    wanted, at, time = text.rpartition("@")
    key, equals, value = wanted.partition("=")
    refused = ConfigurationError(f"--change {text}: expected KEY=VALUE@SECONDS or KEY=-20%@SECONDS")
    try:
        time_s = float(time)
        share = float(value.strip()[:-1]) / 100.0 if value.strip().endswith("%") else None
    except ValueError:
        raise refused from None
    if not (at and equals and key.strip() and value.strip() and math.isfinite(time_s) and time_s >= 0.0):
        raise refused
    if share is not None and not math.isfinite(share):
        raise refused
    worth = None if share is not None else assignments([wanted])[key.strip()]
    return LiveChange(text, key.strip(), worth, share, time_s)


class ChangingMachine:
    """A machine whose live parameters change during the run; the changes are checked before it begins.

    Parameters
    ----------
    machine : Machine
        The machine at the start.
    changes : sequence of LiveChange
        In order of time.

    Raises
    ------
    ConfigurationError
        A key is unknown, not live, or the value is refused.
    """

    def __init__(self, machine: Machine, changes: Sequence[LiveChange]) -> None:
        self._machines: list[tuple[int, Machine]] = [(0, machine)]
        entry = catalogue_entry(machine.name)
        for change in changes:
            before = self._machines[-1][1]
            parameters = _changed(before.parameters, change, machine.name)
            step = math.ceil(change.time_s / machine.coupling_step_s - 1e-9)
            self._machines.append((step, entry.build(parameters)))

    def at(self, step: int) -> Machine:
        """Return the machine that computes this step; see `ConfigurationHistory.machine_at`."""
        return next(machine for since, machine in reversed(self._machines) if since <= step)

    @cached_property
    def revisions(self) -> tuple[tuple[int, Machine], ...]:
        """The machines in force, each with the step from which it is."""
        return tuple(self._machines)


def _changed(parameters: Parameters, change: LiveChange, machine: str) -> Parameters:
    live = dict(live_numbers(parameters))
    if change.key not in live:
        raise ConfigurationError(f"--change {change.text}: {_not_live(change.key, type(parameters), live, machine)}")
    value = change.value
    if change.share is not None:
        if not isinstance(live[change.key], int | float):
            raise ConfigurationError(f"--change {change.text}: {change.key} is no number, expected a value")
        value = live[change.key] * (1.0 + change.share)
    tree = merged_tree(configuration_tree(parameters), tree_from_flat({change.key: value}))
    return validated(catalogue_entry(machine), tree, f"--change {change.text}")


def _not_live(key: str, model: type[Parameters], live: Iterable[str], machine: str) -> str:
    """Return what is wrong with a key: it is no key, or none that may change; and which was probably meant."""
    units, changing = key_units(model), sorted(live)
    if key in units:
        return f"'{key}' is fixed during a run; expected a live key of {machine}, one of {', '.join(changing)}"
    meant = did_you_mean(key, {name: units.get(name, "") for name in changing})
    return f"unknown key '{key}'" + (meant or f"; expected one of {', '.join(changing)}")


def live_numbers(parameters: Parameters, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each key that may change during a run, and its value."""
    for name, field in type(parameters).model_fields.items():
        value, extra = getattr(parameters, name), field.json_schema_extra
        if isinstance(value, Parameters):
            yield from live_numbers(value, f"{prefix}{name}.")
        elif isinstance(extra, dict) and extra.get("live"):
            yield prefix + name, value

# SPDX-License-Identifier: Apache-2.0
"""The mapping file: assigns channels of a measurement to columns of the machine, with their units.

A channel reads ``sign * of_the_machine / gain + zero``, in its own unit and delayed by its lag; this is inverted::

    of_the_machine(stamp - lag_s) = sign * gain * (shown - zero)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.measurements.units import SCALED_BY_GAIN, TIME_UNITS, UNITS, is_event, unit_of
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import document_tree

MOST_CHANNELS = 1000
TIME_COLUMN = "time_s"  # of a table whose map names no other
FREE, PER_RUN = "free", "per_run"
LARGEST, LONGEST_LAG_S, FASTEST_HZ = 1e12, 10.0, 1e6


def _number(least: float, largest: float, *, words: tuple[str, ...] = ()) -> BeforeValidator:
    """Return a validator of a number within bounds, or of a word for an unknown number."""
    expected = ", ".join([f"expected a number from {least:g} to {largest:g}", *words])

    def checked(value: Any) -> Any:
        if value in words:
            return value
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= largest:
            raise ValueError(expected)
        return float(value)

    return BeforeValidator(checked)


def _one_of(words: Collection[str]) -> AfterValidator:
    def checked(value: str) -> str:
        if value not in words:
            raise ValueError(f"expected one of {', '.join(words)}")
        return value

    return AfterValidator(checked)


def _not_zero(value: float | str) -> float | str:
    if value == 0.0:
        raise ValueError("expected a number that is not 0, free or per_run")
    return value


Number = Annotated[float | str, _number(-LARGEST, LARGEST, words=(FREE, PER_RUN))]
Lag = Annotated[float | str, _number(-LONGEST_LAG_S, LONGEST_LAG_S, words=(FREE, PER_RUN))]
Size = Annotated[float, _number(0.0, LARGEST)]


class Source(Parameters):
    """Source of a channel: a topic (with joint and field, or only a dotted field), a column of a table, or both.

    For messages other than JointState, ``joint`` selects those with this ``frame_id``; field ``stamp`` is their time.
    """

    topic: str | None = Field(default=None, min_length=1)
    joint: str | None = Field(default=None, min_length=1)
    field: str | None = Field(default=None, min_length=1)
    column: str | None = Field(default=None, min_length=1)

    @model_validator(mode="after")
    def _somewhere(self) -> Source:
        if self.topic is None and self.column is None:
            raise ValueError("expected a topic (with joint and field) or a column")
        if self.topic is not None and self.field is None:
            raise ValueError(
                "expected a field beside the topic: position, velocity or effort of a joint, or such as wrench.force.x"
            )
        if self.topic is None and (self.joint is not None or self.field is not None):
            raise ValueError("joint and field go with a topic, a column has none")
        return self

    @property
    def label(self) -> str:
        """Name of the channel in errors and tables; also its column in a table, if the source has none."""
        if self.column is not None:
            return self.column
        return " ".join(word for word in (self.topic, self.joint, self.field) if word)


class TimeSource(Parameters):
    """Source of the time: stamps of the headers or of the log in a bag, a column in a table."""

    stamps: Literal["header", "log"] | None = None
    column: str | None = Field(default=None, min_length=1)
    unit: Annotated[str, _one_of(TIME_UNITS)] = "s"


class Channel(Parameters):
    """One measured channel; ``zero``, ``sigma`` and ``quantum`` are in the channel's own unit.

    The keys below ``sigma`` describe a simulated sensor, for `simulate --sensors`; reading ignores them.
    """

    model_config = ConfigDict(populate_by_name=True)
    source: Source
    quantity: str = Field(alias="is", min_length=1)
    unit: Annotated[str, _one_of(UNITS)] | None = None
    sign: Literal[1, -1] = 1
    zero: Number = 0.0
    gain: Annotated[Number, AfterValidator(_not_zero)] = 1.0
    lag_s: Lag = 0.0
    sigma: Size | None = None
    rate_hz: Annotated[float, _number(1e-6, FASTEST_HZ)] | None = None
    jitter_s: Annotated[float, _number(0.0, LONGEST_LAG_S)] = 0.0
    quantum: Size = 0.0
    drop: Annotated[float, _number(0.0, 0.999)] = 0.0

    @property
    def si_factor(self) -> float:
        """Size of the channel's unit in SI units."""
        return 1.0 if self.unit is None else UNITS[self.unit].factor

    def to_machine(self, shown: Any) -> Any:
        """Return the machine's value in SI units; an unknown zero counts as 0, an unknown gain as 1."""
        return self.sign * fixed(self.gain, 1.0) * self.si_factor * (shown - fixed(self.zero, 0.0))

    def shown(self, value: Any) -> Any:
        """Return the reading of the channel in its own unit: the inverse of `to_machine`."""
        return self.sign * value / (fixed(self.gain, 1.0) * self.si_factor) + fixed(self.zero, 0.0)


class MeasurementMap(Parameters):
    """Assignment of channels of a measurement to columns of the machine."""

    machine: str
    time: TimeSource = TimeSource()
    channels: tuple[Channel, ...] = Field(min_length=1, max_length=MOST_CHANNELS)
    runs: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _each_source_once(self) -> MeasurementMap:
        time_column = self.time.column or TIME_COLUMN
        seen: set[str] = set()
        for channel in self.channels:
            if channel.source.column == time_column:
                raise ValueError(f"source {time_column!r} is the column of the time; expected another column")
            if channel.source.label in seen:
                raise ValueError(f"source {channel.source.label!r} stands twice: a channel is one quantity")
            seen.add(channel.source.label)
        return self


def fixed(value: float | str, unknown: float) -> float:
    """Return a number of the map, or ``unknown`` if it is a word."""
    return unknown if isinstance(value, str) else value


def read_map(path: Path, columns_of: Any) -> MeasurementMap:
    """Return the map in a file.

    Parameters
    ----------
    columns_of : callable
        ``columns_of(machine_name)``: the columns of the machine, with their SI units.

    Raises
    ------
    ConfigurationError
        If the map is invalid; the message names file, key, value and what was expected.
    """
    try:
        found = MeasurementMap.model_validate(document_tree(path))
    except ValidationError as error:
        raise refusal(str(path), error, MeasurementMap) from error
    try:
        columns = columns_of(found.machine)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: key 'machine': {error}") from error
    for place, channel in enumerate(found.channels):
        _check_channel(channel, f"{path}: key 'channels.{place}", found.machine, columns)
    return found


def _check_channel(channel: Channel, where: str, machine: str, columns: Mapping[str, str]) -> None:
    name = channel.quantity
    if name not in columns and not is_event(name):
        near = get_close_matches(name, columns, 3, 0.5)
        hint = (
            f", such as {', '.join(near)}"
            if near
            else ", as `simulate --json --samples` shows them, or event.KIND.time"
        )
        raise ConfigurationError(f"{where}.is', value {name!r}: expected a column of {machine}{hint}")
    expected = columns.get(name) or unit_of(name)
    if channel.unit is None or channel.unit in SCALED_BY_GAIN:
        return
    if UNITS[channel.unit].si != expected:
        fitting = [unit for unit, about in UNITS.items() if about.si == expected]
        raise ConfigurationError(
            f"{where}.unit', value {channel.unit!r}: {name} is in {expected}; expected one of "
            f"{', '.join((*fitting, *SCALED_BY_GAIN))}"
        )

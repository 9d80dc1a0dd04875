# SPDX-License-Identifier: Apache-2.0
"""Comparison of two samples to the bit, or within a tolerance: the first field that differs."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator
from typing import NamedTuple

from mech_twin.declarations.captions import unit_of
from mech_twin.samples import BodySample, ForceSample, LinkageSample, MotorSample, Named

Sample = LinkageSample | MotorSample | ForceSample | BodySample
RESIDUALS = "residuals."
Value = float | str | None


class Difference(NamedTuple):
    """First difference of two samples of one step: ``role`` is linkage, motor, forces or body; None: absent entry."""

    step: int
    time_s: float
    role: str
    field: str
    recorded: Value
    computed: Value


def first_difference(role: str, recorded: Sample, computed: Sample, tolerance: float = 0.0) -> Difference | None:
    """Return the first field in which two samples of one step differ, or None.

    Parameters
    ----------
    role : str
        Role that the samples belong to.
    recorded, computed
        The samples; names of joints, pins, memory and residuals are compared too.
    tolerance : float
        0 compares every bit.  Else a number may differ by this share of the largest recorded number of the sample in
        the same unit, and residuals, which are rounding errors, are ignored.
    """
    if _content(recorded) == _content(computed):
        return None
    computed_by_name, recorded_by_name = dict(fields(computed)), dict(fields(recorded))
    sizes = _sizes(recorded_by_name)
    for name in {**recorded_by_name, **computed_by_name}:
        there, here = recorded_by_name.get(name), computed_by_name.get(name)
        missing = name not in recorded_by_name or name not in computed_by_name
        near = tolerance > 0.0 and _near(name, there, here, tolerance * sizes.get(unit_of(name), 0.0))
        if missing or not (near or _bits(there) == _bits(here)):
            return Difference(recorded.step, recorded.time_s, role, name, there, here)
    if tolerance > 0.0:
        return None
    return Difference(recorded.step, recorded.time_s, role, "order of the entries", None, None)


def _sizes(numbers: dict[str, Value]) -> dict[str, float]:
    """Return the largest magnitude in each unit."""
    sizes: dict[str, float] = {}
    for name, value in numbers.items():
        if isinstance(value, float) and not name.startswith(RESIDUALS):
            sizes[unit_of(name)] = max(sizes.get(unit_of(name), 0.0), abs(value))
    return sizes


def _near(name: str, there: Value, here: Value, allowed: float) -> bool:
    if not isinstance(there, float) or not isinstance(here, float):
        return False
    return name.startswith(RESIDUALS) or abs(there - here) <= allowed


def fields(sample: object, path: str = "") -> Iterator[tuple[str, Value]]:
    """Yield every number and string of a sample under its name, such as ``velocity[crank]`` or ``memory.energy_j``."""
    if isinstance(sample, Named):
        yield from ((f"{path}.{name}", value) for name, value in zip(sample.names, sample.values, strict=True))
    elif hasattr(sample, "_fields"):
        yield from _record_fields(sample, path)
    elif isinstance(sample, tuple):
        for i, item in enumerate(sample):
            yield from fields(item, f"{path}[{i}]")
    elif isinstance(sample, str):
        yield path, sample
    elif sample is not None:
        yield path, float(sample)  # type: ignore[arg-type]


def _record_fields(sample: object, path: str) -> Iterator[tuple[str, Value]]:
    labels = tuple(getattr(sample, "joints", ()) or getattr(sample, "pins", ()))
    named = {"position", "velocity", "effort", "wrenches"} if labels else set()
    for name in sample._fields:  # type: ignore[attr-defined]
        value = getattr(sample, name)
        here = f"{path}.{name}" if path else name
        if name in named:
            for label, item in zip(labels, value, strict=True):
                yield from fields(item, f"{here}[{label}]")
        else:
            yield from fields(value, here)


def _content(sample: Sample) -> tuple[bytes, list[str]]:
    """Return the bits of all numbers and all strings of a sample, without their names."""
    flat: list[float | str] = []
    _flatten(sample, flat)
    numbers = array("d", [item for item in flat if not isinstance(item, str)])
    return numbers.tobytes(), [item for item in flat if isinstance(item, str)]


def _flatten(item: object, flat: list[float | str]) -> None:
    if isinstance(item, tuple):
        for part in item:
            _flatten(part, flat)
    elif item is not None:
        flat.append(item)  # type: ignore[arg-type]


def _bits(value: Value) -> bytes | str | None:
    return struct.pack("<d", value) if isinstance(value, float) else value

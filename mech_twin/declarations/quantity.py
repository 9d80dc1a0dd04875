# SPDX-License-Identifier: Apache-2.0
"""Declaration of parameters: one frozen model per part, each number once with unit, bounds and meaning.

The validation of YAML, the ROS parameter descriptors and the tables in the documentation are all derived from these
declarations.
"""

import math
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

# smallest nonzero and largest magnitude of any parameter in this unit: wide, but within the range in which the
# equations can be solved
RANGES: dict[str, tuple[float, float]] = {
    "1": (1e-9, 1e6), "1/min": (1e-6, 1e6), "1/s": (1e-6, 1e6), "Hz": (1e-6, 1e6), "MiB": (1e-3, 1e9),
    "N": (1e-9, 1e9), "N m": (1e-9, 1e9), "N m s": (1e-9, 1e9), "N m s/rad": (1e-9, 1e9), "N m/rad": (1e-9, 1e12),
    "N s/m": (1e-9, 1e9), "s/m": (1e-9, 1e6), "N/m": (1e-9, 1e13), "Pa": (1e-3, 1e13), "W": (1e-6, 1e9),
    "deg": (1e-9, 1e5), "kg": (1e-9, 1e7), "kg m2": (1e-12, 1e8), "kg/m3": (1e-3, 1e5),
    "m": (1e-6, 1e4), "m2": (1e-12, 1e6), "m3": (1e-12, 1e9), "m/s": (1e-9, 1e4), "m/s2": (1e-9, 1e4),
    "rad": (1e-9, 1e4), "rad/s": (1e-9, 1e6), "rpm": (1e-6, 1e6), "s": (1e-9, 1e6),
}  # fmt: skip
LONGEST_RUN_S = 2**31 - 1  # largest number of seconds in a ROS time


class Parameters(BaseModel):
    """Base of every parameter model: immutable; unknown keys are rejected."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)

    @field_validator("*", mode="before")
    @classmethod
    def _quantity_is_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """Reject a string or boolean for a number, which pydantic would convert silently."""
        extra = cls.model_fields[info.field_name or ""].json_schema_extra
        if isinstance(extra, dict) and "unit" in extra and isinstance(value, str | bytes | bool):
            raise ValueError(f"expected a number in {extra['unit']}")
        return value

    def unused(self) -> frozenset[str]:
        """Return the keys that an element of this kind does not have; they are at their defaults."""
        return frozenset()


def quantity(unit: str, meaning: str, *, live: bool = False, **bounds: Any) -> Any:
    """Return the field declaration of a number.

    Parameters
    ----------
    unit : str
        SI unit, ``"1"`` for a dimensionless number.
    meaning : str
        One line for the parameter descriptor and the documentation.
    live : bool
        Whether the number may be changed while the machine runs.
    **bounds
        Pydantic bounds (``gt``, ``ge``, ``lt``, ``le``), ``default`` for an optional key, ``allow_inf_nan``.
        Missing bounds are those of the unit (`RANGES`); ``gt=0`` becomes the unit's smallest magnitude.

    Raises
    ------
    KeyError
        If the unit has no range.
    """
    smallest, largest = RANGES[unit.replace("^", "")]
    if bounds.get("gt") == 0.0:
        bounds = {name: bound for name, bound in bounds.items() if name != "gt"} | {"ge": smallest}
    if not bounds.keys() & {"gt", "ge"}:
        bounds["ge"] = -largest
    if not bounds.keys() & {"lt", "le"} and not bounds.get("allow_inf_nan"):
        bounds["le"] = largest
    return Field(description=meaning, json_schema_extra={"unit": unit, "live": live}, **bounds)


def upper(bound: float, digits: int = 6) -> str:
    """Return an upper bound as an error message prints it: rounded down, so that the printed number is allowed.

    Examples
    --------
    >>> upper(0.45193577)
    '0.451935'
    """
    return _within(bound, digits, 1.0)


def lower(bound: float, digits: int = 6) -> str:
    """Return a lower bound as an error message prints it, rounded up; see `upper`."""
    return _within(bound, digits, -1.0)


def _within(bound: float, digits: int, beyond: float) -> str:
    shown = f"{bound:.{digits}g}"
    if beyond * (float(shown) - bound) > 0.0:
        last_digit = 10.0 ** (math.floor(math.log10(abs(bound))) + 1 - digits)
        shown = f"{float(shown) - beyond * last_digit:.{digits}g}"
    return shown


def keep_at_most(key: str, value: float, most: float, why: str, unit: str = "", digits: int = 6) -> None:
    """Raise for a value whose size is above a bound that follows from other numbers.

    Raises
    ------
    ValueError
        With key, bound, reason and value.
    """
    if abs(value) > most:
        raise ValueError(f"{key} must be at most {upper(most, digits)}{unit}, {why}; got {value:g}")


def choice(meaning: str, *, live: bool = False, **options: Any) -> Any:
    """Return the field declaration of a word of a ``Literal``, or of a group of parameters."""
    return Field(description=meaning, json_schema_extra={"live": live}, **options)

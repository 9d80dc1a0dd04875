# SPDX-License-Identifier: Apache-2.0
"""How a parameter is declared: one frozen model per part, each number with unit, bounds and meaning, once.

The YAML check, the ROS parameter descriptor and the tables in the documentation are all read off these
declarations.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

# smallest size above zero, and largest, that any machine's number in this unit has: wide, so that no legal input
# leaves the range in which the equations are solved
RANGES: dict[str, tuple[float, float]] = {
    "1": (1e-9, 1e6),
    "1/min": (1e-6, 1e6),
    "1/s": (1e-6, 1e6),
    "Hz": (1e-6, 1e6),
    "MiB": (1e-3, 1e9),
    "N": (1e-9, 1e9),
    "N m": (1e-9, 1e9),
    "N m s": (1e-9, 1e9),
    "N m s/rad": (1e-9, 1e9),
    "N m/rad": (1e-9, 1e12),
    "N s/m": (1e-9, 1e9),
    "s/m": (1e-9, 1e6),
    "N/m": (1e-9, 1e13),
    "Pa": (1e-3, 1e13),
    "W": (1e-6, 1e9),
    "deg": (1e-9, 1e5),
    "kg": (1e-9, 1e7),
    "kg m2": (1e-12, 1e8),
    "kg/m3": (1e-3, 1e5),
    "m": (1e-6, 1e4),
    "m2": (1e-12, 1e6),
    "m3": (1e-12, 1e9),
    "m/s": (1e-9, 1e4),
    "m/s2": (1e-9, 1e4),
    "rad": (1e-9, 1e4),
    "rad/s": (1e-9, 1e6),
    "rpm": (1e-6, 1e6),
    "s": (1e-9, 1e6),
}


LONGEST_RUN_S = 2**31 - 1  # a time of ROS holds no more seconds


class Parameters(BaseModel):
    """Base of every parameter model: immutable, and refusing keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)

    @field_validator("*", mode="before")
    @classmethod
    def _quantity_is_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse a word or a truth value where a number is declared; pydantic would convert it silently."""
        extra = cls.model_fields[info.field_name or ""].json_schema_extra
        if isinstance(extra, dict) and "unit" in extra and isinstance(value, str | bool):
            raise ValueError(f"expected a number in {extra['unit']}")
        return value


def quantity(unit: str, meaning: str, *, live: bool = False, **bounds: Any) -> Any:
    """Return the field of a number.

    Parameters
    ----------
    unit : str
        SI unit, ``"1"`` for a pure number.
    meaning : str
        One line for the parameter descriptor and the documentation.
    live : bool
        Whether the number may be changed while the machine runs.
    **bounds
        Pydantic bounds (``gt``, ``ge``, ``lt``, ``le``), ``default`` where absence has a meaning, ``allow_inf_nan``.
        What they leave open is closed by the range of the unit (`RANGES`); ``gt=0`` becomes its smallest size.

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


def choice(meaning: str, *, live: bool = False, **options: Any) -> Any:
    """Return the field of a word out of a ``Literal``, or of a group of parameters."""
    return Field(description=meaning, json_schema_extra={"live": live}, **options)

"""How a parameter is declared: one frozen model per part, each number with unit, bounds and meaning, once.

The YAML check, the ROS parameter descriptor and the tables in the documentation are all read off these
declarations.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator


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
    """
    return Field(description=meaning, json_schema_extra={"unit": unit, "live": live}, **bounds)


def choice(meaning: str, *, live: bool = False, **options: Any) -> Any:
    """Return the field of a word out of a ``Literal``, or of a group of parameters."""
    return Field(description=meaning, json_schema_extra={"live": live}, **options)

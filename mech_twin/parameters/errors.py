# SPDX-License-Identifier: Apache-2.0
"""Error messages for a rejected configuration: file, key, line, value, and what was expected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.parameters.key_hints import ANY_NAME, KeyLines, did_you_mean, groups_of, key_units, no_lines

BOUNDS = frozenset({"greater_than", "greater_than_equal", "less_than", "less_than_equal"})
PURE = "1"
MOST_COMPLAINTS = 20
LONGEST_VALUE = 200
GROUPS = frozenset({"model_type", "dict_type", "model_attributes_type"})
NUMBERS = frozenset({"finite_number", "float_type", "float_parsing", "int_type", "int_parsing"})


def refusal(
    source: str, error: ValidationError, model: type[BaseModel] | None = None, lines: KeyLines = no_lines
) -> ConfigurationError:
    """Return an error of one line with every wrong key, its value and what was expected.

    Parameters
    ----------
    source : str
        Name of the source of the values.
    error : ValidationError
        Error of the validation.
    model : type, optional
        Validated model, for units and for suggestions of similar keys.
    lines : callable
        Returns the line number of each key in its file.
    """
    units = key_units(model) if model is not None else {}
    placed = lines()
    found = error.errors()
    more = [f"and {len(found) - MOST_COMPLAINTS} more"] if len(found) > MOST_COMPLAINTS else []
    complaints = [_complaint(dict(item), units, placed) for item in found[:MOST_COMPLAINTS]]
    return ConfigurationError(f"{source}: " + "; ".join(complaints + more))


def _complaint(item: dict[str, Any], units: Mapping[str, str], lines: Mapping[str, int]) -> str:
    location = item["loc"]
    key = ".".join(str(part) for part in location) if isinstance(location, tuple) else str(location)
    message = str(item["msg"]).removeprefix("Value error, ")
    parts = [part for part in key.split(".") if not part.isdigit()]  # without the indices of lists
    declared = ".".join(parts)
    own = ".".join([parts[0], ANY_NAME, *parts[2:]])
    if len(parts) > 2 and any(known.startswith(f"{parts[0]}.{ANY_NAME}.") for known in units):
        declared = own  # the name of an element is chosen by the user
    kind, unit = item["type"], units.get(declared, PURE)
    unit = "" if unit == PURE else unit
    line = f"line {lines[key]}" if key in lines else ""
    if kind == "extra_forbidden" and not isinstance(item["input"], dict):
        found = ", ".join(filter(None, (line, f"value {shown_value(item['input'])}")))
        return f"unknown key '{key}' ({found}){did_you_mean(declared, units)}"
    if kind == "extra_forbidden":
        return f"unknown group '{key}'{f' ({line})' if line else ''}{did_you_mean(declared, groups_of(units))}"
    if kind == "missing":
        return f"key '{key}' is missing" + (f"; expected a number in {unit}" if unit else "")
    if not key:
        return message
    value = item["input"]
    shown = f"value {shown_value(value)}" if not isinstance(value, dict) else ""
    where = f" ({line})" if line else ""
    return f"key '{key}'{where}{f', {shown}' if shown else ''}: {_expected(message, str(kind), unit)}"


def shown_value(value: Any) -> str:
    """Return the representation of a value, shortened."""
    text = repr(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}..."


def _expected(message: str, kind: str, unit: str) -> str:
    if kind in GROUPS:
        return "expected a group of keys"
    said = f"{message[0].lower()}{message[1:]}"
    if not unit:
        return said
    return f"{said} {unit}" if kind in BOUNDS else f"{said}, in {unit}" if kind in NUMBERS else said

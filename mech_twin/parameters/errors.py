"""How a configuration is refused: file, key, value, and what was expected."""

from __future__ import annotations

from pydantic import ValidationError

from mech_twin.configuration_tree import ConfigurationError


def refusal(source: str, error: ValidationError) -> ConfigurationError:
    """Return one line that names every wrong key, its value and what was expected."""
    return ConfigurationError(f"{source}: " + "; ".join(_complaint(dict(item)) for item in error.errors()))


def _complaint(item: dict[str, object]) -> str:
    location = item["loc"]
    key = ".".join(str(part) for part in location) if isinstance(location, tuple) else str(location)
    message = str(item["msg"]).removeprefix("Value error, ")
    kind = item["type"]
    if kind == "extra_forbidden" and not isinstance(item["input"], dict):
        return f"unknown key '{key}' (value {item['input']!r})"
    if kind == "extra_forbidden":
        return f"unknown group '{key}'"
    if kind == "missing":
        return f"key '{key}' is missing"
    if not key:
        return message
    value = item["input"]
    shown = repr(value) if not isinstance(value, dict) else "the group"
    return f"key '{key}', value {shown}: {message[0].lower()}{message[1:]}"

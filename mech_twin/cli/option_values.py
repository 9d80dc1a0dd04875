# SPDX-License-Identifier: Apache-2.0
"""Values of options that are more than a word - a machine, a time - and what the shell completes."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from typer import Context

from mech_twin.cli.console import CommandError

Value = TypeVar("Value")

SECONDS_PER = {"": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
EXPECTED = "expected a time such as 3, 3s, 500ms, 2min or 1h"


def seconds(text: str) -> float:
    """Return a time in seconds of ``3``, ``3s``, ``500ms``, ``2min`` or ``1h``."""
    match = re.fullmatch(r"\s*([-+.\w]*?)\s*(ms|s|min|h)?\s*", text)
    try:
        value = float(match.group(1)) * SECONDS_PER[match.group(2) or ""] if match else math.nan
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise ValueError(EXPECTED)
    from mech_twin.declarations.quantity import LONGEST_RUN_S

    if value > LONGEST_RUN_S:
        raise ValueError(f"expected at most {LONGEST_RUN_S} s, the longest time that ROS can state")
    return value


def assigned(
    option: str,
    texts: Sequence[str],
    expected: str,
    read: Callable[[str], Value],
    demand: tuple[str, Callable[[Value], bool]] | None = None,
) -> dict[str, Value]:
    """Return the value of each ``NAME=VALUE``, read by ``read``, which raises ValueError for a wrong one.

    A demand is what else is expected, and whether a value meets it.
    """
    found = {}
    for text in texts:
        name, equals, values = text.partition("=")
        try:
            value = read(values)
        except ValueError as error:
            raise CommandError(f"{option} {text}: expected {expected}") from error
        if not equals or not name.strip():
            raise CommandError(f"{option} {text}: expected {expected}")
        if demand is not None and not demand[1](value):
            raise CommandError(f"{option} {text}: expected {demand[0]}")
        if name.strip() in found:
            raise CommandError(f"{option} {text}: '{name.strip()}' stands twice; expected it once")
        found[name.strip()] = value
    return found


def two_numbers(text: str, between: str) -> tuple[float, float]:
    """Return both numbers of a text."""
    first, _, second = text.partition(between)
    return float(first), float(second)


def machine_name(text: str | None) -> str | None:
    """Return the name of the machine that is meant: the name, or a beginning that no other machine has."""
    if text is None:
        return None
    from mech_twin.parameters.load import machine_of_prefix

    return machine_of_prefix(text)


def machines(incomplete: str) -> list[tuple[str, str]]:
    """Return the machines that begin so, with their titles."""
    from mech_twin.machines.catalog import CATALOGUE

    return [(name, entry.title) for name, entry in CATALOGUE.items() if name.startswith(incomplete)]


def settings(context: Context, incomplete: str) -> list[tuple[str, str]]:
    """Return the configuration keys of the machine that begin so, ready for a value, with unit and meaning."""
    from mech_twin.parameters.errors import key_units

    entry = _entry(context)
    return _ready({} if entry is None else key_units(entry.parameters), incomplete)


def live_settings(context: Context, incomplete: str) -> list[tuple[str, str]]:
    """Return the keys that may change while the machine runs."""
    if not _named(context):
        return []
    from mech_twin.parameters.live_change import live_numbers
    from mech_twin.parameters.load import machine_parameters

    return _ready(dict.fromkeys(live_numbers(machine_parameters(_entry(context).name)), ""), incomplete)


def limits(context: Context, incomplete: str) -> list[tuple[str, str]]:
    """Return the limits of the machine's size or design question, with their usual values."""
    known = getattr(_question(context), "limits", {})
    return _ready(
        {name: "" if math.isnan(value) else f"usually {value:g}" for name, value in known.items()}, incomplete
    )


def objectives(context: Context, incomplete: str) -> list[str]:
    """Return the objectives of the machine's size or design question."""
    return [name for name in getattr(_question(context), "objectives", ()) if name.startswith(incomplete)]


def bounds(context: Context, incomplete: str) -> list[tuple[str, str]]:
    """Return the variables of the machine's design question, with their usual bounds in SI units."""
    known = getattr(_question(context), "variables", {})
    return _ready({name: f"usually {low:g}:{high:g}" for name, (low, high) in known.items()}, incomplete)


def _ready(known: Mapping[str, str], incomplete: str) -> list[tuple[str, str]]:
    """Return the names that begin so, ready for a value, with what is said of each."""
    return [(f"{name}=", meaning) for name, meaning in known.items() if name.startswith(incomplete)]


def _named(context: Context) -> str:
    """Return the machine of the command line that is being written, or nothing.

    Of ``study`` it stands before the question; while an option still lacks its value it is among the arguments that are
    not yet taken.
    """
    from mech_twin.declarations.configuration_tree import ConfigurationError
    from mech_twin.parameters.load import machine_of_prefix

    above = context.parent.params if context.parent is not None else {}
    for word in (context.params.get("machine"), above.get("machine"), *context.args):
        try:
            if word:
                return machine_of_prefix(word)
        except ConfigurationError:
            continue
    return ""


def _entry(context: Context) -> Any:
    from mech_twin.machines.catalog import CATALOGUE

    return CATALOGUE.get(_named(context))


def _question(context: Context) -> Any:
    able = getattr(_entry(context), "capabilities", None)
    return getattr(able, "sizing" if context.info_name == "size" else "design", None)

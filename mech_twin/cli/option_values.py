# SPDX-License-Identifier: Apache-2.0
"""Values of options and arguments that are more than a word: a machine, a time."""

from __future__ import annotations

import math
import re
from typing import Any

import typer

SECONDS_PER = {"": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
EXPECTED = "expected a time such as 3, 3s, 500ms, 2min or 1h"


def seconds(text: str | float) -> float:
    """Return a time in seconds of ``3``, ``3s``, ``500ms``, ``2min`` or ``1h``.

    Raises
    ------
    typer.BadParameter
        If the text is no time, is not finite, is negative, or longer than ROS can state.
    """
    if isinstance(text, int | float):
        return float(text)
    match = re.fullmatch(r"\s*([-+.\w]*?)\s*(ms|s|min|h)?\s*", text)
    try:
        value = float(match.group(1)) * SECONDS_PER[match.group(2) or ""] if match else math.nan
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise typer.BadParameter(f"{text}: {EXPECTED}")
    from mech_twin.declarations.quantity import LONGEST_RUN_S

    if value > LONGEST_RUN_S:
        raise typer.BadParameter(f"{text}: expected at most {LONGEST_RUN_S} s, the longest time that ROS can state")
    return value


def time_option(meaning: str, default: str | bool = True) -> Any:
    """Return an option whose value is a time; ``default`` says in words what is taken without it."""
    return typer.Option(help=meaning, parser=seconds, metavar="TIME", show_default=default)


def machine_name(text: str | None) -> str | None:
    """Return the name of the machine that is meant: the name, or a beginning that no other machine has."""
    if text is None:
        return None
    from mech_twin.parameters.load import machine_of_prefix

    return machine_of_prefix(text)

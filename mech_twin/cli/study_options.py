# SPDX-License-Identifier: Apache-2.0
"""What the options of ``mech-twin study`` are written in: axes, limits, bounds; and what all answers share."""

from __future__ import annotations

import math
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import yaml

from mech_twin.capabilities.progress import listening
from mech_twin.cli.console import FIRST_ESTIMATE_S, counted, estimate, print_numbers, say
from mech_twin.cli.failure import CommandError
from mech_twin.files.output_file import check_output_file
from mech_twin.parameters.yaml_text import scalar
from mech_twin.process.dependencies import require_extra
from mech_twin.studies.asking import asked_of

Value = TypeVar("Value")
RANGE = "from:to:count, from:to:count:log or a,b,c"
MOST_VALUES = 1_000_000
HELP = "help"  # in place of a limit


def axes_of(texts: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """Return keys and values of ``KEY=from:to:count``, ``KEY=from:to:count:log`` or ``KEY=a,b,c``."""
    axes = {}
    for text in texts:
        key, equals, values = text.partition("=")
        if not equals or not key.strip() or not values.strip():
            raise CommandError(f"--over {text}: expected KEY={RANGE}")
        if key.strip() in axes:
            raise CommandError(f"--over {text}: key '{key.strip()}' stands twice")
        axes[key.strip()] = _range(text, values) if ":" in values else _list(text, values)
    return axes


def _range(text: str, values: str) -> tuple[float, ...]:
    parts = values.split(":")
    logarithmic = len(parts) == 4 and parts[3] == "log"
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError) as error:
        raise CommandError(f"--over {text}: expected {RANGE}") from error
    if (len(parts) > 3 and not logarithmic) or not (math.isfinite(low) and math.isfinite(high)):
        raise CommandError(f"--over {text}: expected {RANGE}, numbers finite")
    if not 1 <= count <= MOST_VALUES or (logarithmic and min(low, high) <= 0.0):
        raise CommandError(f"--over {text}: expected 1 to {MOST_VALUES} values, above 0 where the range is log")
    if count == 1:
        return (low,)
    if logarithmic:
        ratio = math.log(high / low) / (count - 1)
        return (low, *(low * math.exp(ratio * i) for i in range(1, count - 1)), high)
    return (low, *(low + (high - low) * i / (count - 1) for i in range(1, count - 1)), high)


def _list(text: str, values: str) -> tuple[Any, ...]:
    try:
        found = scalar(f"[{values}]")
    except yaml.YAMLError as error:
        raise CommandError(f"--over {text}: expected {RANGE}") from error
    if not found or not all(isinstance(value, int | float | str | bool) for value in found):
        raise CommandError(f"--over {text}: expected {RANGE}")
    return tuple(found)


def shows_limits(texts: Sequence[str], machine: str, capability: str) -> bool:
    """Show a study's limits with their usual values where ``help`` is asked for; return whether it was."""
    if HELP not in texts:
        return False
    with study_errors():
        question = asked_of(machine, capability, f"nothing to {capability}")
    print_numbers(f"{machine}: limits and their usual values", dict(question.limits))
    return True


def limits_of(texts: Sequence[str]) -> dict[str, float]:
    """Return names and numbers of ``NAME=VALUE``."""

    def number(values: str) -> float:
        if math.isnan(found := float(values)):
            raise ValueError
        return found

    return _assigned("--limit", texts, "NAME=NUMBER", number)


def ranges_of(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return names and ranges of ``NAME=LOW:HIGH``, either left out where there is none; a number alone is HIGH."""

    def ends(values: str) -> tuple[float, float]:
        low, _, high = values.rpartition(":")
        return float(low or -math.inf), float(high or math.inf)

    return _assigned("--limit", texts, "NAME=HIGH or NAME=LOW:HIGH", ends)


def bounds_of(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return names and bounds of ``NAME=LOW:HIGH``, or of ``NAME=VALUE`` for a variable that is held."""

    def ends(values: str) -> tuple[float, float]:
        low, _, high = values.partition(":")
        return float(low), float(high or low)

    bounds = _assigned("--bound", texts, "NAME=LOW:HIGH", ends)
    for name, (low, high) in bounds.items():
        if low > high:
            raise CommandError(
                f"--bound {name}={low:g}:{high:g}: bounds of {name}: the lower bound is above the upper one; "
                f"expected {name}={high:g}:{low:g}"
            )
    return bounds


def _assigned(option: str, texts: Sequence[str], expected: str, read: Callable[[str], Value]) -> dict[str, Value]:
    """Return what stands behind each ``NAME=`` as ``read`` has it, which raises a ValueError where it cannot."""
    found = {}
    for text in texts:
        name, equals, values = text.partition("=")
        try:
            value = read(values)
        except ValueError as error:
            raise CommandError(f"{option} {text}: expected {expected}") from error
        if not equals or not name.strip():
            raise CommandError(f"{option} {text}: expected {expected}")
        found[name.strip()] = value
    return found


def checked_output(asked: Any, usual: str, suffixes: Sequence[str], *extras: str) -> Path:
    """Return the file that a study writes: the one asked for, else the usual one of the machine.

    Raises
    ------
    OutputError, ImportError
        It, or the report, could not be written, or a library for it is not installed.
    """
    out = asked.out or Path(f"{Path(asked.machine).stem}-{usual}")
    check_output_file(out, force=asked.force, suffixes=suffixes)
    check_report(asked.report, force=asked.force)
    for extra in extras:
        require_extra(extra)
    return out


def check_report(report: Path | None, *, force: bool) -> None:
    """Raise an OutputError where the report could not be written."""
    if report is not None:
        check_output_file(report, force=force, suffixes=(".html",))


@contextmanager
def study_errors() -> Iterator[None]:
    """Turn a configuration that a study refuses, or a file that cannot be written, into a failed command."""
    from pydantic import ValidationError

    from mech_twin.declarations.configuration_tree import ConfigurationError
    from mech_twin.parameters.errors import refusal

    try:
        yield
    except ConfigurationError:
        raise
    except ValidationError as error:
        raise refusal("this study", error) from error
    except OSError as error:
        raise CommandError(f"{error.filename}: cannot be written: {error.strerror}") from error


@contextmanager
def told(title: str) -> Iterator[None]:
    """Show how far an answer says it is; where no terminal listens, how long it will take, once."""
    with counted(title) as bar, listening(bar or _estimate_said_once(title)):
        yield


def _estimate_said_once(title: str) -> Callable[[int, int], None]:
    first: tuple[float, int] | None = None  # when, and how much was done: the first step loads and compiles
    said = False

    def say_estimate(done: int, total: int) -> None:
        nonlocal first, said
        now = time.monotonic()
        first = first or (now, done)
        elapsed_s, since = now - first[0], done - first[1]
        if not said and since > 0 and elapsed_s > FIRST_ESTIMATE_S:
            said = True
            say(f"{title}: {done} of about {total} steps, {estimate(since, total - first[1], elapsed_s)}")

    return say_estimate


def notes_of(**asked: object) -> list[str]:
    """Return what a written file says of itself: the command, and what was asked; what is None is left out."""
    command = f"  {shlex.join(['mech-twin', *sys.argv[1:]])}"
    return [command, *(f"{name}: {_listed(value)}" for name, value in asked.items() if value is not None)]


def _listed(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)

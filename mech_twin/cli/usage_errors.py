# SPDX-License-Identifier: Apache-2.0
"""A command line that cannot be read, in the words of all other errors: what was typed, then what was expected."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from itertools import pairwise
from typing import Any

from mech_twin.cli.failure import CommandError

UNEXPECTED = "Got unexpected extra argument"


@contextmanager
def own_words(context: Any, typed: Sequence[str]) -> Iterator[None]:
    """Turn an error of the command line library into one line of ours.

    Parameters
    ----------
    context : Context
        Of the command that reads the words.
    typed : sequence of str
        The words after the command's name.
    """
    from typer.exceptions import TyperException

    try:
        yield
    except TyperException as error:
        raise CommandError(_line(error, context, typed)) from error


def refuse_options_as_values(parameters: Sequence[Any], typed: Sequence[str]) -> None:
    """Raise where an option is followed by an option instead of its value.

    Raises
    ------
    CommandError
        Naming both, and what was expected between them.
    """
    options = _options(parameters)
    for word, following in pairwise(typed):
        option = options.get(word)
        if word == "--":
            return
        if option is None or getattr(option, "is_flag", False):
            continue
        if following in options or re.match(r"--\w", following):
            raise CommandError(f"{word} {following}: expected {_meaning(option)}, found an option")


def _line(error: Any, context: Any, typed: Sequence[str]) -> str:
    asked, option = getattr(error, "param", None), getattr(error, "option_name", None)
    if option is not None and hasattr(error, "possibilities"):
        return _no_such_option(option, context)
    if option is not None:
        known = _options(context.command.get_params(context))[option]
        return f"{option} takes no value" if known.is_flag else f"missing value of {option}: expected {_meaning(known)}"
    if hasattr(error, "param_type") and asked is not None:
        kind = "option " if asked.param_type_name == "option" else ""
        return f"missing {kind}{_name(asked)}: expected {asked.help}"
    if asked is not None:
        return _refused(asked, error.message, typed)
    if str(error.message).startswith(UNEXPECTED):
        words = re.findall(r"\(([^()]*)\)$", error.message)
        return f"unexpected '{words[0] if words else ''}'; expected {_usage(context)}"
    return str(error.format_message())


def _no_such_option(option: str, context: Any) -> str:
    options = _options(context.command.get_params(context))
    longer = [name for name in options if name.startswith(option) and option.startswith("--")]
    near = longer or get_close_matches(option, options, 1)
    where = _path(context)
    if near:
        return f"no option '{option}' of {where}; did you mean '{_name(options[near[0]], near[0])}'?"
    return f"no option '{option}' of {where}; `{where} --help` lists them"


def _refused(asked: Any, message: str, typed: Sequence[str]) -> str:
    """Return the line of a value that was not taken: what was typed stands beside its option."""
    said = re.sub(r"^Input should be (.*?)(, unable to parse.*)?$", r"expected \1", message, flags=re.DOTALL)
    said = said.replace("expected a valid", "expected a").replace("expected a integer", "expected an integer")
    said = re.sub(r"^expected (greater|less)", r"expected a value \1", said)
    found = [option for option in asked.opts if _value_of(option, typed) is not None]
    name = found[0] if found else _name(asked)
    value = _value_of(found[0], typed) if found else None
    shown = name if value is None else f"{name} {value}"
    return f"{shown}: {said.removeprefix(f'{value}: ')}"


def _value_of(option: str, typed: Sequence[str]) -> str | None:
    """Return the value that was typed last after an option."""
    beside = [following for word, following in pairwise(typed) if word == option]
    joined = [word.partition("=")[2] for word in typed if word.startswith(f"{option}=")]
    return [*joined, *beside][-1] if joined or beside else None


def _options(parameters: Sequence[Any]) -> dict[str, Any]:
    """Return the options of a command by each of their names."""
    return {name: each for each in parameters if each.param_type_name == "option" for name in each.opts}


def _name(parameter: Any, name: str | None = None) -> str:
    """Return a parameter as the help has it: ``--duration TIME``, ``MACHINE``."""
    if parameter.param_type_name == "argument":
        return str(parameter.metavar)
    return f"{name or parameter.opts[0]} {parameter.metavar or ''}".strip()


def _meaning(option: Any) -> str:
    return f"{option.metavar} ({option.help})"


def _path(context: Any) -> str:
    """Return the command as it is typed: ``mech-twin study MACHINE sweep``."""
    if context.parent is None:
        return str(context.info_name)
    return " ".join([_path(context.parent), *_places(context.parent), context.info_name])


def _usage(context: Any) -> str:
    return " ".join([_path(context), *_places(context), "[OPTIONS]"])


def _places(context: Any) -> list[str]:
    arguments = [each for each in context.command.get_params(context) if each.param_type_name == "argument"]
    return [each.metavar if each.required else f"[{each.metavar}]" for each in arguments]

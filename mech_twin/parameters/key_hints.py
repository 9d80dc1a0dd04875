# SPDX-License-Identifier: Apache-2.0
"""Keys of a configuration, their units, and suggestions for unknown keys."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import get_args, get_origin

import yaml
from pydantic import BaseModel

ANY_NAME = "NAME"  # replaces the user's own name of an element
PLACE = re.compile(r"(?:(?<=_m)\.[a-z]\w*)?\.[01]$")  # index of a number in a list: a vector, or a named point


def key_units(model: type[BaseModel], prefix: str = "") -> dict[str, str]:
    """Return every dotted key of a parameter model that has a value, with its unit (empty without one)."""
    units: dict[str, str] = {}
    for name, field in model.model_fields.items():
        extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
        groups = list(_models(field.annotation))
        named = f"{ANY_NAME}." if get_origin(field.annotation) is dict else ""
        for group in groups:
            units |= key_units(group, f"{prefix}{name}.{named}")
        if not groups:
            units[f"{prefix}{name}"] = str(extra.get("unit", ""))
    return units


def declared_key(key: str, units: Mapping[str, str]) -> str:
    """Return a key as its model declares it, where ``NAME`` replaces the user's name of an element.

    A number in a list, such as ``bodies.rod.points_m.end.0``, is declared by the key of the list.
    """
    group, _, rest = key.partition(".")
    named = f"{group}.{ANY_NAME}.{rest.partition('.')[2]}"
    spelled = (key, named, PLACE.sub("", key), PLACE.sub("", named))
    return next((known for known in spelled if known in units), key)


def _models(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def nearest_key(key: str, known: Iterable[str]) -> str | None:
    """Return the key that was probably meant: one with this key as its beginning, else a similar one."""
    names = list(known)
    if key in names:
        return key
    longer = [name for name in names if name.startswith(f"{key}_")]
    if longer:
        return min(longer, key=len)
    near = get_close_matches(key, names, 1, 0.7)
    if near:
        return near[0]
    last = key.rpartition(".")[2]
    same = [name for name in names if name.rpartition(".")[2] == last or name.rpartition(".")[2].startswith(f"{last}_")]
    return min(same, key=len) if same else next(iter(get_close_matches(key, names, 1)), None)


def did_you_mean(key: str, units: Mapping[str, str]) -> str:
    """Return ``; did you mean 'body.spring_rate_n_per_m' (N/m)?``, or an empty string without a similar key."""
    meant = nearest_key(key, units)
    if meant is None:
        return ""
    unit = units[meant]
    return f"; did you mean '{meant}'{f' ({unit})' if unit not in ('', '1') else ''}?"


def groups_of(keys: Iterable[str]) -> dict[str, str]:
    """Return every group of these keys in the form of `key_units`, with an empty unit."""
    parts = [key.split(".") for key in keys]
    return {".".join(part[:depth]): "" for part in parts for depth in range(1, len(part))}


SECTION = "ros__parameters"
KeyLines = Callable[[], Mapping[str, int]]


def no_lines() -> dict[str, int]:
    """Return no line numbers, for values that do not come from a file."""
    return {}


def key_lines(text: str, elsewhere: Iterable[str] = ()) -> dict[str, int]:
    """Return the line number of each dotted key in a parameter file, without keys ``elsewhere`` and their groups."""
    found: dict[str, int] = {}
    document = yaml.compose(text, Loader=yaml.SafeLoader)
    sections = document.value if isinstance(document, yaml.MappingNode) else []
    for _, section in sections:
        for name, group in section.value if isinstance(section, yaml.MappingNode) else []:
            if name.value == SECTION:
                for key, line in _lines(group, ""):
                    found.setdefault(key, line)
    if not found and isinstance(document, yaml.MappingNode):  # a page without the head of a parameter file
        found = dict(_lines(document, ""))
    left_out = {key[: len(key) - cut] for key in elsewhere for cut in _dots(key)}
    return {key: line for key, line in found.items() if key not in left_out}


def _lines(node: yaml.Node, prefix: str) -> Iterator[tuple[str, int]]:
    if not isinstance(node, yaml.MappingNode):
        return
    for key, value in node.value:
        yield f"{prefix}{key.value}", key.start_mark.line + 1
        yield from _lines(value, f"{prefix}{key.value}.")


def _dots(key: str) -> list[int]:
    """Return the numbers of characters to remove from a key's end for the key itself and each of its groups."""
    return [0, *(len(key) - place for place, letter in enumerate(key) if letter == ".")]

# SPDX-License-Identifier: Apache-2.0
"""On which line of a parameter file a key stands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import yaml

SECTION = "ros__parameters"
KeyLines = Callable[[], Mapping[str, int]]


def no_lines() -> dict[str, int]:
    """Return no line: the values come from no file."""
    return {}


def key_lines(text: str, elsewhere: Iterable[str] = ()) -> dict[str, int]:
    """Return the line of each dotted key of a parameter file; not of those, and their groups, given elsewhere."""
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
    """Return how many characters to cut from a key's end for the key itself and each of its groups."""
    return [0, *(len(key) - place for place, letter in enumerate(key) if letter == ".")]

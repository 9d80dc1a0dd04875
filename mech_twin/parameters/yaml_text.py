# SPDX-License-Identifier: Apache-2.0
"""YAML as allowed in a parameter file: no aliases, tags or repeated keys; numbers as ROS 2 parses them."""

from __future__ import annotations

import math
import re
from copy import deepcopy
from functools import lru_cache
from typing import Any

import yaml

DEPTH_LIMIT = 20
LARGEST_BITS, LONGEST_NUMBER = 1023, 1100  # largest bits of an integer; largest length of any number as text


def document_of(text: str) -> Any:
    """Return the parsed text as a copy that the caller may change.

    Raises
    ------
    yaml.YAMLError, ValueError, RecursionError
        It cannot be parsed, or contains what a parameter file may not.
    """
    return deepcopy(_parsed(text))


@lru_cache(maxsize=8)
def _parsed(text: str) -> Any:
    """Return the parsed text, cached so that a batch does not parse the same text for every member."""
    refuse_aliases_and_tags(text)
    return yaml.load(text, Loader=_UniqueKeyLoader)


class NumberLoader(yaml.SafeLoader):
    """A safe loader that reads 1e-3, 1e5 and inf as numbers, as in YAML 1.2 and ROS 2; in YAML 1.1 they are strings."""

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Return an integer in the range of a float64; raise a ConstructorError for a larger one."""
        number = int(super().construct_yaml_int(node)) if len(node.value) <= LONGEST_NUMBER else 0
        if len(node.value) > LONGEST_NUMBER or number.bit_length() > LARGEST_BITS:
            raise yaml.constructor.ConstructorError(None, None, "a number beyond 1e308", node.start_mark)
        return number

    def construct_yaml_float(self, node: yaml.ScalarNode) -> float:
        """Return a float, infinite if too large; YAML 1.1 allows sexagesimal numbers with colons."""
        try:
            return float(super().construct_yaml_float(node)) if len(node.value) <= LONGEST_NUMBER else math.inf
        except OverflowError:
            return math.inf


NumberLoader.add_constructor("tag:yaml.org,2002:int", NumberLoader.construct_yaml_int)
NumberLoader.add_constructor("tag:yaml.org,2002:float", NumberLoader.construct_yaml_float)

NumberLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"^[-+]?(?:(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?|\.?(?:inf|Inf|INF)|\.?(?:nan|NaN|NAN))$"
    ),
    list("-+0123456789.iInN"),
)


class _UniqueKeyLoader(NumberLoader):
    """A loader that rejects a repeated key."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                wrong = f"key {key!r} is not a word; put it in quotes"
                raise yaml.constructor.ConstructorError(None, None, wrong, key_node.start_mark)
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{key}' stands twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def refuse_aliases_and_tags(text: str) -> None:
    """Raise a YAMLError for a text with an alias or a tag, or nested too deeply."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent):
            raise yaml.YAMLError("an alias (*name) is not allowed in a parameter file")
        tag = getattr(event, "tag", None)
        if tag is not None:
            raise yaml.YAMLError(f"a tag ({tag}) is not allowed in a parameter file")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > DEPTH_LIMIT:
                raise yaml.YAMLError(f"nested deeper than {DEPTH_LIMIT} levels")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def scalar(text: str) -> Any:
    """Return the value of a YAML scalar or list."""
    return yaml.load(text, Loader=NumberLoader)

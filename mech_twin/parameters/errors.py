# SPDX-License-Identifier: Apache-2.0
"""Error messages for a rejected configuration: file, key, line, value, and what was expected.

Unknown keys get suggestions, and every key has its unit and declaration.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any, NamedTuple, get_args, get_origin

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters

ANY_NAME = "NAME"  # replaces the user's own name of an element
PLACE = re.compile(r"(?:(?<=_m)\.[a-z]\w*)?\.[01]$")  # index of a number in a list: a vector, or a named point
BOUNDS = frozenset({"greater_than", "greater_than_equal", "less_than", "less_than_equal"})
PURE = "1"
MOST_COMPLAINTS = 20
LONGEST_VALUE = 200
GROUPS = frozenset({"model_type", "dict_type", "model_attributes_type"})
NUMBERS = frozenset({"finite_number", "float_type", "float_parsing", "int_type", "int_parsing"})


class Key(NamedTuple):
    """One key of a configuration: dotted name, declaration, and value (None if the option is absent)."""

    name: str
    field: FieldInfo
    value: Any

    @property
    def live(self) -> bool:
        """Whether the key may change while the machine runs."""
        return bool(_declared(self.field).get("live"))

    @property
    def unit(self) -> str:
        """Unit of a number, empty if none is declared."""
        return str(_declared(self.field).get("unit", ""))


def _declared(field: FieldInfo) -> Mapping[str, Any]:
    return field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}


def keys(parameters: Parameters, prefix: str = "") -> Iterator[Key]:
    """Yield every key of a configuration, nested groups included, but for those that an element does not have."""
    unused = parameters.unused()
    for name, field in type(parameters).model_fields.items():
        if name in unused:
            continue
        value = getattr(parameters, name)
        if isinstance(value, Parameters):
            yield from keys(value, f"{prefix}{name}.")
        elif isinstance(value, dict):  # elements under names chosen by the user
            for own, element in value.items():
                if isinstance(element, Parameters):
                    yield from keys(element, f"{prefix}{name}.{own}.")
                else:
                    yield Key(f"{prefix}{name}.{own}", field, list(element))
        elif not any(_models(field.annotation)):
            yield Key(prefix + name, field, list(value) if isinstance(value, tuple) else value)


def key_units(model: type[BaseModel]) -> dict[str, str]:
    """Return every dotted key of a parameter model that has a value, with its unit (empty without one)."""
    return {key: unit for key, unit, _ in described_keys(model)}


def described_keys(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield every dotted key of a parameter model that has a value, its unit (empty without one) and its meaning."""
    for name, field in model.model_fields.items():
        groups = list(_models(field.annotation))
        named = f"{ANY_NAME}." if get_origin(field.annotation) is dict else ""
        for group in groups:
            yield from described_keys(group, f"{prefix}{name}.{named}")
        if not groups:
            yield f"{prefix}{name}", str(_declared(field).get("unit", "")), field.description or ""


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
    longer = [name for name in names if name.startswith(key)]
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


def parameter_nodes(text: str) -> list[yaml.MappingNode]:
    """Return the nodes with parameters: below each section's head, or a page as a whole, which has no head."""
    document = yaml.compose(text, Loader=yaml.SafeLoader)
    sections = [section for _, section in document.value] if isinstance(document, yaml.MappingNode) else []
    below = [pair for section in sections if isinstance(section, yaml.MappingNode) for pair in section.value]
    found = [group for name, group in below if name.value == SECTION and isinstance(group, yaml.MappingNode)]
    return found or [node for node in (document,) if isinstance(node, yaml.MappingNode)]


def key_lines(text: str, elsewhere: Collection[str]) -> dict[str, int]:
    """Return the line number of each dotted key in a parameter file, without keys ``elsewhere`` and their groups."""
    left_out = {*elsewhere, *groups_of(elsewhere)}
    found = [pair for node in reversed(parameter_nodes(text)) for pair in _lines(node, "")]  # the first one counts
    return {key: line for key, line in found if key not in left_out}


def _lines(node: yaml.Node, prefix: str) -> Iterator[tuple[str, int]]:
    for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
        yield f"{prefix}{key.value}", key.start_mark.line + 1
        yield from _lines(value, f"{prefix}{key.value}.")


def refusal(
    source: str, error: ValidationError, model: type[BaseModel] | None = None, lines: KeyLines = dict
) -> ConfigurationError:
    """Return an error of one line with every wrong key, its value and what was expected.

    Parameters
    ----------
    model : type, optional
        Validated model, for units and for suggestions of similar keys.
    lines : callable
        Returns the line number of each key in its file.
    """
    units = key_units(model) if model is not None else {}
    placed = lines()
    every = error.errors()
    wholes = {item["loc"][:depth] for item in every for depth in range(len(item["loc"]))}
    found = [item for item in every if item["loc"] not in wholes]  # a list counts only the parts that are right
    more = [f"and {len(found) - MOST_COMPLAINTS} more"] if len(found) > MOST_COMPLAINTS else []
    complaints = [_complaint(dict(item), units, placed) for item in found[:MOST_COMPLAINTS]]
    return ConfigurationError(f"{source}: " + "; ".join(complaints + more))


def _complaint(item: dict[str, Any], units: Mapping[str, str], lines: Mapping[str, int]) -> str:
    key = ".".join(map(str, item["loc"]))
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
    value = "" if isinstance(item["input"], dict) else f", value {shown_value(item['input'])}"
    return f"key '{key}'{f' ({line})' if line else ''}{value}: {_expected(message, kind, unit)}"


def shown_value(value: Any) -> str:
    """Return the representation of a value, shortened."""
    text = repr(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}..."


def _expected(message: str, kind: str, unit: str) -> str:
    if kind in GROUPS:
        return "expected a group of keys"
    if kind == "tuple_type":
        return f"expected a list in brackets, [first, second]{f', in {unit}' if unit else ''}"
    said = f"{message[0].lower()}{message[1:]}".replace("tuple should have", "expected")
    said = said.removesuffix(" after validation").replace(" after validation, not ", ", got ")
    if not unit:
        return said
    return f"{said} {unit}" if kind in BOUNDS else f"{said}, in {unit}" if kind in NUMBERS else said

# SPDX-License-Identifier: Apache-2.0
"""Writes the configuration chosen by a study into a copy of its base file: comments are kept, changes are marked."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from mech_twin import __version__
from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.output_file import written_file
from mech_twin.parameters.description import description_text
from mech_twin.parameters.errors import parameter_nodes
from mech_twin.parameters.load import (
    MACHINE_KEY,
    NAME_KEY,
    catalogue_entry,
    configuration_file,
    configuration_text,
    is_page,
    kind_of,
    text_tree,
    validated,
)

MOTOR = "motor"


class TextPlace(NamedTuple):
    """Position of a value in a text, or, if empty, where a line can be inserted at the start of a group.

    ``flow`` is true if the group is in braces, where a comment is not possible.
    """

    begin: int
    end: int
    column: int
    flow: bool


def write_configuration(
    name: str, parameters: Parameters, path: Path, base: Path | None = None, notes: Sequence[str] = ()
) -> None:
    """Write the parameter file of a machine for ``run`` and ``simulate``; an existing file is replaced.

    Parameters
    ----------
    base : Path, optional
        File that the configuration was derived from; the installed one if absent.  Its comments are kept.
    notes : sequence of str
        Comment lines for the head: command, objective, seed.
    """
    text = configured_text(name, parameters, base or configuration_file(name), notes)
    with written_file(path, force=True) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def configured_text(name: str, parameters: Parameters, base: Path, notes: Iterable[str] = ()) -> str:
    """Return the text of ``base`` with the values of these parameters; comments give the previous values.

    A configuration whose structure differs from the base is written without comments.
    """
    head = "".join(f"# {line}\n" for line in (f"{name}, written by mech-twin {__version__}", *notes))
    text = configuration_text(base)
    candidate = head + _with_values(name, text, parameters, str(base))
    return candidate if _reads_as(candidate, name, parameters) else head + description_text(kind_of(name), parameters)


def _reads_as(text: str, name: str, parameters: Parameters) -> bool:
    try:
        return validated(catalogue_entry(name), text_tree(text, name), name) == parameters
    except ConfigurationError:
        return False


def _with_values(name: str, text: str, parameters: Parameters, source: str) -> str:
    """Return the text with the changed values, replaced from the end so that positions stay valid."""
    before = dict(leaves(configuration_tree(validated(catalogue_entry(name), text_tree(text, source), source))))
    wanted = dict(leaves(configuration_tree(parameters)))
    wanted |= {} if is_page(name) else {MACHINE_KEY: name}
    values, groups = _places(text)
    changed = {key: value for key, value in wanted.items() if before.get(key) != value and key != MACHINE_KEY}
    edits = []
    for key, value in changed.items():
        if (place := values.get(key)) is not None:
            before_it = "" if place.flow else f"  # was {text[place.begin : place.end].strip()};"
            edits.append((place, _shown(value) + before_it))
    keys = [key for key in (MACHINE_KEY, *changed) if key in wanted and key not in values]
    new = {key: wanted[key] for key in keys if not _of_catalogue(key, wanted)}
    gone = [values[key] for key in before if key in values and key not in wanted]
    edits += [(_line_of(text, place), "# ") for place in gone if not place.flow]
    edits += [(groups[group], _line(rest, groups[group])) for group, rest in _by_group(new, groups).items()]
    for place, words in sorted(edits, key=lambda edit: -edit[0].begin):
        text = text[: place.begin] + words + text[place.end :]
    return text


def _of_catalogue(key: str, wanted: Mapping[str, Any]) -> bool:
    """Return whether a key is a motor value that the motor's catalogue name determines."""
    return key.startswith(f"{MOTOR}.") and f"{MOTOR}.{NAME_KEY}" in wanted


def _line_of(text: str, place: TextPlace) -> TextPlace:
    """Return the index of the first word of the line that holds a value."""
    start = text.rfind("\n", 0, place.begin) + 1
    begin = start + len(text[start:]) - len(text[start:].lstrip())
    return TextPlace(begin, begin, place.column, flow=False)


def _line(values: Mapping[str, Any], place: TextPlace) -> str:
    end = ", " if place.flow else f"\n{' ' * place.column}"
    return "".join(f"{key}: {_shown(value)}{end}" for key, value in values.items())


def _by_group(new: Mapping[str, Any], groups: Mapping[str, TextPlace]) -> dict[str, dict[str, Any]]:
    """Return values without a line as trees, by the innermost group that has a line."""
    found: dict[str, dict[str, Any]] = {}
    for key, value in new.items():
        parts = key.split(".")
        depth = next(depth for depth in range(len(parts) - 1, -1, -1) if ".".join(parts[:depth]) in groups)
        branch = found.setdefault(".".join(parts[:depth]), {})
        for part in parts[depth:-1]:
            branch = branch.setdefault(part, {})
        branch[parts[-1]] = value
    return found


def leaves(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value of a configuration tree under its dotted key."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _places(text: str) -> tuple[dict[str, TextPlace], dict[str, TextPlace]]:
    """Return the position of each value by its dotted key, and the start of each group by its key."""
    values: dict[str, TextPlace] = {}
    groups: dict[str, TextPlace] = {}
    for node in parameter_nodes(text):
        _find(node, "", values, groups)
    return values, groups


def _find(node: yaml.MappingNode, path: str, values: dict[str, TextPlace], groups: dict[str, TextPlace]) -> None:
    """Add the positions of a group and of all its descendants."""
    start, flow = node.start_mark, bool(node.flow_style)
    behind = start.index + flow  # skips the brace
    groups.setdefault(path, TextPlace(behind, behind, start.column, flow))
    for key, value in node.value:
        below = f"{path}.{key.value}" if path else str(key.value)
        if isinstance(value, yaml.MappingNode):
            _find(value, below, values, groups)
        else:
            begin, end = value.start_mark, value.end_mark
            values.setdefault(below, TextPlace(begin.index, end.index, begin.column, flow))


def _shown(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True, width=10_000).removesuffix("\n").removesuffix("\n...")

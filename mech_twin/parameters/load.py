# SPDX-License-Identifier: Apache-2.0
"""YAML configuration -> validated parameter models.  The only place that reads configuration.

A configuration file has the form of a ROS 2 parameter file, so that one file serves a node and the engine::

    /**:
      ros__parameters:
        motor:
          rated_power_w: 1500.0

It has no aliases, tags or repeated keys, and numbers are parsed as ROS 2 does.  It may name a motor of the catalogue
instead of giving its data.
"""

import math
import os
import re
import sys
from collections.abc import Iterable, Mapping
from copy import deepcopy
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from mech_twin.capabilities.arguments import by_name
from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.input_file import opened_input
from mech_twin.machines.catalog import CATALOGUE, Entry
from mech_twin.parameters.errors import LONGEST_VALUE, KeyLines, key_lines, refusal, shown_value
from mech_twin.roles import Machine

DEPTH_LIMIT = 20
LARGEST_BITS, LONGEST_NUMBER = 1023, 1100  # largest bits of an integer; largest length of any number as text


@lru_cache(maxsize=8)
def _tree_of(text: str) -> Any:
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


NAME_KEY = "catalogue_name"
SIZE_LIMIT_BYTES = 1_000_000
MACHINE_KEY = "machine"
MOTOR_KEY, DRIVES_KEY = "motor", "drives"
MOTOR_TABLE = "motors_4a"
ROS_KEYS = frozenset({"use_sim_time", "qos_overrides", "start_type_description_service"})
RUN_GROUP = "run"  # settings of the nodes, not of the machine
PAGE = Entry("page", "planar machine of one's own from a page", kernels=150)
PAGE_SUFFIXES = (".yaml", ".yml")
PAGE_GROUPS = frozenset({"bodies", "joints"})  # identify a page without the head of a parameter file


@lru_cache(maxsize=4)
def _parsed(text: str) -> Any:
    """Return the parsed table, cached so that a study does not parse the same text for every configuration."""
    return yaml.safe_load(text)


def with_catalogue_motor(tree: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Return the tree with the data of each motor that it names, in place of all those of another motor of the table.

    Raises
    ------
    ConfigurationError
        If the table has no such motor, or the tree has a value that differs from the table's and is of no whole row.
    """
    found = dict(tree)
    if isinstance(found.get(MOTOR_KEY), dict):
        found[MOTOR_KEY] = _with_data(found[MOTOR_KEY], MOTOR_KEY, source)
    if isinstance(found.get(DRIVES_KEY), dict):  # of a page
        found[DRIVES_KEY] = {
            name: {**drive, MOTOR_KEY: _with_data(drive[MOTOR_KEY], f"{DRIVES_KEY}.{name}.{MOTOR_KEY}", source)}
            if isinstance(drive, dict) and isinstance(drive.get(MOTOR_KEY), dict)
            else drive
            for name, drive in found[DRIVES_KEY].items()
        }
    return found


def _with_data(motor: dict[str, Any], group: str, source: str) -> dict[str, Any]:
    """Return a group of motor data with the row of the table that it names."""
    if not isinstance(motor.get(NAME_KEY), str):
        return motor
    name, motors = motor[NAME_KEY], table(MOTOR_TABLE)
    if name not in motors:
        expected = f"expected one of {', '.join(motors)} ({MOTOR_TABLE}.yaml)"
        raise ConfigurationError(f"{source}: key '{group}.{NAME_KEY}', value '{name}': {expected}")
    whole = [row for row in motors.values() if all(motor.get(key) == value for key, value in row.items())]
    kept = {key: value for key, value in motor.items() if not any(key in row for row in whole)}
    for key, value in motors[name].items():
        if key in kept and kept[key] != value:
            raise ConfigurationError(
                f"{source}: key '{group}.{key}', value {kept[key]!r}: the named motor {name} has {value!r} in "
                f"{MOTOR_TABLE}.yaml; leave out {group}.{NAME_KEY} or the value"
            )
    return {**kept, **motors[name]}


def is_of_ros(key: str) -> bool:
    """Return whether a parameter is one of every ROS node, as in dumped parameter files, not of the machine."""
    return key.partition(".")[0] in ROS_KEYS


def is_page(name: str | os.PathLike[str]) -> bool:
    """Return whether a machine name is the path of a page."""
    return isinstance(name, str | os.PathLike) and str(name).endswith(PAGE_SUFFIXES)


def catalogue_entry(name: str) -> Entry:
    """Return the machine of this name in the catalogue, or the page entry for the path of a page."""
    text = name if isinstance(name, str) else ""  # anything may come from Python
    if is_page(name) or text == PAGE.name:
        return PAGE
    if text in CATALOGUE:
        return CATALOGUE[text]
    within = [known for known in CATALOGUE if len(str(name)) > 1 and str(name) in known]
    near = get_close_matches(str(name), CATALOGUE, 1) or within
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise ConfigurationError(f"no machine {shown_value(name)}; expected one of {', '.join(CATALOGUE)}{hint}")


def kind_of(name: str) -> str:
    """Return the name of a machine in maps and bags: that of the catalogue, or ``page`` for a page's path."""
    return PAGE.name if is_page(name) else name


def machine_of_prefix(text: str) -> str:
    """Return the only machine whose name has this prefix; a page's path is returned unchanged."""
    if is_page(text):
        if Path(text).is_dir():
            raise ConfigurationError(f"{text}: is a directory; expected a page")
        if not Path(text).is_file():
            raise ConfigurationError(f"{text}: no such page; `mech-twin new KIND > {Path(text).name}` writes one")
        return text
    found = [text] if text in CATALOGUE else [name for name in CATALOGUE if text and name.startswith(text)]
    if len(found) > 1:
        raise ConfigurationError(f"'{text}' begins several machines: {', '.join(found)}")
    return found[0] if found else catalogue_entry(text).name


def configuration_directories() -> list[Path]:
    """Return the possible directories of configurations: source tree, share directories of colcon and pip."""
    source = Path(__file__).resolve().parents[2] / "config"
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    installed = Path(__file__).resolve().parents[5] if len(Path(__file__).resolve().parents) > 5 else Path(sys.prefix)
    prefixes += [installed, Path(sys.prefix)]
    return [*dict.fromkeys([source, *(prefix / "share" / "mech_twin" / "config" for prefix in prefixes)])]


def configuration_file(name: str) -> Path:
    """Return the installed configuration file ``NAME.yaml``; for a page, its own path.

    Raises
    ------
    ConfigurationError
        If no directory contains it.
    """
    if is_page(name):
        return Path(name)
    for directory in configuration_directories():
        path = directory / f"{name}.yaml"
        if path.is_file():
            return path
    looked = f"looked in {', '.join(map(str, configuration_directories()))}"
    where = "a page has no installed file; expected its own, as --config FILE" if name == PAGE.name else looked
    raise ConfigurationError(f"configuration file {name}.yaml not found; {where}")


def file_tree(path: Path) -> dict[str, Any]:
    """Return the parameters of a ROS 2 parameter file as a nested dictionary; see `text_tree`."""
    return text_tree(configuration_text(path), str(path))


def configuration_text(path: Path) -> str:
    """Return the text of a parameter file.

    Raises
    ------
    ConfigurationError
        If it cannot be read, is too large or not UTF-8 text.
    """
    try:
        with opened_input(path) as stream:
            data = stream.read(SIZE_LIMIT_BYTES + 1)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > SIZE_LIMIT_BYTES:
        raise ConfigurationError(f"{path}: larger than {SIZE_LIMIT_BYTES} bytes; expected a parameter file")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: not UTF-8 text at byte {error.start}; expected a YAML file") from error


def text_tree(text: str, source: str) -> dict[str, Any]:
    """Return the parameters in the text of a parameter file; ``source`` is its name in error messages."""
    document = text_document(text, source)
    if isinstance(document, dict) and document.keys() & PAGE_GROUPS:
        return document
    sections = document.values() if isinstance(document, dict) else ()
    trees = [
        section["ros__parameters"] for section in sections if isinstance(section, dict) and "ros__parameters" in section
    ]
    if not trees or not all(isinstance(tree, dict) for tree in trees):
        raise ConfigurationError(
            f"{source}: expected a page with bodies and joints, "
            "or a parameter file with '/**:' and below it 'ros__parameters:'"
        )
    merged: dict[str, Any] = {}
    for tree in reversed(trees):  # the first section is the more specific one and wins
        merged = merged_tree(merged, tree)
    return merged


def document_tree(path: Path) -> dict[str, Any]:
    """Return a YAML file that is not a parameter file, such as a measurement map, as a nested dictionary."""
    document = text_document(configuration_text(path), str(path))
    if not isinstance(document, dict):
        raise ConfigurationError(f"{path}: expected keys and their values, found {type(document).__name__}")
    return document


def text_document(text: str, source: str) -> Any:
    """Return the content of a YAML text, which the caller may change; invalid text is refused in one line."""
    try:
        return deepcopy(_tree_of(text))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        said = str(error).replace('in "<unicode string>", line', "at line")  # the parser's name for a string
        line = " ".join(said.split())[:300] or type(error).__name__
        raise ConfigurationError(f"{source}: not a valid YAML file: {line}") from error


def assignments(texts: Iterable[str]) -> dict[str, Any]:
    """Return overrides written as ``key.path=value``, with values parsed as YAML scalars or lists.

    Raises
    ------
    ConfigurationError
        If a text has no ``=``, its value is not YAML, or a key stands twice.
    """
    flat = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.strip() or key.strip() in flat:
            raise ConfigurationError(f"--set {text[:LONGEST_VALUE]}: expected key.path=value, each key once")
        try:
            refuse_aliases_and_tags(value)
            flat[key.strip()] = scalar(value)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise ConfigurationError(f"--set {key.strip()}: value {shown_value(value)} cannot be read") from error
    return flat


def machine_parameters(name: str, path: Path | None = None, overrides: Mapping[str, Any] | None = None) -> Parameters:
    """Return the validated parameters of a machine.

    Parameters
    ----------
    path : Path, optional
        Configuration file; the installed ``NAME.yaml`` if absent.
    overrides : mapping, optional
        Dotted keys and values that override the file.

    Raises
    ------
    ConfigurationError
        If it is invalid; the message names file, key, value and what was expected.
    """
    entry, expected = catalogue_entry(name), "settings by dotted key, such as {'coupling.step_s': 0.001}"
    file, given = path or configuration_file(name), by_name("settings", overrides, expected)
    text = configuration_text(file)
    read = text_tree(text, str(file))
    source = f"{file} with --set {', '.join(_placed(key, read) for key in given)}" if given else str(file)
    return validated(entry, merged_tree(read, tree_from_flat(given)), source, lambda: key_lines(text, given))


def _placed(key: str, tree: Mapping[str, Any]) -> str:
    """Return a key, with the elements of its group where it names another one."""
    group, _, rest = key.partition(".")
    elements = tree.get(group)
    if not isinstance(elements, dict) or rest.partition(".")[0] in elements:
        return key
    named = elements and all(isinstance(each, dict) for each in elements.values())
    return f"{key} (new: {group} has {', '.join(elements)})" if named else key


def run_group(name: str, path: Path | None = None, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the ``run`` group of a configuration: settings of its nodes, with overrides of the file."""
    tree = merged_tree(file_tree(path or configuration_file(name)), tree_from_flat(overrides or {}))
    group = tree.get(RUN_GROUP, {})
    if not isinstance(group, dict):
        raise ConfigurationError(f"key '{RUN_GROUP}', value {group!r}: expected a group")
    return group


def validated(entry: Entry, tree: Mapping[str, Any], source: str, lines: KeyLines = dict) -> Parameters:
    """Return the validated parameter model of a tree of values; raise a ConfigurationError of one line."""
    values = {key: value for key, value in tree.items() if not is_of_ros(key)}
    values.pop(RUN_GROUP, None)
    meant = values.pop(MACHINE_KEY, entry.name)
    if meant != entry.name:
        use = f"; `{meant} --config FILE` takes it" if entry is PAGE and meant in CATALOGUE else ""
        raise ConfigurationError(f"{source}: key '{MACHINE_KEY}', value {meant!r}: expected {entry.name!r}{use}")
    try:
        return entry.parameters.model_validate(with_catalogue_motor(values, source))
    except ValidationError as error:
        raise refusal(source, error, entry.parameters, lines) from error


def changed_configuration(name: str, base: Parameters, changes: Mapping[str, Any], source: str) -> Parameters:
    """Return the parameters of a machine with other values of some keys (dotted); see `validated`."""
    tree = merged_tree(configuration_tree(base), tree_from_flat(changes, source))
    return validated(catalogue_entry(name), tree, source)


def machine(name: str, path: Path | None = None, overrides: Mapping[str, Any] | None = None) -> Machine:
    """Return the machine built from its configuration; see `machine_parameters`."""
    parameters = machine_parameters(name, path, overrides)
    try:
        return catalogue_entry(name).build(parameters)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path or configuration_file(name)}: {error}") from error


def table(name: str) -> dict[str, Any]:
    """Return an installed table that is not a machine's configuration, such as the motor catalogue."""
    return dict(_parsed(configuration_file(name).read_text(encoding="utf-8")))

# SPDX-License-Identifier: Apache-2.0
"""Declares every key of a parameter model as a ROS 2 parameter with type, range, unit and description.

Offers the services of std_srvs, which answer with success and message.
"""

import types
import typing
from collections.abc import Callable
from typing import Any, Literal

from pydantic.fields import FieldInfo
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, ParameterEvent
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events

from mech_twin.declarations.configuration_tree import ConfigurationError, tree_from_flat
from mech_twin.declarations.quantity import Parameters
from mech_twin.machines.catalog import CATALOGUE, Entry
from mech_twin.parameters.errors import PURE, Key, keys
from mech_twin.parameters.load import MACHINE_KEY, PAGE, is_of_ros, kind_of, machine_parameters, validated

UNBOUNDED = 1.7e308
SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


def _choices(annotation: Any) -> list[str]:
    """Return the allowed words of a key; none if it is not restricted to words."""
    options = typing.get_args(annotation) if isinstance(annotation, types.UnionType) else (annotation,)
    return [str(word) for option in options if typing.get_origin(option) is Literal for word in typing.get_args(option)]


def descriptor(key: Key) -> ParameterDescriptor:
    """Return the ROS parameter descriptor of a key: description with unit, range, and whether it is read-only."""
    text = f"{key.field.description or key.name}{f' [{key.unit}]' if key.unit else ''}"
    described = ParameterDescriptor(name=key.name, description=text, read_only=not key.live)
    choices = _choices(key.field.annotation)
    bounds = [f"{sign} {bound:g}" for word, sign in SIGNS.items() for bound in _bounds_of_kind(key.field, word)]
    described.additional_constraints = ", ".join([*([f"one of {', '.join(choices)}"] if choices else []), *bounds])
    if choices:
        described.description += f" ({', '.join(choices)})"
    low, high = _bounds(key.field)
    if low is None and high is None:
        return described
    if isinstance(key.value, float):
        described.floating_point_range = [
            FloatingPointRange(
                from_value=-UNBOUNDED if low is None else float(low),
                to_value=UNBOUNDED if high is None else float(high),
            )
        ]
    elif isinstance(key.value, int) and not isinstance(key.value, bool):
        top = 2**31 if high is None else int(high)
        described.integer_range = [IntegerRange(from_value=-(2**31) if low is None else int(low), to_value=top, step=1)]
    return described


def live_keys(parameters: Parameters) -> list[dict[str, Any]]:
    """Return the keys that may change during a run: name, meaning, unit, value, bounds, choices."""
    found = []
    for key in keys(parameters):
        if not key.live or key.value is None or isinstance(key.value, list):
            continue
        low, high = _bounds(key.field)
        found.append(
            {
                "name": key.name,
                "meaning": key.field.description or "",
                "unit": "" if key.unit == PURE else key.unit,
                "low": low,
                "high": high,
                "choices": _choices(key.field.annotation),
                "value": key.value,
            }
        )
    return found


def _bounds(field: FieldInfo) -> tuple[float | None, float | None]:
    low, high = (
        next((bound for word in words for bound in _bounds_of_kind(field, word)), None)
        for words in (("ge", "gt"), ("le", "lt"))
    )
    return low, high


def _bounds_of_kind(field: FieldInfo, word: str) -> list[float]:
    """Return the bounds of a kind that a key has: one or none."""
    return [getattr(bound, word) for bound in field.metadata if hasattr(bound, word)]


def watch_parameters(node: Node, namespace: str, changed: Callable[[str, Any], None]) -> None:
    """Call ``changed`` with name and value at each parameter change of the linkage of a namespace."""

    def on_event(event: ParameterEvent) -> None:
        if event.node == f"{namespace}/linkage":
            for each in event.changed_parameters:
                changed(each.name, parameter_value_to_python(each.value))

    node.create_subscription(ParameterEvent, "/parameter_events", on_event, qos_profile_parameter_events)


def declare_range(node: Node, name: str, value: float, text: str, low: float, high: float) -> None:
    """Declare a number, for which rclpy refuses a value out of range."""
    described = ParameterDescriptor(name=name, description=text)
    described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    node.declare_parameter(name, value, described)


def offer(node: Node, kind: Any, name: str, act: Callable[[Any], tuple[bool, str]]) -> None:
    """Offer a service of std_srvs; ``act`` returns success and message of the answer to a request."""

    def answer(request: Any, response: Any) -> Any:
        response.success, response.message = act(request)
        return response

    node.create_service(kind, name, answer)


def machine_override(node: Node) -> str | None:
    """Return the override of a node's parameter ``machine``, as rcl resolves it for its name and namespace."""
    given = node._parameter_overrides.get(MACHINE_KEY)
    return None if given is None else str(given.value)


def declare_machine(node: Node, machine_name: str) -> None:
    """Declare the machine as a read-only parameter.

    Raises
    ------
    ConfigurationError
        If an override names another machine.
    """
    override = machine_override(node)
    if override is not None and kind_of(override) != machine_name:
        where = f"parameters of node {node.get_name()}"
        raise ConfigurationError(f"{where}: key '{MACHINE_KEY}', value {override!r}: expected '{machine_name}'")
    described = ParameterDescriptor(name=MACHINE_KEY, description="machine of the catalogue", read_only=True)
    described.additional_constraints = f"one of {', '.join(CATALOGUE)}"
    node.declare_parameter(MACHINE_KEY, machine_name, described, ignore_override=True)  # which may be a page's path


def given_parameters(node: Node, entry: Entry) -> Parameters:
    """Return the configuration given to a node, without keys that it leaves out; the installed one if it is not whole.

    Raises
    ------
    ConfigurationError
        If the keys of a page, of which no file is installed, make no machine.
    """
    given = {name: parameter.value for name, parameter in node._parameter_overrides.items()}
    try:
        return validated(entry, tree_from_flat(given), f"parameters of node {node.get_name()}")
    except ConfigurationError:
        if entry is PAGE:
            raise
        return machine_parameters(entry.name)


def declared_tree(node: Node, *groups: tuple[str, Parameters]) -> dict[str, Any]:
    """Declare every key on the node and return the values in force: defaults with the node's overrides.

    A value out of range is returned undeclared, for the model to refuse.

    Parameters
    ----------
    node : Node
        Where the keys are declared.
    *groups : tuple of str and Parameters
        Prefix (empty or ending in a dot) and the model declared below it.

    Raises
    ------
    ConfigurationError
        If an override has an unknown key or a wrong type.
    """
    known = {key.name: key for prefix, parameters in groups for key in keys(parameters, prefix)}
    overrides = dict(node._parameter_overrides)  # rclpy has no public access to them
    own = {name for name in overrides if node.has_parameter(name)}
    for name in overrides:
        if name not in known and name not in own and not is_of_ros(name):
            raise ConfigurationError(f"parameters of node {node.get_name()}: unknown key '{name}'")
    flat = {}
    for name, key in known.items():
        if key.value is None and name not in overrides:
            continue
        flat[name] = _declare(node, key, overrides.get(name))
    return tree_from_flat(flat)


def ros_values(parameters: Parameters, prefix: str) -> dict[str, Any]:
    """Return dotted keys that have a value, and the value as ROS parameters have it."""
    return {key.name: _of_ros(key) for key in keys(parameters, prefix) if key.value is not None}


def _of_ros(key: Key) -> Any:
    """Return a value as a ROS parameter, which holds no lists in a list: the rows of a table one after another."""
    value = key.value
    if isinstance(value, list) and value and isinstance(value[0], tuple):
        return [number for row in value for number in row]
    is_float = float in (key.field.annotation, *typing.get_args(key.field.annotation))
    return float(value) if is_float and isinstance(value, int) else value


def _declare(node: Node, key: Key, override: Any) -> Any:
    default = _of_ros(key)
    if default is None:
        default = override.value
    try:
        return node.declare_parameter(key.name, default, descriptor(key)).value
    except InvalidParameterValueException:  # the model has the same bounds, and refuses it in words
        return default if override is None else override.value
    except InvalidParameterTypeException as error:
        given, expected = default if override is None else override.value, type(default).__name__
        raise ConfigurationError(
            f"parameters of node {node.get_name()}: key '{key.name}', value {given!r}: expected {expected}"
        ) from error

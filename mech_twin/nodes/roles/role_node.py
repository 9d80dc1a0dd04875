# SPDX-License-Identifier: Apache-2.0
"""Base of the four role nodes: the machine, and the configuration that the linkage publishes.

A user's class may replace a role inside the process; it is named ``module:Class`` or by entry point.  Its results are
encoded as step messages and decoded again, so they pass the checks of messages from another node.  A refused result,
or an error of the class itself, ends the run with one line.
"""

import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.run import warm_up
from mech_twin.messages.cdr import received_message
from mech_twin.messages.step_message import ANONYMOUS, REVISION, SOURCE, Row, StepCodec, arranged, body, force, motor
from mech_twin.messages.topics import PeakHoldWindow, StreamWindow, Topic, steps_per_window
from mech_twin.nodes.exchange.base_node import RunOptions, TwinNode
from mech_twin.nodes.exchange.counting import DecimatedPublisher
from mech_twin.parameters.errors import keys
from mech_twin.parameters.load import catalogue_entry, is_of_ros
from mech_twin.roles import Machine
from mech_twin.samples import Sample

ENTRY_POINTS = "mech_twin.roles"


class RolePlace(NamedTuple):
    """A replaceable role: the codec of its samples, and its methods."""

    messages: StepCodec[Any]
    methods: tuple[str, ...]

    @property
    def key(self) -> str:
        """The parameter that names the class."""
        return f"run.{self.messages.field}"


OF_ROLES = (RolePlace(motor, ("respond",)), RolePlace(force, ("analyse",)), RolePlace(body, ("start", "follow")))
PLACES: Mapping[str, RolePlace] = {place.messages.field: place for place in OF_ROLES}


class UsersRoleError(ConfigurationError):
    """A class that cannot replace a role."""


class UsersRole:
    """A user's object in place of a role; attributes it lacks are those of the original role.

    Parameters
    ----------
    name : str
        Name of the class as given.
    place : Place
        The role it replaces.
    made : object
        Instance of the user's class.
    own : object
        The original role.
    step_s : float
        Coupling step.
    """

    def __init__(self, name: str, place: RolePlace, made: Any, own: Any, step_s: float) -> None:
        self._name, self._place, self._made, self._own, self._step_s = name, place, made, own, step_s

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if name in self._place.methods:
            return partial(self._checked, name)
        return getattr(self._made, name) if hasattr(self._made, name) else getattr(self._own, name)

    def _checked(self, method: str, *samples: Any) -> Any:
        asked = samples[-1] if method == "follow" else samples[0]
        try:
            answer = getattr(self._made, method)(*samples)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            raise self._refusal(method, f"{type(error).__name__}: {error} ({where})") from error
        try:
            sample = self._place.messages.from_message(
                received_message(self._place.messages.to_bytes(answer)), self._step_s
            )
            joints = getattr(self._own, "joints", None)
            sample = sample if joints is None else arranged(sample, joints)
        except Exception as error:  # it may have returned anything
            raise self._refusal(method, f"returned {type(answer).__name__}, refused: {error}") from error
        if sample.step != asked.step:
            raise self._refusal(method, f"answered step {sample.step}, expected {asked.step}")
        return sample

    def _refusal(self, method: str, why: str) -> UsersRoleError:
        return UsersRoleError(f"{self._place.key} {self._name}: {method}: {why}")


def with_users_roles(machine: Machine, options: RunOptions) -> Machine:
    """Return a machine with its roles replaced by the classes named in the options.

    Raises
    ------
    UsersRoleError
        If one cannot be loaded, lacks a method, or cannot be made from the machine's parameters.
    """
    named = {role: getattr(options, role) for role in PLACES}
    return replace(machine, **{role: _users_role(name, role, machine) for role, name in named.items() if name})


def _users_role(name: str, role: str, machine: Machine) -> Any:
    place, own = PLACES[role], getattr(machine, role)
    if own is None:
        raise UsersRoleError(f"{place.key} {name}: machine {machine.name} has no {role}")
    try:
        made = _loaded(name, place)(machine.parameters)
    except UsersRoleError:
        raise
    except Exception as error:
        raise UsersRoleError(
            f"{place.key} {name}: cannot be made from the machine's parameters: {type(error).__name__}: {error}"
        ) from error
    lacking = [method for method in place.methods if not callable(getattr(made, method, None))]
    if lacking:
        raise UsersRoleError(f"{place.key} {name}: expected a class with the method {lacking[0]}")
    return UsersRole(name, place, made, own, machine.coupling_step_s)


def _loaded(name: str, place: RolePlace) -> Callable[..., Any]:
    module, colon, attribute = name.partition(":")
    if not colon:
        found = next(iter(entry_points(group=ENTRY_POINTS, name=name)), None)
        if found is None:
            raise UsersRoleError(f"{place.key} {name}: expected MODULE:CLASS, or a name of the group {ENTRY_POINTS}")
        module, attribute = found.module, found.attr
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # last, so that files there do not hide installed modules
    try:
        loaded: Callable[..., Any] = getattr(import_module(module), attribute)
    except Exception as error:
        raise UsersRoleError(f"{place.key} {name}: {type(error).__name__}: {error}") from error
    return loaded


RETRY_S = 0.02


class RoleNode(TwinNode):
    """Base of a node with one role of a machine; see `TwinNode` for the arguments."""

    def __init__(
        self, role: str, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__(role, machine_name, parameters, options)
        self.machine: Machine = self.built(self.initial_parameters)
        warm_up(self.machine)
        self.diagnostics.limits(self.residual_limits(), self.machine.coupling_step_s)
        self.signature = Row(SOURCE, self.source)
        self.stream_window = steps_per_window(self.options.stream_rate_hz, self.machine.coupling_step_s)
        self.revision = 0
        self.described_by = ANONYMOUS
        self.description = ""
        self.on_sample: Callable[[Sample], None] = lambda sample: None
        self._adopting = False
        self._marked: tuple[int, float] | None = None
        self._marks: tuple[Row, ...] = ()
        self.add_on_set_parameters_callback(self.judge_parameters)

    def residual_limits(self) -> Mapping[str, float]:
        """Return the limit of each residual this node publishes."""
        return {}

    @property
    def marks(self) -> tuple[Row, ...]:
        """Rows this node adds to its step messages: configuration of the computation, and source number."""
        if self._marked != (self.revision, self.described_by):
            self._marked = self.revision, self.described_by
            self._marks = Row(REVISION, *self._marked), self.signature
        return self._marks

    def peak_hold_output(self, topic: Topic, message: Callable[[Any], Any]) -> DecimatedPublisher:
        """Return a new publisher of the message of largest magnitude in each window; offer it magnitude and item."""
        return self.decimated_output(topic, PeakHoldWindow(self.stream_window), message)

    def joint_state_output(self, topic: Topic, message: Callable[[Any], bytes]) -> DecimatedPublisher:
        """Return a new publisher of joint states: one per window of steps, more around impacts; see `StreamWindow`."""
        return self.decimated_output(topic, StreamWindow(self.stream_window), message)

    def built(self, parameters: Parameters) -> Machine:
        """Return the machine of these parameters, with roles replaced by the user's classes."""
        return with_users_roles(catalogue_entry(self.machine_name).build(parameters), self.options)

    def use(self, parameters: Parameters) -> None:
        """Rebuild the machine with new parameters, and set the live ones as ROS parameters of this node."""
        if parameters == self.machine.parameters:
            return
        before = {key.name: key.value for key in keys(self.machine.parameters)}
        self.machine = self.built(parameters)
        self.diagnostics.limits(self.residual_limits(), self.machine.coupling_step_s)
        changed = [
            Parameter(key.name, value=key.value)
            for key in keys(parameters)
            if key.live and key.value != before.get(key.name)
        ]
        self._adopting = True
        try:
            self.set_parameters(changed)
        finally:
            self._adopting = False

    def judge_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse a change at this node: the linkage distributes parameters, so that all roles change at one step."""
        own = [change.name for change in changes if not is_of_ros(change.name)]
        if self._adopting or not own:
            return SetParametersResult(successful=True)
        names = ", ".join(own)
        return SetParametersResult(successful=False, reason=f"{names}: set it on node linkage, which passes it on")

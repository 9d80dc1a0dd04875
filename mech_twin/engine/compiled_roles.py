# SPDX-License-Identifier: Apache-2.0
"""Roles backed by kernels: convert a sample to a row, call the kernel of `compiled_steps`, convert back.

A derived role defines only its constants (``model``) and the layout of its row (``layout``); motors and force analyses
without a state of their own are given them.  The compiled run uses both too, so its results are bit for bit those of
the role.

The constants stay in compiled memory, so that they are converted once and not at each call: unboxing a `NamedTuple` of
some eighty numbers costs more than the step of most roles.  A role keeps its constants here and calls the kernels below
with them; the results are bit for bit those of `compiled_steps`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numba.core import config, types
from numba.experimental import structref

from mech_twin.engine.compiled_steps import force_step, motor_step, whole_body_step, whole_linkage_step, work_for
from mech_twin.engine.sample_vectors import (
    LOAD_WIDTH,
    Array,
    BodyLayout,
    EventLayout,
    ForceLayout,
    LinkageLayout,
    MotorLayout,
    row_of,
)
from mech_twin.errors import MotionError
from mech_twin.kernels.kernel import kernel
from mech_twin.samples import BodySample, ForceSample, LinkageSample, MotorSample

_settings: Any = config
_types: Any = types
_structref: Any = structref
Layout = TypeVar("Layout")
NO_NUMBERS = np.empty(0)
NO_LOADS = np.empty((0, LOAD_WIDTH))
NO_EVENTS = np.empty((0, EventLayout().width))


if _settings.DISABLE_JIT:

    class Uncompiled:
        """Stand-in for `Held` in interpreted code."""

        def __init__(self, model: Any) -> None:
            self.model = model

    Held: Any = Uncompiled

else:

    @_structref.register
    class HeldType(_types.StructRef):  # type: ignore[misc]
        """The type of constants in compiled memory: one for each type of model."""

    class Held(_structref.StructRefProxy):  # type: ignore[misc, no-redef]
        """Constants in compiled memory."""

    _structref.define_proxy(Held, HeldType, ["model"])


@kernel
def held(model: Any) -> Any:
    """Return a model stored in compiled memory."""
    return Held(model)


@kernel
def held_motor_step(held: Any, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` as `motor_step` does."""
    motor_step(held.model, linkage, target, out)


@kernel
def held_linkage_step(
    held: Any, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill ``out`` as `whole_linkage_step` does."""
    return whole_linkage_step(held.model, step, linkage, motor, body, out, log, work_for(held.model))


@kernel
def held_force_step(held: Any, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array) -> int:
    """Fill ``out`` as `force_step` does."""
    return force_step(held.model, step, linkage, log, count, out, loads, work_for(held.model))


@kernel
def held_body_step(
    held: Any, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill ``out`` as `whole_body_step` does."""
    return whole_body_step(held.model, step, body, forces, loads, count, out, log)


def failed(failures: tuple[str, ...], status: int, begin_s: float) -> MotionError:
    """Return the error for a kernel's negative status, in the step from ``begin_s`` (s)."""
    return MotionError(f"{failures[-1 - status]}, in the step from {begin_s:.6g} s")


class _Compiled(Generic[Layout]):
    """A role whose computation is a kernel."""

    if TYPE_CHECKING:

        @property
        def model(self) -> Any:
            """Constants of the kernel."""
            ...

        @property
        def layout(self) -> Layout:
            """Row of the samples."""
            ...

    @cached_property
    def held(self) -> Any:
        """The constants in compiled memory (see `held`)."""
        return held(self.model)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "held"}


class CompiledMotor(_Compiled[MotorLayout]):
    """A motor computed by a kernel of `motor_step` from the row of the linkage it drives."""

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return the motor at the linkage's step; ``target`` is the required fraction of rated supply frequency."""
        layout, out = self.layout, np.empty(self.layout.size)
        held_motor_step(self.held, row_of(linkage), target, out)
        return layout.of_row(linkage.step, linkage.time_s, out)


class CompiledLinkage(_Compiled[LinkageLayout]):
    """A linkage advanced by a kernel of `linkage_step`."""

    step_s: float

    @property
    def processor_only(self) -> str:
        """Why its steps cannot run on a graphics processor; empty if they can."""
        return ""

    @property
    def failures(self) -> tuple[str, ...]:
        """Messages of the failures of a step, in the order of their status -1, -2, ..."""
        return ()

    def failure(self, status: int, begin_s: float, log: Array) -> MotionError:
        """Return the error for a failed step; ``log`` has the events up to the failure."""
        return failed(self.failures, status, begin_s)

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the linkage one coupling step later, with its events located within the step."""
        layout, out = self.layout, np.empty(self.layout.size)
        led = NO_NUMBERS if body is None else row_of(body)
        log, count = held_linkage_step(
            self.held, linkage.step, row_of(linkage), row_of(motor), led, out, layout.events.table()
        )
        if count < 0:
            raise self.failure(count, linkage.time_s, log)
        step = linkage.step + 1
        return layout.of_row(step, step * self.step_s, out, layout.events.events(log[:count]))


class CompiledForces(_Compiled[ForceLayout]):
    """A force analysis computed by a kernel of `force_step`."""

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return every pin reaction, the derived quantities, and the loads on the body during the step."""
        layout, out = self.layout, np.empty(self.layout.size)
        events = layout.events.rows(linkage.events) if layout.reads_events and linkage.events else NO_EVENTS
        loads = np.empty((len(events), LOAD_WIDTH))
        count = held_force_step(self.held, linkage.step, row_of(linkage), events, len(events), out, loads)
        listed_loads = layout.events.loads(loads[:count]) if count else ()
        return layout.of_row(linkage.step, linkage.time_s, out, listed_loads)


class CompiledBody(_Compiled[BodyLayout]):
    """A body advanced by a kernel of `body_step`, under the row of its forces and their loads."""

    step_s: float
    failures: tuple[str, ...] = ()

    if TYPE_CHECKING:

        @property
        def force_layout(self) -> ForceLayout | None:
            """Row of the forces that act on it, None where none does."""
            ...

    def follow(self, body: BodySample, forces: ForceSample) -> BodySample:
        """Return the body one coupling step later, under the loads of that step."""
        layout, out = self.layout, np.empty(self.layout.size)
        acting, loads = NO_NUMBERS, NO_LOADS
        if self.force_layout is not None:
            acting = row_of(forces)
            loads = self.force_layout.events.rows(forces.loads) if forces.loads else NO_LOADS
        log, count = held_body_step(
            self.held, forces.step, row_of(body), acting, loads, len(loads), out, layout.events.table()
        )
        if count < 0:
            raise failed(self.failures, count, body.time_s)
        return layout.of_row(forces.step, forces.time_s, out, layout.events.events(log[:count]))


@dataclass(frozen=True)
class StepMotor(CompiledMotor):
    """A motor computed by the kernel of `motor_step` for the type of its constants ``model``."""

    model: Any
    joints: tuple[str, ...]

    @cached_property
    def layout(self) -> MotorLayout:
        """Row of the samples."""
        return MotorLayout(self.joints)


@dataclass(frozen=True)
class EffortStepMotor(StepMotor):
    """One that also accepts effort commands, up to ``effort_limit`` (N m, or N)."""

    effort_limit: float


@dataclass(frozen=True)
class StepForces(CompiledForces):
    """A force analysis computed by the kernel of `force_step` for the type of its constants.

    Attributes
    ----------
    model : NamedTuple
        Constants of the kernel.
    layout : ForceLayout
        Row of the samples: pins, quantities, residuals.
    acts_on : tuple of str
        The link on which each pin's wrench acts.
    residual_limits : mapping
        Limit of each residual.
    """

    model: Any
    layout: ForceLayout
    acts_on: tuple[str, ...]
    residual_limits: Mapping[str, float]

    @property
    def pins(self) -> tuple[str, ...]:
        """Names of the pins."""
        return self.layout.bodies

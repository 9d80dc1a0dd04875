# SPDX-License-Identifier: Apache-2.0
"""Roles without a state of their own: each is the constants of a kernel of `compiled_steps`, and names of its row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mech_twin.engine.compiled_roles import CompiledForces, CompiledMotor
from mech_twin.engine.sample_vectors import ForceLayout, MotorLayout


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

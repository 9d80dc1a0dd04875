# SPDX-License-Identifier: Apache-2.0
"""The breaker's motor, linkage, force analysis and body as pure maps between samples, backed by their kernels.

Crank, body and tool move under one set of equations, which the linkage solves.  Angle and rate of the body come to
its role in the row of the forces.  A user's own body can replace it on the topics.  It integrates the moments and
impulses that the force analysis gives at each event and step end, and the linkage then uses its angle.
"""

import math
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_roles import CompiledBody, CompiledLinkage, EffortStepMotor
from mech_twin.engine.compiled_steps import motor_step, step_of
from mech_twin.engine.sample_vectors import COMMAND, Array, BodyLayout, EventLayout, ForceLayout, LinkageLayout, row_of
from mech_twin.machines.drives import KlossMotor, fill_motor, kloss_motor_role
from mech_twin.machines.mb10_breaker.dynamics import FLIGHT, HELD, REST, TURN, Breaker
from mech_twin.machines.mb10_breaker.forces import IN_CONTACT, QUANTITIES, LoadedBreaker, fill_body, pin_forces
from mech_twin.machines.mb10_breaker.joint_laws import CONTACTS
from mech_twin.machines.mb10_breaker.state import KINDS, BreakerMemory, BreakerState, EventSide
from mech_twin.machines.mb10_breaker.step import (
    BODY_AT,
    CRANK_AT,
    FAILURES,
    JOINTS,
    MEMORY_AT,
    RESIDUALS_AT,
    LedBreaker,
    fill_row,
    total_of,
)
from mech_twin.parts.induction_motor import MotorConstants
from mech_twin.roles import CrankState
from mech_twin.samples import BodySample, ForceSample, LinkageSample

DEFECT, USUAL_STEP_S = 1e-5, 1e-3  # of the energy held, by the angle of a body that somebody else moves; at that step
RESIDUALS = ("loop_closure_m", "energy_balance", "momentum_balance", "coupling_defect")
FORCE_RESIDUALS = ("drive_torque_routes", "body_moment_routes", "impulse_routes")
AT_REST = BreakerState(*(0.0 for _ in BreakerState._fields))
EVENTS = EventLayout(KINDS, CONTACTS, len(EventSide._fields))


@dataclass(frozen=True)
class BreakerLinkage(CompiledLinkage):
    """The crank-rocker, its drive and, where the body is led, the body with it."""

    model: LedBreaker
    step_s: float
    initial_crank_rad: float
    initial_command: float
    joints = JOINTS
    coordinates = EventSide._fields
    regimes = ("rest", "flight", "held")
    failures = FAILURES
    layout = LinkageLayout(JOINTS, BreakerMemory._fields, RESIDUALS, EVENTS)

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the residuals."""
        defect = DEFECT * max(1.0, (self.step_s / USUAL_STEP_S) ** 2)
        return dict(zip(RESIDUALS, (1e-12, 1e-9, 1e-9, defect), strict=True))

    @property
    def processor_only(self) -> str:
        """Why its steps cannot run on a graphics processor; empty if they can."""
        return "a blow as a wave makes the cells of its rods" if self.model.breaker.waves else ""

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine at rest, the body on its collar."""
        b, state = self.model.breaker, AT_REST._replace(crank_rad=self.initial_crank_rad % TURN)
        memory = BreakerMemory(energy_j=total_of(b, state).energy_j)
        return self._at(step, step * self.step_s, state, HELD if b.held else REST, memory, 0.0)

    def guided(self, step: int, time_s: float, motion: CrankState) -> LinkageSample:
        """Return the breaker in a measured motion between blows; a body that is not measured rests on its collar.

        The crank's acceleration is linear in the torque, so two evaluations give the torque for the measured one.
        """
        b, (q, u, acceleration, phi, p) = self.model.breaker, motion
        off = phi is not None and phi > 0.0 and not b.held
        regime = HELD if b.held else FLIGHT if off else REST
        body, rate = (phi, p) if off and phi is not None else (0.0, 0.0)
        idle, loaded = (pin_forces(b, q, u, body, rate, t, regime, 0.0).crank_acceleration for t in (0.0, 1.0))
        state = AT_REST._replace(crank_rad=q % TURN, crank_rad_per_s=u, body_rad=body, body_rad_per_s=rate)
        torque = float((acceleration - idle) / (loaded - idle))
        return self._at(step, time_s, state, regime, BreakerMemory(), torque)

    def _at(
        self, step: int, time_s: float, state: BreakerState, regime: int, memory: BreakerMemory, torque_nm: float
    ) -> LinkageSample:
        b, out = self.model.breaker, np.empty(self.layout.size)
        out[MEMORY_AT:RESIDUALS_AT] = memory
        total = total_of(b, state)
        fill_row(b, np.array(state), regime, total, torque_nm, self.initial_command, 0.0, 0.0, out)
        return self.layout.sample(step, time_s, out.tolist(), ())


PINS = ("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing")
ACTS_ON = ("crank", "coupler", "coupler", "rocker")
FORCES = ForceLayout(PINS, QUANTITIES, FORCE_RESIDUALS, EVENTS, reads_events=True)


class GearedMotor(NamedTuple):
    """Constants of the motor role: the drive; 1 where its housing turns with the body."""

    drive: KlossMotor
    frame_drive: float


@step_of(motor_step, GearedMotor)
def geared_motor(model: GearedMotor, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` with the motor at the gear output's angle and speed relative to it: q - phi on the frame, else q."""
    carried = model.frame_drive
    turned = 2.0 * math.pi * linkage[MEMORY_AT] + linkage[CRANK_AT]
    angle = turned - carried * linkage[BODY_AT]
    fill_motor(
        model.drive, linkage[COMMAND], angle, linkage[CRANK_AT + 1] - carried * linkage[BODY_AT + 1], target, out
    )


def breaker_motor(breaker: Breaker, motor: MotorConstants, rate_per_s: float, step_s: float) -> EffortStepMotor:
    """Return the motor, on the frame or on the body, whose gear turns the crank."""
    drive = kloss_motor_role(KlossMotor(motor, breaker.ratio, rate_per_s, step_s))
    return replace(drive, model=GearedMotor(drive.model, breaker.frame_drive))


@dataclass(frozen=True)
class DrivenBody(CompiledBody):
    """The body role for the excitation ``from_forces``."""

    model: LoadedBreaker
    step_s: float
    joints = ("body",)
    regimes = ("rest", "flight", "hanging")
    residual_limits = MappingProxyType[str, float]({})
    layout = BodyLayout(joints, (), ())
    force_layout = FORCES

    def start(self, forces: ForceSample) -> BodySample:
        """Return the body at rest on its collar."""
        out = np.empty(self.layout.size)
        fill_body(self.model.breaker, row_of(forces), IN_CONTACT, out)
        return self.layout.sample(forces.step, forces.time_s, out.tolist(), ())

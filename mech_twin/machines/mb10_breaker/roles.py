# SPDX-License-Identifier: Apache-2.0
"""The breaker's motor, linkage and force analysis as pure maps between samples, backed by their kernels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from types import MappingProxyType

import numpy as np

from mech_twin.engine.compiled_roles import CompiledForces, CompiledLinkage
from mech_twin.engine.sample_vectors import EventLayout, ForceLayout, LinkageLayout
from mech_twin.machines.drives import KlossDrive, KlossMotor
from mech_twin.machines.mb10_breaker.dynamics import FLIGHT, HELD, REST, Breaker
from mech_twin.machines.mb10_breaker.event_rows import CONTACTS
from mech_twin.machines.mb10_breaker.force_row import LoadedBreaker
from mech_twin.machines.mb10_breaker.forces import QUANTITIES, pin_forces
from mech_twin.machines.mb10_breaker.linkage_row import (
    JOINTS,
    MEMORY_AT,
    RESIDUALS_AT,
    GearedMotor,
    LedBreaker,
    fill_row,
    start_row,
)
from mech_twin.machines.mb10_breaker.state import KINDS, BreakerMemory, BreakerState, EventSide, named
from mech_twin.machines.mb10_breaker.step import FAILURES, total_of
from mech_twin.parts.induction_motor import MotorConstants
from mech_twin.roles import CrankState
from mech_twin.samples import LinkageSample

DEFECT, USUAL_STEP_S = 1e-5, 1e-3  # of the energy held, by the angle of a body that somebody else moves; at that step
RESIDUALS = ("loop_closure_m", "energy_balance", "momentum_balance", "coupling_defect")
FORCE_RESIDUALS = ("drive_torque_routes", "body_moment_routes", "impulse_routes")
EVENTS = EventLayout(KINDS, CONTACTS, len(EventSide._fields))


class BreakerMotor(KlossDrive):
    """The motor, on the frame or on the body, whose gear turns the crank.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    motor : MotorConstants
        Torque against slip.
    rate_per_s : float
        Largest change of the supply fraction in a second.
    step_s : float
        Coupling step.
    """

    def __init__(self, breaker: Breaker, motor: MotorConstants, rate_per_s: float, step_s: float) -> None:
        super().__init__(motor, breaker.ratio, rate_per_s, step_s)
        drive = KlossMotor(motor, breaker.ratio, float(rate_per_s), float(step_s), self.direction)
        vars(self)["model"] = GearedMotor(drive, breaker.frame_drive)


class BreakerLinkage(CompiledLinkage):
    """The crank-rocker, its drive and, where the body is led, the body with it.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    initial_crank_rad : float
        Crank angle at the start.
    initial_command : float
        Supply fraction in force at the start.
    step_s : float
        Coupling step.
    curve : MotorConstants
        The motor's torque against slip.
    """

    joints = JOINTS
    coordinates = EventSide._fields
    regimes = ("rest", "flight", "held")
    failures = FAILURES
    layout = LinkageLayout(JOINTS, BreakerMemory._fields, RESIDUALS, EVENTS)

    def __init__(
        self,
        breaker: Breaker,
        initial_crank_rad: float,
        initial_command: float,
        step_s: float,
        curve: MotorConstants,
    ) -> None:
        self.step_s = step_s
        self._b = breaker
        self._initial = initial_crank_rad % (2.0 * math.pi)
        self._command = float(initial_command)
        self._curve = curve
        self.residual_limits: Mapping[str, float] = MappingProxyType(
            {
                "loop_closure_m": 1e-12,
                "energy_balance": 1e-9,
                "momentum_balance": 1e-9,
                "coupling_defect": DEFECT * max(1.0, (step_s / USUAL_STEP_S) ** 2),
            }
        )

    @cached_property
    def model(self) -> LedBreaker:
        """Constants of the kernel."""
        return LedBreaker(self._b, self._curve, float(self.step_s))

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine at rest, the body on its collar."""
        out = np.empty(self.layout.size)
        start_row(self._b, self._initial, self._command, out)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())

    def guided(self, step: int, time_s: float, motion: CrankState) -> LinkageSample:
        """Return the breaker in a measured motion between blows; a body that is not measured rests on its collar.

        The crank's acceleration is linear in the torque, so two evaluations give the torque for the measured one.
        """
        q, u, acceleration, phi, p = motion
        off = phi is not None and phi > 0.0 and not self._b.held
        regime = HELD if self._b.held else FLIGHT if off else REST
        body, rate = (phi, p) if off and phi is not None else (0.0, 0.0)
        idle, loaded = (pin_forces(self._b, q, u, body, rate, t, regime, 0.0).crank_acceleration for t in (0.0, 1.0))
        at_rest = BreakerState(*(0.0 for _ in BreakerState._fields))
        angle = q % (2.0 * math.pi)
        state = at_rest._replace(crank_rad=angle, crank_rad_per_s=u, body_rad=body, body_rad_per_s=rate)
        y, out = np.array(state), np.empty(self.layout.size)
        out[MEMORY_AT:RESIDUALS_AT] = BreakerMemory()
        total, torque = total_of(self._b, named(y)), float((acceleration - idle) / (loaded - idle))
        fill_row(self._b, y, regime, total, torque, self._command, 0.0, 0.0, out)
        return self.layout.sample(step, time_s, out.tolist(), ())


class BreakerForces(CompiledForces):
    """Every pin, the moment on the body and its impulses, from the joint states alone.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    """

    pins = ("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing")
    acts_on = ("crank", "coupler", "coupler", "rocker")
    residual_limits: Mapping[str, float] = MappingProxyType(dict.fromkeys(FORCE_RESIDUALS, 1e-10))
    model: LoadedBreaker
    layout = ForceLayout(pins, QUANTITIES, FORCE_RESIDUALS, EVENTS, reads_events=True)

    def __init__(self, breaker: Breaker) -> None:
        self.model = LoadedBreaker(breaker)

# SPDX-License-Identifier: Apache-2.0
"""Crank-driven linkage with one degree of freedom: prescribed speed or motor torque, with exact changes of regime.

The step is in `crank_step`; the mechanism is given by the kernels listed in `crank_state`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isnan
from typing import Any

import numpy as np

from mech_twin.engine.compiled_roles import CompiledLinkage, failed
from mech_twin.engine.crank_motion import KINDS, sign_of
from mech_twin.engine.crank_state import (
    NO_FRICTION,
    TURN,
    Boundary,
    Crank,
    Memory,
    Resisting,
    ShaftFriction,
    Transmission,
    crank_drive,
    mechanism_state,
)
from mech_twin.engine.crank_step import NO_TORQUE, TurnedCrank, failures_at, start_row
from mech_twin.engine.sample_vectors import EventLayout, LinkageLayout
from mech_twin.roles import CrankState
from mech_twin.samples import LinkageSample

CRANK = "crank"  # the joint whose angle is integrated
SCALE_ANGLES = 72
RESIDUALS = ("loop_closure_m", "energy_balance")


@dataclass(frozen=True)
class CrankLinkage(CompiledLinkage):
    """Linkage driven at its crank; ``transmission`` is None for a prescribed speed.

    ``mechanism`` holds constants of a type for which the functions of `crank_state` are declared.
    """

    mechanism: Any
    step_s: float
    start_angle: float
    start_speed: float
    start_command: float
    joints: tuple[str, ...]
    contact: str
    regimes: tuple[str, ...] = ("free",)
    start_regime: int = 0
    boundaries: tuple[Boundary, ...] = ()
    transmission: Transmission | None = None
    friction: ShaftFriction = NO_FRICTION
    coordinates: tuple[str, ...] = (CRANK,)
    size_m: float = 1.0
    resisting: Mapping[int, Resisting] = field(default_factory=dict)
    energy_scale_j: float = 0.0

    @property
    def failures(self) -> tuple[str, ...]:
        """Messages of the failures of a step."""
        return failures_at(self.step_s)

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limits of the residuals: loop closure (m, times the size of a linkage beyond 1 m), energy balance."""
        return {"loop_closure_m": 1e-12 * max(1.0, self.size_m), "energy_balance": 1e-8}

    def at_rated_speed(self, speed_rad_per_s: float) -> CrankLinkage:
        """Return this linkage with its energy balance scaled by at least the largest energy (J) of a turn at a speed.

        At rest the energies alone would be too small a scale.
        """
        angles = (TURN * i / SCALE_ANGLES for i in range(SCALE_ANGLES))
        speed, regime = float(speed_rad_per_s), self.start_regime
        energies = [mechanism_state(self.mechanism, f, speed, 0.0, regime)[3] for f in angles]
        return replace(self, energy_scale_j=max(map(abs, energies)))

    @cached_property
    def model(self) -> TurnedCrank:
        """Constants of the kernel."""
        kinds = self.layout.events.kinds
        rows = [(b.angle, b.direction, b.before, b.after, kinds.index(b.kind)) for b in self.boundaries]
        resisting = [(regime, load.sense, load.after) for regime, load in self.resisting.items()]
        crank = Crank(
            float(self.step_s),
            float(self.start_angle),
            np.array(rows, dtype=float).reshape(len(rows), 5),
            crank_drive(self.transmission),
            ShaftFriction(*map(float, self.friction)),
            np.array(resisting, dtype=float).reshape(len(resisting), 3),
            float(self.energy_scale_j),
        )
        return TurnedCrank(crank, self.mechanism)

    @cached_property
    def layout(self) -> LinkageLayout:
        """Row of the samples."""
        kinds = tuple(dict.fromkeys((*KINDS, *(boundary.kind for boundary in self.boundaries))))
        return LinkageLayout(
            self.joints, Memory._fields, RESIDUALS, EventLayout(kinds, (CRANK, self.contact), len(self.coordinates))
        )

    def start(self, step: int = 0) -> LinkageSample:
        """Return the linkage at its initial angle and speed; at rest it is held until the first motor sample."""
        out, speed, command = np.empty(self.layout.size), float(self.start_speed), float(self.start_command)
        if not start_row(self.model, float(self.start_angle), speed, 0.0, command, self.start_regime, out):
            raise failed(self.failures, NO_TORQUE, step * self.step_s)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())

    def guided(self, step: int, time_s: float, motion: CrankState) -> LinkageSample:
        """Return the linkage in a measured motion of its crank, with the crank torque by inverse dynamics."""
        f, w, e = map(float, motion[:3])
        out, regime = np.empty(self.layout.size), self._regime_at(f, sign_of(w))
        if not start_row(self.model, f, w, e, float(self.start_command), regime, out):
            raise failed(self.failures, NO_TORQUE, time_s)
        return self.layout.sample(step, time_s, out.tolist(), ())

    def _regime_at(self, f: float, sense: float) -> int:
        """Return the regime at an angle (rad) reached in this sense of rotation: that of the last boundary passed."""
        passed = [
            (TURN * ((sense * (f - boundary.angle) / TURN) % 1.0), boundary.after)
            for boundary in self.boundaries
            if boundary.direction == sense and not isnan(boundary.angle)
        ]
        return min(passed)[1] if passed else self.start_regime

# SPDX-License-Identifier: Apache-2.0
"""Linkage of the roller former: inertias, elastic drive and all carts.  The motor is the shared `KlossDrive`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_roles import CompiledLinkage
from mech_twin.engine.sample_vectors import EventLayout, LinkageLayout
from mech_twin.machines.roller_former.dynamics import Former, Modes, may_stick, state_array
from mech_twin.machines.roller_former.former_row import FAILURES, CoupledFormer, start_row
from mech_twin.machines.roller_former.memory import FormerMemory, FormerResiduals
from mech_twin.machines.roller_former.motion import EVENT_KINDS
from mech_twin.samples import LinkageSample

REGIMES = ("running", "held", "stalled")  # by the numbers of `former_row`


class FormerJoints(NamedTuple):
    """Positions, velocities or efforts of the joints by name: motor side at the crank, crank, twist, carts, rods."""

    drive: float
    crank: float
    twist: float
    carts: tuple[float, ...]
    rods: tuple[float, ...]


def joint_names(count: int) -> tuple[str, ...]:
    """Return the joints: motor side at the crank, crank, twist between them, then cart and rod of each crank."""
    carts = tuple(name for i in range(1, count + 1) for name in (f"cart_{i}", f"rod_{i}"))
    return ("drive", "crank", "twist", *carts)


def joints_of(values: tuple[float, ...]) -> FormerJoints:
    """Return the values of a sample's joints by name."""
    drive, crank, twist, *carts_and_rods = values
    return FormerJoints(drive, crank, twist, tuple(carts_and_rods[::2]), tuple(carts_and_rods[1::2]))


@dataclass(frozen=True)
class FormerLinkage(CompiledLinkage):
    """Both inertias, the elastic drive and all carts; it holds all mechanical state."""

    former: Former
    step_s: float
    start_crank_rad: float
    start_speed_rad_per_s: float
    start_command: float
    joints: tuple[str, ...]
    coordinates: tuple[str, ...] = ("crank", "twist")
    regimes: tuple[str, ...] = REGIMES
    failures: tuple[str, ...] = FAILURES

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the residuals; the series expansion has an error of (r/l)^4/8 of the rod's length."""
        open_rod = max(1e-12, 0.2 * self.former.bank.ratio**4 if self.former.bank.expanded else 0.0)
        return {"energy_balance": 1e-8, "rod_length": open_rod}

    @cached_property
    def model(self) -> CoupledFormer:
        """Constants of the kernel."""
        return CoupledFormer(self.former, float(self.step_s))

    @cached_property
    def layout(self) -> LinkageLayout:
        """Row of the samples."""
        return LinkageLayout(
            self.joints, FormerMemory._fields, FormerResiduals._fields, EventLayout(EVENT_KINDS, ("crank",))
        )

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine in its initial state: untwisted, the load on or still off as configured."""
        y = state_array(self.start_crank_rad, self.start_speed_rad_per_s)
        modes, out = start_modes(self.former, self.start_speed_rad_per_s), np.empty(self.layout.size)
        start_row(self.former, y, modes, float(self.start_command), out)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())


def start_modes(former: Former, speed_rad_per_s: float) -> Modes:
    """Return the initial modes: load on or off; a crank at rest under load or friction sticks."""
    loaded = former.engage_speed_rad_per_s <= speed_rad_per_s
    modes = Modes(1.0, 1.0, loaded, float(loaded), -1.0, False)
    held = speed_rad_per_s == 0.0 and may_stick(former, loaded)
    return modes._replace(direction=0.0) if held else modes
